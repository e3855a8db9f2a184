"""Orbits that repeat: the rest of a trajectory counted from one cycle instead of followed.

A contracting orbit returns, in floating point, to the very same state (x, u); from there on it is
known for all time.  A lane remembers an earlier state, its anchor, at ages that double (Brent
1980), and compares with it when it is looked at anyway.
"""

from __future__ import annotations

import numpy as np

from vibrosweep.kernels._jit import Floats, jit
from vibrosweep.kernels.impact import Scene, impact
from vibrosweep.kernels.lanes import (
    AGE,
    C_IMPACTS,
    C_LARGEST,
    C_PERIODS,
    C_RESTS,
    C_SQUARES,
    C_SUM,
    LANDINGS,
    LANE,
    LARGEST,
    N_ANCHOR,
    N_BEGIN,
    NEXT_ANCHOR,
    RESTS,
    RESTS_ANCHOR,
    SQUARES,
    SUM,
    U_ANCHOR,
    U_LIFT,
    X_ANCHOR,
    X_BEGIN,
    X_END,
    X_LIFT,
    A,
    E,
    N,
    R,
    U,
    X,
)

__all__ = [
    "CYCLE_AGE",
    "CYCLE_FLIGHT",
    "CYCLE_IMPACTS",
    "CYCLE_PERIODS",
    "CYCLE_PHASE",
    "CYCLE_RESTS",
    "CYCLE_WHOLE",
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


# The cycles that trajectories have entered: a row for each field, a column for each trajectory; one
# array, because numba counts references to each.  Impacts, forcing periods and rests until the same
# bits return; whole periods from the end's, phase and flight time of a state on the cycle; impacts
# from the launch until that state.  Where no recurrence was found there are 0 impacts, and the
# other fields hold anything.
Cycles = Floats
(
    CYCLE_IMPACTS,
    CYCLE_PERIODS,
    CYCLE_RESTS,
    CYCLE_WHOLE,
    CYCLE_PHASE,
    CYCLE_FLIGHT,
    CYCLE_AGE,
) = range(7)
CYCLE_FIELDS = 7


def empty_cycles(trajectories: int) -> Cycles:
    """Room for the cycles of a batch."""
    return np.empty((CYCLE_FIELDS, trajectories))


@jit
def no_cycle(cycles: Cycles, lane: int) -> None:
    """Note that trajectory `lane` has not been seen to recur."""
    cycles[CYCLE_IMPACTS, lane] = 0.0


@jit
def _note(
    cycles: Cycles,
    lane: int,
    found: Found,
    state: tuple[float, float, float],
    age: float,
) -> None:
    """Note the cycle that trajectory `lane` is on, and a state of it."""
    impacts, periods, rests = found
    cycles[CYCLE_IMPACTS, lane], cycles[CYCLE_PERIODS, lane] = impacts, periods
    cycles[CYCLE_RESTS, lane], cycles[CYCLE_AGE, lane] = rests, age
    whole, phase, flight = state
    cycles[CYCLE_WHOLE, lane], cycles[CYCLE_PHASE, lane] = whole, phase
    cycles[CYCLE_FLIGHT, lane] = flight


# Of the orbit from one rest to the next, which all rested particles of a realization share:
# impacts, forcing periods, and sum, sum of squares and maximum of the flight time; a row for each
# of the realizations that are at hand, which the last field names.  Another one may take the row:
# then the orbit is gone through again.
Rests = Floats
ROOM_FOR_RESTS = 1024
WHOSE = 5


def empty_rests() -> Rests:
    """Memory of which nothing is known."""
    return np.full((ROOM_FOR_RESTS, WHOSE + 1), -1.0)


@jit
def once_round(fixed: Scene, x_start: float, u_start: float, reflect: int | None) -> Totals:
    """Totals of the cycle through a state; those of no impacts where a rest lies on the way."""
    n, x, u = 0.0, x_start, u_start
    impacts, total, squares, largest = 0, 0.0, 0.0, 0.0
    while impacts == 0 or x != x_start or u != u_start:
        _, _, n, x, u, leaves = impact(fixed, n, x, u, reflect)
        impacts += 1
        total += u
        squares += u * u
        largest = max(largest, u)
        if not leaves:
            if x != x_start or u != u_start:
                return 0, 0.0, 0, 0.0, 0.0, 0.0
            return impacts, n, 1, total, squares, largest
    return impacts, n, 0, total, squares, largest


@jit
def _count_cycle(s: Floats, j: int, realization: int, reflect: int | None, rests: Rests) -> None:
    """Note the totals of the cycle that lane j has entered."""
    x_lift, u_lift = s[X_LIFT + j], s[U_LIFT + j]
    fixed = (s[E + j], s[A + j], s[R + j], x_lift, 0.0, u_lift)
    p, q, rested, total, squares, largest = 0, 0.0, 0, 0.0, 0.0, 0.0
    if s[RESTS + j] == s[RESTS_ANCHOR + j]:  # no rest is known on the way
        p, q, rested, total, squares, largest = once_round(fixed, s[X + j], s[U + j], reflect)
    if p == 0 or rested > 0:
        row = realization % ROOM_FOR_RESTS
        if rests[row, WHOSE] != realization:
            p, q, _, total, squares, largest = once_round(fixed, x_lift, u_lift, reflect)
            rests[row, 0], rests[row, 1] = p, q
            rests[row, 2], rests[row, 3], rests[row, 4] = total, squares, largest
            rests[row, WHOSE] = realization
        rested = 1
        p, q = int(rests[row, 0]), rests[row, 1]
        total, squares, largest = rests[row, 2], rests[row, 3], rests[row, 4]
    s[C_IMPACTS + j], s[C_PERIODS + j], s[C_RESTS + j] = p, q, rested
    s[C_SUM + j], s[C_SQUARES + j], s[C_LARGEST + j] = total, squares, largest


@jit
def _jump(s: Floats, j: int, window: int | None) -> bool:
    """Pass over whole cycles of lane j; return whether they were the last ones.

    The landings that are passed over are all inside the window, or all before it.
    """
    periods = s[C_PERIODS + j]
    n, x = s[N + j], s[X + j]
    if window is not None:
        begin = s[N_BEGIN + j] - n + (s[X_BEGIN + j] - x)
        if begin > -MARGIN:
            times = np.floor((begin - MARGIN) / periods)
            s[N + j] = n + max(0.0, times) * periods
            s[N_ANCHOR + j] = s[N + j]  # where it returns, and is looked at again
            return False
    times = max(0.0, np.floor(((s[X_END + j] - x) - n - MARGIN) / periods))
    s[N + j] = n + times * periods
    s[LANDINGS + j] += times * s[C_IMPACTS + j]
    s[RESTS + j] += times * s[C_RESTS + j]
    s[SUM + j] += times * s[C_SUM + j]
    s[SQUARES + j] += times * s[C_SQUARES + j]
    s[LARGEST + j] = max(s[LARGEST + j], s[C_LARGEST + j] if times > 0.0 else 0.0)
    return True


@jit
def has_returned(s: Floats, j: int) -> bool:
    """Whether the state of lane j is that of its anchor, at a later time."""
    same = s[X + j] == s[X_ANCHOR + j] and s[U + j] == s[U_ANCHOR + j]
    return bool(same and s[N + j] > s[N_ANCHOR + j])


@jit
def forget_anchor(s: Floats, j: int) -> None:
    """Look no more for a cycle of lane j."""
    s[X_ANCHOR + j] = np.nan
    s[NEXT_ANCHOR + j] = np.inf


@jit
def saves_work(s: Floats, j: int, jump: int) -> bool:
    """Whether the cycle of lane j, whose state has returned, may and should be passed over."""
    since = s[N + j] - s[N_ANCHOR + j]
    return bool(jump == 1 and since > 0.0 and -s[N + j] > WORTH * since)


@jit
def close_cycle(
    s: Floats,
    j: int,
    realization: int,
    reflect: int | None,
    window: int | None,
    jump: int,
    cycles: Cycles,
    rests: Rests,
) -> None:
    """Find the cycle of lane j, whose state has returned, and pass over it where that saves work.

    Parameters
    ----------
    s, j, realization
        Scratch memory, lane, and which realization it is of.
    reflect, window
        As in `vibrosweep.kernels.advance.advance`.
    jump
        1 where cycles are to be passed over.
    cycles
        Where the cycle is noted, if none has been.
    rests
        From `empty_rests`.
    """
    age, state = s[AGE + j], (s[N + j], s[X + j], s[U + j])
    since = s[N + j] - s[N_ANCHOR + j]
    rested = s[RESTS + j] - s[RESTS_ANCHOR + j]
    last, jumps = True, saves_work(s, j, jump)
    if window is None and rested > 0.0 and not jumps:
        # from rest to rest there is but one orbit, so many times since the anchor
        impacts = age - 0.5 * s[NEXT_ANCHOR + j]
        found = impacts / rested, since / rested, 1.0
    else:
        if s[C_IMPACTS + j] == 0.0:
            _count_cycle(s, j, realization, reflect, rests)
        found = s[C_IMPACTS + j], s[C_PERIODS + j], s[C_RESTS + j]
        if jumps:
            last = _jump(s, j, window)
            if last:
                s[AGE + j] = -np.inf  # what is left is less than a cycle
    lane = int(s[LANE + j])
    if cycles[CYCLE_IMPACTS, lane] == 0.0:
        _note(cycles, lane, found, state, age)
    s[NEXT_ANCHOR + j] = np.inf
    if last:
        forget_anchor(s, j)
