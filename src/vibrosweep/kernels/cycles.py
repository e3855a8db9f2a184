"""Cycle detection: the remaining cycles of a periodic trajectory are added, not simulated.

A contracting orbit eventually returns, in floating point, to exactly the same state (x, u); from
then on it repeats for all time.  This recurrence is found by Brent's algorithm (1980): each lane
saves a state, its anchor, at ages that double, and compares its current state with the anchor
whenever lanes are checked.

Once all particles of a realization are on cycles, all of them together are on a joint cycle.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from vibrosweep.kernels import statistics
from vibrosweep.kernels._jit import Floats, jit
from vibrosweep.kernels.bases import Base, Constants, after_rest, counted, lifts_alike, take
from vibrosweep.kernels.impact import impact
from vibrosweep.kernels.memory import ROW, unwritten
from vibrosweep.kernels.statistics import CYCLE_LANDINGS, CYCLE_RESTS, OF_RESTS, Cycle, Kinds
from vibrosweep.model.observables import Landing

FIRST_ANCHOR = 64  # age in impacts at which the search for recurrence begins
# A cycle saves work if the remaining time exceeds the time since the anchor by this factor
WORTH = 4.0
# Distance from the ends of the window, where rounding might decide what is inside
MARGIN = 2.0**-20  # periods
# Quotients of two integers up to this number are equal in double precision only if exactly equal
LONGEST_JOINT = 2**25


Cycles = Floats


class CycleRows(NamedTuple):
    """Rows of the array of cycles that trajectories have entered; one column per trajectory.

    A single array, because numba counts references to each array.  Where no recurrence was found,
    IMPACTS is 0 and the other rows are undefined.
    """

    IMPACTS: int = 0  # of one cycle, until exactly the same state returns
    PERIODS: int = 1
    RESTS: int = 2
    WHOLE: int = 3  # whole periods relative to the end, phase and speed of a state on the cycle
    PHASE: int = 4
    FLIGHT: int = 5
    AGE: int = 6  # impacts from the launch until that state


CYCLE: Final = CycleRows()


class Chosen(NamedTuple):
    """The base with its laws, and the statistics: kernels are compiled for their types."""

    base: Base
    kinds: Kinds


def empty_cycles(trajectories: int) -> Cycles:
    """Allocate the cycles of a batch."""
    return unwritten((len(CYCLE), trajectories))


# Cache of the orbit from one rest to the next, which all particles of a realization share once they
# have rested: its totals, and the realization they belong to.  Another realization may overwrite
# its line of the cache; the orbit is then computed again.
Rests = Floats
RESTS_STORED = 1024
WHOSE = -1  # column of the realization, behind the totals


def empty_rests(kinds: Kinds) -> Rests:
    """Allocate the cache of orbits from rest to rest, all empty."""
    return np.full((RESTS_STORED, len(kinds) + 2), -1.0)


@jit
def once_round(kinds: Kinds, fixed: Constants, x_start: float, u_start: float) -> Cycle:
    """Return the totals of the cycle through a state.

    They are those of no impacts if there is a rest on the way and all rests end alike, because such
    a cycle is counted from rest to rest.
    """
    n, x, u = 0.0, x_start, u_start
    found: Cycle = statistics.no_impacts(kinds)
    while found[CYCLE_LANDINGS] == 0.0 or x != x_start or u != u_start:
        hit = impact(fixed, n, x, u)
        n, x, u = hit.n_off, hit.x_off, hit.u
        landing = Landing(hit.x, hit.flight.time, hit.v, hit.u, not hit.leaves)
        found = statistics.added(kinds, found, n, landing, counted(fixed, hit.flight, hit.u))
        if not hit.leaves and lifts_alike(fixed.base) and (x != x_start or u != u_start):
            found = statistics.no_impacts(kinds)
            break
    return found


@jit
def _count_cycle(
    kinds: Kinds, s: Floats, j: int, realization: int, fixed: Constants, rests: Rests
) -> None:
    """Note the totals of the cycle that lane j has entered."""
    found = statistics.no_impacts(kinds)
    alike = lifts_alike(fixed.base)
    if s[OF_RESTS + j] == s[ROW.RESTS_ANCHOR + j] or not alike:  # no rest is known on the way
        found = once_round(kinds, fixed, s[ROW.X + j], s[ROW.U + j])
    if found[CYCLE_LANDINGS] > 0.0 and (found[CYCLE_RESTS] == 0.0 or not alike):
        statistics.set_cycle(kinds, s, j, found)
        return
    line = realization % RESTS_STORED
    if rests[line, WHOSE] != realization:
        x_lift, u_lift = after_rest(fixed)
        found = once_round(kinds, fixed, x_lift, u_lift)
        for k in range(len(found)):
            rests[line, k] = found[k]
        rests[line, WHOSE] = realization
    statistics.set_cycle(kinds, s, j, rests[line])


@jit
def _whole_cycles(whole: float, phase: float, periods: float) -> float:
    """Return how many cycles end `MARGIN` or more before whole periods and a phase have passed."""
    times: float = max(0.0, np.floor((whole + phase - MARGIN) / periods))
    # in a long time the sum is rounded by more than the margin; what the cycles leave is exact
    left = (whole - times * periods) + phase
    return max(0.0, times - 1.0) if left < MARGIN else times


@jit
def _jump(kinds: Kinds, s: Floats, j: int, periods: float, window: int | None) -> bool:
    """Skip whole cycles of lane j; return whether they were the last ones.

    The skipped landings are either all inside the window or all before it.
    """
    n, x = s[ROW.N + j], s[ROW.X + j]
    if window is not None:
        begin = s[ROW.N_BEGIN + j] - n + (s[ROW.X_BEGIN + j] - x)
        if begin > -MARGIN:
            times = _whole_cycles(s[ROW.N_BEGIN + j] - n, s[ROW.X_BEGIN + j] - x, periods)
            s[ROW.N + j] = n + times * periods
            s[ROW.N_ANCHOR + j] = s[ROW.N + j]  # it recurs here, and is checked again
            return False
    times = _whole_cycles(-n, s[ROW.X_END + j] - x, periods)
    s[ROW.N + j] = n + times * periods
    statistics.repeat(kinds, s, j, times)
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

    `jump` is 1 to skip them.  The cycle is written to `cycles`, unless they already contain one.
    """
    kinds = chosen.kinds
    age, n, x, u = s[ROW.AGE + j], s[ROW.N + j], s[ROW.X + j], s[ROW.U + j]
    since = s[ROW.N + j] - s[ROW.N_ANCHOR + j]
    rested = s[OF_RESTS + j] - s[ROW.RESTS_ANCHOR + j]
    last, jumps = True, saves_work(s, j, jump)
    if lifts_alike(chosen.base) and window is None and rested > 0.0 and not jumps:
        # the orbit from rest to rest is unique, and was passed `rested` times since the anchor
        periods, impacts = since / rested, (age - 0.5 * s[ROW.NEXT_ANCHOR + j]) / rested
        rests_of_cycle = 1.0
    else:
        periods, impacts, rests_of_cycle = statistics.cycle_of(kinds, s, j)
        if impacts == 0.0:
            _count_cycle(kinds, s, j, realization, take(chosen.base, s, j), rests)
            periods, impacts, rests_of_cycle = statistics.cycle_of(kinds, s, j)
        if jumps:
            last = _jump(kinds, s, j, periods, window)
            if last:
                s[ROW.AGE + j] = -np.inf  # less than a cycle is left
    lane = int(s[ROW.LANE + j])
    if cycles[CYCLE.IMPACTS, lane] == 0.0:
        cycles[CYCLE.IMPACTS, lane], cycles[CYCLE.PERIODS, lane] = impacts, periods
        cycles[CYCLE.RESTS, lane], cycles[CYCLE.AGE, lane] = rests_of_cycle, age
        cycles[CYCLE.WHOLE, lane], cycles[CYCLE.PHASE, lane] = n, x
        cycles[CYCLE.FLIGHT, lane] = u
    s[ROW.NEXT_ANCHOR + j] = np.inf
    if last:
        stop_search(s, j)


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
        if impacts > LONGEST_JOINT or periods > LONGEST_JOINT:
            return nothing
        age = max(age, int(cycles[CYCLE.AGE, t]))
        known = max(known, cycles[CYCLE.WHOLE, t] + 1.0)
        pace[p] = cycles[CYCLE.PERIODS, t] / cycles[CYCLE.IMPACTS, t]
    return Joint(impacts, float(periods), age, known)


@jit
def affordable(cycles: Cycles, first: int, particles: int, n_end: float, budget: int) -> bool:
    """Return whether all landings until whole period n_end of trajectories first, ... fit a budget.

    Trajectories without a cycle were simulated to the end within the budget.
    """
    for t in range(first, first + particles):
        if cycles.size > 0 and cycles[CYCLE.IMPACTS, t] > 0.0:
            rounds = (n_end - cycles[CYCLE.WHOLE, t]) / cycles[CYCLE.PERIODS, t]
            if cycles[CYCLE.AGE, t] + rounds * cycles[CYCLE.IMPACTS, t] > budget:
                return False
    return True
