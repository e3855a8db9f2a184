"""Orbits that repeat: the rest of a trajectory counted from one cycle instead of followed.

A contracting orbit returns, in floating point, to the very same state (x, u); from there on it is
known for all time.  A lane remembers an earlier state, its anchor, at ages that double (Brent
1980), and compares with it when it is looked at anyway.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, jit
from vibrosweep.kernels.bases import Base, Scene, after_rest, take
from vibrosweep.kernels.impact import impact
from vibrosweep.kernels.lanes import ROW

__all__ = [
    "CYCLE",
    "FIRST_ANCHOR",
    "Cycles",
    "Rests",
    "close_cycle",
    "empty_cycles",
    "empty_rests",
    "forget_anchor",
    "has_returned",
    "no_cycle",
    "once_round",
    "saves_work",
]

FIRST_ANCHOR = 64  # age in impacts at which recurrence begins to be looked for
# A cycle is worth its finding where so many times the time since the anchor remains.
WORTH = 4.0
# Instants of the window that rounding might decide are left to be followed.
MARGIN = 2.0**-20  # periods

Totals = tuple[int, float, int, float, float, float]  # impacts, periods, rests and of the flights
Found = tuple[float, float, float]  # impacts, periods and rests of a cycle


Cycles = Floats


class CycleRows(NamedTuple):
    """Rows of an array that holds the cycles which trajectories have entered, a column for each.

    One array, because numba counts references to each.  Where no recurrence was found there are 0
    impacts, and the other rows hold anything.
    """

    IMPACTS: int = 0  # until the same bits return
    PERIODS: int = 1
    RESTS: int = 2
    WHOLE: int = 3  # whole periods from the end's, phase and speed of a state on the cycle
    PHASE: int = 4
    FLIGHT: int = 5
    AGE: int = 6  # impacts from the launch until that state


CYCLE: Final = CycleRows()


def empty_cycles(trajectories: int) -> Cycles:
    """Room for the cycles of a batch."""
    return np.empty((len(CYCLE), trajectories))


@jit
def no_cycle(cycles: Cycles, lane: int) -> None:
    """Note that trajectory `lane` has not been seen to recur."""
    cycles[CYCLE.IMPACTS, lane] = 0.0


@jit
def _note(
    cycles: Cycles, lane: int, found: Found, state: tuple[float, float, float], age: float
) -> None:
    """Note the cycle that trajectory `lane` is on, and a state of it."""
    impacts, periods, rests = found
    cycles[CYCLE.IMPACTS, lane], cycles[CYCLE.PERIODS, lane] = impacts, periods
    cycles[CYCLE.RESTS, lane], cycles[CYCLE.AGE, lane] = rests, age
    whole, phase, flight = state
    cycles[CYCLE.WHOLE, lane], cycles[CYCLE.PHASE, lane] = whole, phase
    cycles[CYCLE.FLIGHT, lane] = flight


# Of the orbit from one rest to the next, which all rested particles of a realization share: its
# totals and the realization, a line for each of those that are at hand.  Another one may take the
# line: then the orbit is gone through again.
Rests = Floats
ROOM_FOR_RESTS = 1024
REST_IMPACTS, REST_PERIODS, REST_SUM, REST_SQUARES, REST_LARGEST, WHOSE = range(6)


def empty_rests() -> Rests:
    """Memory of which nothing is known."""
    return np.full((ROOM_FOR_RESTS, WHOSE + 1), -1.0)


@jit
def once_round(fixed: Scene, x_start: float, u_start: float) -> Totals:
    """Totals of the cycle through a state; those of no impacts where a rest lies on the way."""
    n, x, u = 0.0, x_start, u_start
    impacts, total, squares, largest = 0, 0.0, 0.0, 0.0
    while impacts == 0 or x != x_start or u != u_start:
        hit = impact(fixed, n, x, u)
        n, x, u = hit.n_off, hit.x_off, hit.u
        impacts += 1
        total += u
        squares += u * u
        largest = max(largest, u)
        if not hit.leaves:
            if x != x_start or u != u_start:
                return 0, 0.0, 0, 0.0, 0.0, 0.0
            return impacts, n, 1, total, squares, largest
    return impacts, n, 0, total, squares, largest


@jit
def _count_cycle(s: Floats, j: int, realization: int, fixed: Scene, rests: Rests) -> None:
    """Note the totals of the cycle that lane j has entered."""
    p, q, rested, total, squares, largest = 0, 0.0, 0, 0.0, 0.0, 0.0
    if s[ROW.RESTS + j] == s[ROW.RESTS_ANCHOR + j]:  # no rest is known on the way
        p, q, rested, total, squares, largest = once_round(fixed, s[ROW.X + j], s[ROW.U + j])
    if p == 0 or rested > 0:
        line = realization % ROOM_FOR_RESTS
        if rests[line, WHOSE] != realization:
            x_lift, u_lift = after_rest(fixed)
            p, q, _, total, squares, largest = once_round(fixed, x_lift, u_lift)
            rests[line, REST_IMPACTS], rests[line, REST_PERIODS] = p, q
            rests[line, REST_SUM], rests[line, REST_SQUARES] = total, squares
            rests[line, REST_LARGEST], rests[line, WHOSE] = largest, realization
        rested = 1
        p, q = int(rests[line, REST_IMPACTS]), rests[line, REST_PERIODS]
        total, squares = rests[line, REST_SUM], rests[line, REST_SQUARES]
        largest = rests[line, REST_LARGEST]
    s[ROW.CYCLE_IMPACTS + j], s[ROW.CYCLE_PERIODS + j], s[ROW.CYCLE_RESTS + j] = p, q, rested
    s[ROW.CYCLE_SUM + j], s[ROW.CYCLE_SQUARES + j] = total, squares
    s[ROW.CYCLE_LARGEST + j] = largest


@jit
def _jump(s: Floats, j: int, windowed: bool) -> bool:
    """Pass over whole cycles of lane j; return whether they were the last ones.

    The landings that are passed over are all inside the window, or all before it.
    """
    periods = s[ROW.CYCLE_PERIODS + j]
    n, x = s[ROW.N + j], s[ROW.X + j]
    if windowed:
        begin = s[ROW.N_BEGIN + j] - n + (s[ROW.X_BEGIN + j] - x)
        if begin > -MARGIN:
            times = np.floor((begin - MARGIN) / periods)
            s[ROW.N + j] = n + max(0.0, times) * periods
            s[ROW.N_ANCHOR + j] = s[ROW.N + j]  # where it returns, and is looked at again
            return False
    times = max(0.0, np.floor(((s[ROW.X_END + j] - x) - n - MARGIN) / periods))
    s[ROW.N + j] = n + times * periods
    s[ROW.LANDINGS + j] += times * s[ROW.CYCLE_IMPACTS + j]
    s[ROW.RESTS + j] += times * s[ROW.CYCLE_RESTS + j]
    s[ROW.SUM + j] += times * s[ROW.CYCLE_SUM + j]
    s[ROW.SQUARES + j] += times * s[ROW.CYCLE_SQUARES + j]
    s[ROW.LARGEST + j] = max(s[ROW.LARGEST + j], s[ROW.CYCLE_LARGEST + j] if times > 0.0 else 0.0)
    return True


@jit
def has_returned(s: Floats, j: int) -> bool:
    """Whether the state of lane j is that of its anchor, at a later time."""
    same = s[ROW.X + j] == s[ROW.X_ANCHOR + j] and s[ROW.U + j] == s[ROW.U_ANCHOR + j]
    return bool(same and s[ROW.N + j] > s[ROW.N_ANCHOR + j])


@jit
def forget_anchor(s: Floats, j: int) -> None:
    """Look no more for a cycle of lane j."""
    s[ROW.X_ANCHOR + j] = np.nan
    s[ROW.NEXT_ANCHOR + j] = np.inf


@jit
def saves_work(s: Floats, j: int, jump: int) -> bool:
    """Whether the cycle of lane j, whose state has returned, may and should be passed over."""
    since = s[ROW.N + j] - s[ROW.N_ANCHOR + j]
    return bool(jump == 1 and since > 0.0 and -s[ROW.N + j] > WORTH * since)


@jit
def close_cycle(
    s: Floats,
    j: int,
    realization: int,
    base: Base,
    windowed: bool,
    jump: int,
    cycles: Cycles,
    rests: Rests,
) -> None:
    """Find the cycle of lane j, whose state has returned, and pass over it where that saves work.

    Parameters
    ----------
    s, j, realization
        Scratch memory, lane, and which realization it is of.
    base, windowed
        As in `vibrosweep.kernels.advance.advance`.
    jump
        1 where cycles are to be passed over.
    cycles
        Where the cycle is noted, if none has been.
    rests
        From `empty_rests`.
    """
    age, state = s[ROW.AGE + j], (s[ROW.N + j], s[ROW.X + j], s[ROW.U + j])
    since = s[ROW.N + j] - s[ROW.N_ANCHOR + j]
    rested = s[ROW.RESTS + j] - s[ROW.RESTS_ANCHOR + j]
    last, jumps = True, saves_work(s, j, jump)
    if not windowed and rested > 0.0 and not jumps:
        # from rest to rest there is but one orbit, so many times since the anchor
        impacts = age - 0.5 * s[ROW.NEXT_ANCHOR + j]
        found = impacts / rested, since / rested, 1.0
    else:
        if s[ROW.CYCLE_IMPACTS + j] == 0.0:
            _count_cycle(s, j, realization, take(base, s, j), rests)
        found = s[ROW.CYCLE_IMPACTS + j], s[ROW.CYCLE_PERIODS + j], s[ROW.CYCLE_RESTS + j]
        if jumps:
            last = _jump(s, j, windowed)
            if last:
                s[ROW.AGE + j] = -np.inf  # what is left is less than a cycle
    lane = int(s[ROW.LANE + j])
    if cycles[CYCLE.IMPACTS, lane] == 0.0:
        _note(cycles, lane, found, state, age)
    s[ROW.NEXT_ANCHOR + j] = np.inf
    if last:
        forget_anchor(s, j)
