"""Cycle detection: the rest of a periodic trajectory is counted from one cycle.

A contracting orbit eventually returns, in floating point, to exactly the same state (x, u); from
then on it repeats for all time.  This recurrence is found by Brent's algorithm (1980): each lane
saves a state, its anchor, at ages that double, and compares its current state with the anchor
whenever lanes are checked.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, jit
from vibrosweep.kernels.bases import Base, Constants, after_rest, take
from vibrosweep.kernels.impact import impact
from vibrosweep.kernels.lanes import ROW, STRIDE
from vibrosweep.kernels.statistics import OF_CYCLE, RUNNING, Cycle, add, no_impacts, repeat

FIRST_ANCHOR = 64  # age in impacts at which the search for recurrence begins
# A cycle saves work if the remaining time is this many times the time since the anchor.
WORTH = 4.0
# Distance kept from the ends of the window, where rounding might decide what is inside.
MARGIN = 2.0**-20  # periods

Found = tuple[float, float, float]  # impacts, periods and rests of a cycle


Cycles = Floats


class CycleRows(NamedTuple):
    """Rows of the array of cycles that trajectories have entered; one column per trajectory.

    A single array, because numba counts references to each array.  Where no recurrence was found,
    IMPACTS is 0 and the other rows are undefined.
    """

    IMPACTS: int = 0  # of one cycle, until exactly the same state returns
    PERIODS: int = 1
    RESTS: int = 2
    WHOLE: int = 3  # whole periods from the end's, phase and speed of a state on the cycle
    PHASE: int = 4
    FLIGHT: int = 5
    AGE: int = 6  # impacts from the launch until that state


CYCLE: Final = CycleRows()


def empty_cycles(trajectories: int) -> Cycles:
    """Allocate the cycles of a batch."""
    return np.empty((len(CYCLE), trajectories))


@jit
def no_cycle(cycles: Cycles, lane: int) -> None:
    """Record that no recurrence of trajectory `lane` was found."""
    cycles[CYCLE.IMPACTS, lane] = 0.0


@jit
def _note(
    cycles: Cycles, lane: int, found: Found, state: tuple[float, float, float], age: float
) -> None:
    """Store the cycle of trajectory `lane`, and a state on it."""
    impacts, periods, rests = found
    cycles[CYCLE.IMPACTS, lane], cycles[CYCLE.PERIODS, lane] = impacts, periods
    cycles[CYCLE.RESTS, lane], cycles[CYCLE.AGE, lane] = rests, age
    whole, phase, flight = state
    cycles[CYCLE.WHOLE, lane], cycles[CYCLE.PHASE, lane] = whole, phase
    cycles[CYCLE.FLIGHT, lane] = flight


# Cache of the orbit from one rest to the next, which all particles of a realization share once they
# have rested: its totals, and the realization they belong to.  Another realization may overwrite
# the line; the orbit is then computed again.
Rests = Floats
ROOM_FOR_RESTS = 1024
WHOSE = OF_CYCLE  # behind the totals


def empty_rests() -> Rests:
    """Memory of which nothing is known."""
    return np.full((ROOM_FOR_RESTS, WHOSE + 1), -1.0)


@jit
def once_round(fixed: Constants, x_start: float, u_start: float) -> Cycle:
    """Totals of the cycle through a state; those of no impacts where a rest lies on the way."""
    n, x, u = 0.0, x_start, u_start
    found = no_impacts()
    while found.impacts == 0.0 or x != x_start or u != u_start:
        hit = impact(fixed, n, x, u)
        n, x, u = hit.n_off, hit.x_off, hit.u
        found = add(found, fixed, hit)
        if not hit.leaves and (x != x_start or u != u_start):
            return no_impacts()
    return found


@jit
def _count_cycle(s: Floats, j: int, realization: int, fixed: Constants, rests: Rests) -> None:
    """Note the totals of the cycle that lane j has entered."""
    found = no_impacts()
    if s[RUNNING.RESTS + j] == s[ROW.RESTS_ANCHOR + j]:  # no rest is known on the way
        found = once_round(fixed, s[ROW.X + j], s[ROW.U + j])
    if found.impacts > 0.0 and found.rests == 0.0:
        for k in range(OF_CYCLE):
            s[RUNNING.CYCLE_IMPACTS + k * STRIDE + j] = found[k]
        return
    line = realization % ROOM_FOR_RESTS
    if rests[line, WHOSE] != realization:
        x_lift, u_lift = after_rest(fixed)
        found = once_round(fixed, x_lift, u_lift)
        for k in range(OF_CYCLE):
            rests[line, k] = found[k]
        rests[line, WHOSE] = realization
    for k in range(OF_CYCLE):
        s[RUNNING.CYCLE_IMPACTS + k * STRIDE + j] = rests[line, k]


@jit
def _jump(s: Floats, j: int, windowed: bool) -> bool:
    """Skip whole cycles of lane j; return whether they were the last ones.

    The skipped landings are either all inside the window or all before it.
    """
    periods = s[RUNNING.CYCLE_PERIODS + j]
    n, x = s[ROW.N + j], s[ROW.X + j]
    if windowed:
        begin = s[ROW.N_BEGIN + j] - n + (s[ROW.X_BEGIN + j] - x)
        if begin > -MARGIN:
            times = np.floor((begin - MARGIN) / periods)
            s[ROW.N + j] = n + max(0.0, times) * periods
            s[ROW.N_ANCHOR + j] = s[ROW.N + j]  # it recurs here, and is checked again
            return False
    times = max(0.0, np.floor(((s[ROW.X_END + j] - x) - n - MARGIN) / periods))
    s[ROW.N + j] = n + times * periods
    repeat(s, j, times)
    return True


@jit
def recurs(s: Floats, j: int) -> bool:
    """Whether lane j recurs: its state equals its anchor, at a later time."""
    same = s[ROW.X + j] == s[ROW.X_ANCHOR + j] and s[ROW.U + j] == s[ROW.U_ANCHOR + j]
    return bool(same and s[ROW.N + j] > s[ROW.N_ANCHOR + j])


@jit
def stop_search(s: Floats, j: int) -> None:
    """Stop the search for a cycle of lane j: no state equals NaN, and no anchor is due."""
    s[ROW.X_ANCHOR + j] = np.nan
    s[ROW.NEXT_ANCHOR + j] = np.inf


@jit
def saves_work(s: Floats, j: int, jump: int) -> bool:
    """Whether skipping cycles of lane j, which recurs, is allowed and saves work."""
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
    """Determine the cycle of lane j, which recurs, and skip its repetitions if that saves work.

    `jump` is 1 to skip them.  `cycles` are filled with the cycle, unless they hold one already.
    """
    age, state = s[ROW.AGE + j], (s[ROW.N + j], s[ROW.X + j], s[ROW.U + j])
    since = s[ROW.N + j] - s[ROW.N_ANCHOR + j]
    rested = s[RUNNING.RESTS + j] - s[ROW.RESTS_ANCHOR + j]
    last, jumps = True, saves_work(s, j, jump)
    if not windowed and rested > 0.0 and not jumps:
        # the orbit from rest to rest is unique, and was passed `rested` times since the anchor
        impacts = age - 0.5 * s[ROW.NEXT_ANCHOR + j]
        found = impacts / rested, since / rested, 1.0
    else:
        if s[RUNNING.CYCLE_IMPACTS + j] == 0.0:
            _count_cycle(s, j, realization, take(base, s, j), rests)
        found = (
            s[RUNNING.CYCLE_IMPACTS + j],
            s[RUNNING.CYCLE_PERIODS + j],
            s[RUNNING.CYCLE_RESTS + j],
        )
        if jumps:
            last = _jump(s, j, windowed)
            if last:
                s[ROW.AGE + j] = -np.inf  # less than a cycle is left
    lane = int(s[ROW.LANE + j])
    if cycles[CYCLE.IMPACTS, lane] == 0.0:
        _note(cycles, lane, found, state, age)
    s[ROW.NEXT_ANCHOR + j] = np.inf
    if last:
        stop_search(s, j)
