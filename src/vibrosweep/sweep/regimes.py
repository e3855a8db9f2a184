"""Regimes of orbits from the cycles that the kernels recognised."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels.cycles import Cycles
from vibrosweep.kernels.regimes import classify, empty_regimes
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
    found = empty_regimes(frequency.size, particles)
    workers.each(
        lambda first, last: classify(
            first, last, problem, frequency, reflect, each.at_rest, cycles, found
        ),
        frequency.size,
        max(1, TRAJECTORIES_PER_TASK // particles),
    )
    return {
        "regime": found.regime,
        "cycle_impacts": found.impacts,
        "cycle_periods": found.periods,
        "cycle_rests": found.rests,
        "recurrent_from": found.since,
        **{
            f"{regime.meaning}_count": found.counts[regime]
            for regime in (Regime.RESTING, Regime.LOCKED, Regime.IRREGULAR)
        },
    }
