"""Regimes of orbits from the cycles that the kernels recognised."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels.advance import Statistics
from vibrosweep.kernels.cycles import Cycles
from vibrosweep.scene import Dimensionless
from vibrosweep.status import Regime

__all__ = ["regimes"]


def regimes(
    each: Statistics,
    cycles: Cycles,
    problem: Dimensionless,
    frequency: NDArray[np.float64],
) -> dict[str, NDArray[Any]]:
    """Regime and cycle of each particle, and how many particles of a realization are in each.

    Parameters
    ----------
    each, cycles
        Of all trajectories, those of a realization side by side.
    problem
        Of the realizations.
    frequency
        Hz, shape (realization,).

    Returns
    -------
    dict
        Arrays of shape (realization, particle) and (realization,), named as in
        `vibrosweep.variables`.
    """
    shape = (frequency.size, -1)
    found = np.select(
        [each.at_rest > 0, cycles.rests > 0, cycles.impacts > 0],
        [Regime.AT_REST, Regime.RESTING, Regime.LOCKED],
        Regime.IRREGULAR,
    ).reshape(shape)
    begin = cycles.begin.reshape(shape) + (problem.end_count - problem.phase)[:, np.newaxis]
    counts = {
        f"{regime.meaning}_count": np.count_nonzero(found == regime, axis=1)
        for regime in (Regime.RESTING, Regime.LOCKED, Regime.IRREGULAR)
    }
    return {
        "regime": found.astype(np.int8),
        "cycle_impacts": cycles.impacts.reshape(shape),
        "cycle_periods": cycles.periods.reshape(shape),
        "cycle_rests": cycles.rests.reshape(shape),
        "recurrent_from": begin / frequency[:, np.newaxis],
        **counts,
    }
