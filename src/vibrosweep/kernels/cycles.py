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
from vibrosweep.kernels.bases import (
    Base,
    Constants,
    Instant,
    after_rest,
    counted,
    lifts_alike,
    take,
)
from vibrosweep.kernels.impact import impact
from vibrosweep.kernels.lanes import ROW
from vibrosweep.kernels.statistics import Kinds
from vibrosweep.kernels.totals import (
    CYCLE_LANDINGS,
    CYCLE_RESTS,
    OF_RESTS,
    Cycle,
    added,
    cycle_of,
    keep_cycle,
    kept_cycle,
    no_impacts,
    repeat,
    set_cycle,
)
from vibrosweep.kernels.unwritten import unwritten
from vibrosweep.model.landing import Landing

FIRST_ANCHOR = 64  # age in impacts at which the search for recurrence begins
# A cycle saves work if the remaining time exceeds the time since the anchor by this factor
WORTH = 4.0
# Distance kept from the ends of the window, where rounding might decide what is inside
MARGIN = 2.0**-20  # periods


class Length(NamedTuple):
    """Length of a cycle."""

    periods: float
    impacts: float
    rests: float


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


class Chosen(NamedTuple):
    """Choices by type when kernels are compiled: the base with its law, and the statistics."""

    base: Base
    kinds: Kinds


def empty_cycles(trajectories: int) -> Cycles:
    """Allocate the cycles of a batch."""
    return unwritten((len(CYCLE), trajectories))


def no_cycles(trajectories: int) -> Cycles:
    """Return cycles of which none was found."""
    return np.zeros((len(CYCLE), trajectories))


@jit
def no_cycle(cycles: Cycles, lane: int) -> None:
    """Record that no recurrence of trajectory `lane` was found."""
    cycles[CYCLE.IMPACTS, lane] = 0.0


@jit
def _note(
    cycles: Cycles, lane: int, length: Length, at: Instant, flight: float, age: float
) -> None:
    """Store the cycle of trajectory `lane`, and a state on it."""
    cycles[CYCLE.IMPACTS, lane], cycles[CYCLE.PERIODS, lane] = length.impacts, length.periods
    cycles[CYCLE.RESTS, lane], cycles[CYCLE.AGE, lane] = length.rests, age
    cycles[CYCLE.WHOLE, lane], cycles[CYCLE.PHASE, lane] = at.whole, at.phase
    cycles[CYCLE.FLIGHT, lane] = flight


# Cache of the orbit from one rest to the next, which all particles of a realization share once they
# have rested: its totals, and the realization they belong to.  Another realization may overwrite
# the line; the orbit is then computed again.
Rests = Floats
RESTS_KEPT = 1024
WHOSE = 0  # before the totals


def empty_rests(kinds: Kinds) -> Rests:
    """Allocate the cache of orbits from rest to rest, all empty."""
    return np.full((RESTS_KEPT, len(kinds) + 2), -1.0)


@jit
def once_round(kinds: Kinds, fixed: Constants, x_start: float, u_start: float) -> Cycle:
    """Return the totals of the cycle through a state.

    They are those of no impacts if the cycle has a rest, from which it is known already.
    """
    n, x, u = 0.0, x_start, u_start
    found: Cycle = no_impacts(kinds)
    while found[CYCLE_LANDINGS] == 0.0 or x != x_start or u != u_start:
        hit = impact(fixed, n, x, u)
        n, x, u = hit.n_off, hit.x_off, hit.u
        landing = Landing(hit.x, hit.flight.time, hit.v, hit.u, not hit.leaves)
        found = added(kinds, found, n, landing, counted(fixed, hit.flight, hit.u))
        if not hit.leaves and lifts_alike(fixed.base) and (x != x_start or u != u_start):
            found = no_impacts(kinds)
            break
    return found


