"""Regimes of orbits from the cycles that the kernels recognised."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels.cycles import Cycles, shorten
from vibrosweep.kernels.statistics import Statistics
from vibrosweep.scene import Dimensionless
from vibrosweep.status import Regime
from vibrosweep.sweep.workers import TRAJECTORIES_PER_TASK, Workers

__all__ = ["regimes"]


def regimes(
    each: Statistics,
    cycles: Cycles,
    problem: Dimensionless,
    particles: int,
    reflect: int | None,
    frequency: NDArray[np.float64],
    workers: Workers,
) -> dict[str, NDArray[Any]]:
    """Regime and cycle of each particle, and how many particles of a realization are in each.

    Parameters
    ----------
    each, cycles
        Of all trajectories, those of a realization side by side.
    problem
        Of the realizations.
    particles
        Number of particles of a realization.
    reflect
        The rebound law as the kernels take it.
    frequency
        Hz, shape (realization,).
    workers
        Threads to use.

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
    begin = (cycles.whole + cycles.phase).reshape(shape)
    begin += (problem.end_count - problem.phase)[:, np.newaxis]
    impacts, periods = (np.empty(each.status.size, np.int64) for _ in range(2))
    workers.each(
        lambda first, last: shorten(
            first, last, problem, particles, reflect, cycles, impacts, periods
        ),
        each.status.size,
        TRAJECTORIES_PER_TASK,
    )
    counts = {
        f"{regime.meaning}_count": np.count_nonzero(found == regime, axis=1)
        for regime in (Regime.RESTING, Regime.LOCKED, Regime.IRREGULAR)
    }
    return {
        "regime": found.astype(np.int8),
        "cycle_impacts": impacts.reshape(shape),
        "cycle_periods": periods.reshape(shape),
        # a copy: `cycles` is written over by the next batch
        "cycle_rests": cycles.rests.reshape(shape).copy(),
        "recurrent_from": begin / frequency[:, np.newaxis],
        **counts,
    }
