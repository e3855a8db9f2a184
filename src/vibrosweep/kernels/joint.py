"""The joint cycle of all particles of a realization."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, jit
from vibrosweep.kernels.cycles import CYCLE, Cycles

# Up to this number quotients of two integers are equal in double precision only if they are equal
LONGEST = 2**25


class Joint(NamedTuple):
    """Cycles of all particles of a realization together."""

    # Least common multiple of the impacts in the cycles; 0 where there is no joint cycle
    impacts: int
    periods: float  # least common multiple of their forcing periods
    age: int  # impacts after which each particle is on its cycle
    known: float  # whole periods, relative to the end, after which each particle is on its cycle


@jit
def _common_multiple(a: int, b: int) -> int:
    x, y = a, b
    while y > 0:
        x, y = y, x % y
    return a // x * b


@jit
def joint_cycle(cycles: Cycles, first: int, pace: Floats) -> Joint:
    """Joint cycle of trajectories first, ...; of no impacts where there is none.

    The forcing periods that an impact takes are written to `pace`, of shape (particle,).
    """
    nothing = Joint(0, 0.0, 0, 0.0)
    if cycles.size == 0:
        return nothing
    impacts, periods, age, known = 1, 1, 0, -np.inf
    for p in range(pace.size):
        t = first + p
        if cycles[CYCLE.IMPACTS, t] == 0.0:
            return nothing
        impacts = _common_multiple(impacts, int(cycles[CYCLE.IMPACTS, t]))
        periods = _common_multiple(periods, int(cycles[CYCLE.PERIODS, t]))
        if impacts > LONGEST or periods > LONGEST:
            return nothing
        age = max(age, int(cycles[CYCLE.AGE, t]))
        known = max(known, cycles[CYCLE.WHOLE, t] + 1.0)
        pace[p] = cycles[CYCLE.PERIODS, t] / cycles[CYCLE.IMPACTS, t]
    return Joint(impacts, float(periods), age, known)


@jit
def affordable(cycles: Cycles, first: int, particles: int, n_end: float, budget: int) -> bool:
    """Return whether all landings until whole period n_end of trajectories first, ... fit a budget.

    Trajectories without a cycle were followed to the end within it.
    """
    for t in range(first, first + particles):
        if cycles.size > 0 and cycles[CYCLE.IMPACTS, t] > 0.0:
            rounds = (n_end - cycles[CYCLE.WHOLE, t]) / cycles[CYCLE.PERIODS, t]
            if cycles[CYCLE.AGE, t] + rounds * cycles[CYCLE.IMPACTS, t] > budget:
                return False
    return True