@jit
def _count_cycle(
    kinds: Kinds, s: Floats, j: int, realization: int, fixed: Constants, rests: Rests
) -> None:
    """Note the totals of the cycle that lane j has entered."""
    found = no_impacts(kinds)
    alike = lifts_alike(fixed.base)
    if s[OF_RESTS + j] == s[ROW.RESTS_ANCHOR + j] or not alike:  # no rest is known on the way
        found = once_round(kinds, fixed, s[ROW.X + j], s[ROW.U + j])
    if found[CYCLE_LANDINGS] > 0.0 and (found[CYCLE_RESTS] == 0.0 or not alike):
        set_cycle(kinds, s, j, found)
        return
    line = realization % RESTS_KEPT
    if rests[line, WHOSE] != realization:
        x_lift, u_lift = after_rest(fixed)
        found = once_round(kinds, fixed, x_lift, u_lift)
        keep_cycle(kinds, rests, line, found)
        rests[line, WHOSE] = realization
    set_cycle(kinds, s, j, kept_cycle(kinds, rests, line))


@jit
def _jump(kinds: Kinds, s: Floats, j: int, periods: float, window: int | None) -> bool:
    """Skip whole cycles of lane j; return whether they were the last ones.

    The skipped landings are either all inside the window or all before it.
    """
    n, x = s[ROW.N + j], s[ROW.X + j]
    if window is not None:
        begin = s[ROW.N_BEGIN + j] - n + (s[ROW.X_BEGIN + j] - x)
        if begin > -MARGIN:
            times = np.floor((begin - MARGIN) / periods)
            s[ROW.N + j] = n + max(0.0, times) * periods
            s[ROW.N_ANCHOR + j] = s[ROW.N + j]  # it recurs here, and is checked again
            return False
    times = max(0.0, np.floor(((s[ROW.X_END + j] - x) - n - MARGIN) / periods))
    s[ROW.N + j] = n + times * periods
    repeat(kinds, s, j, times)
    return True


@jit
def recurs(s: Floats, j: int) -> bool:
    """Return whether lane j recurs: its state equals its anchor, at a later time."""
    same = s[ROW.X + j] == s[ROW.X_ANCHOR + j] and s[ROW.U + j] == s[ROW.U_ANCHOR + j]
    return bool(same and s[ROW.N + j] > s[ROW.N_ANCHOR + j])


@jit
def stop_search(s: Floats, j: int) -> None:
    """Stop the search for a cycle of lane j: no state equals NaN, and no anchor is due."""
    s[ROW.X_ANCHOR + j] = np.nan
    s[ROW.NEXT_ANCHOR + j] = np.inf


@jit
def saves_work(s: Floats, j: int, jump: int) -> bool:
    """Return whether skipping cycles of lane j, which recurs, is allowed and saves work."""
    since = s[ROW.N + j] - s[ROW.N_ANCHOR + j]
    return bool(jump == 1 and since > 0.0 and -s[ROW.N + j] > WORTH * since)


@jit
def close_cycle(
    s: Floats,
    j: int,
    realization: int,
    chosen: Chosen,
    window: int | None,
    jump: int,
    cycles: Cycles,
    rests: Rests,
) -> None:
    """Determine the cycle of lane j, which recurs, and skip its repetitions if that saves work.

    `jump` is 1 to skip them.  `cycles` are filled with the cycle, unless they hold one already.
    """
    kinds = chosen.kinds
    age, at, flight = s[ROW.AGE + j], Instant(s[ROW.N + j], s[ROW.X + j]), s[ROW.U + j]
    since = s[ROW.N + j] - s[ROW.N_ANCHOR + j]
    rested = s[OF_RESTS + j] - s[ROW.RESTS_ANCHOR + j]
    last, jumps = True, saves_work(s, j, jump)
    if lifts_alike(chosen.base) and window is None and rested > 0.0 and not jumps:
        # the orbit from rest to rest is unique, and was passed `rested` times since the anchor
        impacts = age - 0.5 * s[ROW.NEXT_ANCHOR + j]
        length = Length(since / rested, impacts / rested, 1.0)
    else:
        length = Length(*cycle_of(kinds, s, j))
        if length.impacts == 0.0:
            _count_cycle(kinds, s, j, realization, take(chosen.base, s, j), rests)
            length = Length(*cycle_of(kinds, s, j))
        if jumps:
            last = _jump(kinds, s, j, length.periods, window)
            if last:
                s[ROW.AGE + j] = -np.inf  # less than a cycle is left
    lane = int(s[ROW.LANE + j])
    if cycles[CYCLE.IMPACTS, lane] == 0.0:
        _note(cycles, lane, length, at, flight, age)
    s[ROW.NEXT_ANCHOR + j] = np.inf
    if last:
        stop_search(s, j)
