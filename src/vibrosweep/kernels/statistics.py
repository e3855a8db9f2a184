"""Statistics of trajectories over the window, and how the kernel puts them down."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Flags, Floats, Integers, jit, prefetch
from vibrosweep.kernels.bases import Base, fly, take
from vibrosweep.kernels.impact import land
from vibrosweep.kernels.lanes import ROW, SPENT
from vibrosweep.model.status import Status

__all__ = ["Statistics", "empty_statistics", "expect", "write"]

LINE = 8  # numbers in a line of the cache

COMPLETED = int(Status.COMPLETED)
BUDGET_EXCEEDED = int(Status.BUDGET_EXCEEDED)
NON_FINITE = int(Status.NON_FINITE)


class Statistics(NamedTuple):
    """Statistics of trajectories over the window, each array of shape (trajectory,).

    Attributes
    ----------
    landings, rests
        Number of landings, and of those after which the particle rested.
    at_rest
        1 where the particle came to rest for good before the end; summed, the number of those.
    flight_sum, flight_squares, flight_max
        Of the flights that follow the landings: sum, sum of squares and maximum of the flight
        time, in forcing periods and their square; a particle at rest for good adds nothing.
    status
        `vibrosweep.model.status.Status`.
    """

    landings: Integers
    rests: Integers
    at_rest: Flags | Integers
    flight_sum: Floats
    flight_squares: Floats
    flight_max: Floats
    status: Flags


def empty_statistics(trajectories: int) -> Statistics:
    """Room for the statistics of a batch."""
    landings, rests = (np.empty(trajectories, np.int64) for _ in range(2))
    total, squares, largest = (np.empty(trajectories) for _ in range(3))
    at_rest, status = (np.empty(trajectories, np.int8) for _ in range(2))
    return Statistics(landings, rests, at_rest, total, squares, largest, status)


@jit
def expect(out: Statistics, lane: int) -> None:
    """Fetch the memory for statistics that will be written a block of lanes later."""
    if lane % LINE > 0:  # the trajectory before has done it
        return
    prefetch(out.landings, lane)
    prefetch(out.rests, lane)
    prefetch(out.flight_sum, lane)
    prefetch(out.flight_squares, lane)
    prefetch(out.flight_max, lane)
    prefetch(out.at_rest, lane)
    prefetch(out.status, lane)


@jit
def write(s: Floats, j: int, base: Base, windowed: bool, out: Statistics) -> None:
    """Write the statistics of the trajectory in place j to its own slot."""
    lane = int(s[ROW.LANE + j]) if j >= 0 else -1
    if lane < 0:  # never, which spares the compiler the look at it for each index below
        return
    out.landings[lane] = int(s[ROW.LANDINGS + j])
    out.rests[lane] = int(s[ROW.RESTS + j])
    out.flight_sum[lane] = s[ROW.SUM + j]
    out.flight_squares[lane] = s[ROW.SQUARES + j]
    out.flight_max[lane] = s[ROW.LARGEST + j]
    for_good = np.isnan(s[ROW.X + j])
    if not windowed:  # it may have come after the end, but not where it was counted
        for_good = for_good and s[ROW.RESTS + j] > 0.0
    out.at_rest[lane] = 1 if for_good else 0
    out.status[lane] = COMPLETED
    if s[ROW.DONE + j] == SPENT:
        flight, _ = fly(take(base, s, j), s[ROW.X + j], s[ROW.U + j])
        x, passed = land(s[ROW.X + j], flight)
        if s[ROW.N + j] + passed <= s[ROW.X_END + j] - x:
            out.status[lane] = BUDGET_EXCEEDED
    if not np.isfinite(s[ROW.SQUARES + j]):
        out.status[lane] = NON_FINITE
