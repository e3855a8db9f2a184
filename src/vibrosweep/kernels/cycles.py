"""Orbits that repeat: the rest of a trajectory counted from one cycle instead of followed.

A contracting orbit returns, in floating point, to the very same state (x, u); from there on it is
known for all time.  A lane remembers an earlier state, its anchor, at ages that double (Brent
1980), and compares with it when it is looked at anyway.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, Integers, jit, kernel
from vibrosweep.kernels.impact import Scene, impact, scene
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
from vibrosweep.scene import Dimensionless

__all__ = [
    "SAME",
    "Cycles",
    "Rests",
    "empty_cycles",
    "empty_rests",
    "look",
    "no_cycle",
    "once_round",
    "repeats",
    "shorten",
]

# Periods.  Near the loss of stability a cycle wanders by rounding over 1 - |multiplier|; distinct
# points of one cycle are never this close, unless it has just split.
SAME = 2.0**-30
# A cycle is worth its finding where so many times the time since the anchor remains.
WORTH = 4.0
# Instants of the window that rounding might decide are left to be followed.
MARGIN = 2.0**-20  # periods

Totals = tuple[int, float, int, float, float, float]  # impacts, periods, rests and of the flights


class Cycles(NamedTuple):
    """Cycles that trajectories have entered, each array of shape (trajectory,).

    Attributes
    ----------
    impacts, periods, rests
        Impacts, forcing periods and rests until the same bits return; 0 where no recurrence was
        found.
    whole, phase, flight
        A state on the cycle: whole periods from the end's, phase and flight time.
    age
        Impacts from the launch until that state.
    """

    impacts: Integers
    periods: Integers
    rests: Integers
    whole: Floats
    phase: Floats
    flight: Floats
    age: Integers


def empty_cycles(trajectories: int) -> Cycles:
    """Room for the cycles of a batch."""
    impacts, periods, rests, age = (np.empty(trajectories, np.int64) for _ in range(4))
    whole, phase, flight = (np.empty(trajectories) for _ in range(3))
    return Cycles(impacts, periods, rests, whole, phase, flight, age)


@jit
def no_cycle(cycles: Cycles, lane: int) -> None:
    """Note that trajectory `lane` has not been seen to recur."""
    cycles.impacts[lane], cycles.periods[lane], cycles.rests[lane] = 0, 0, 0
    cycles.whole[lane] = cycles.phase[lane] = np.nan


class Rests(NamedTuple):
    """The orbit from one rest to the next, which all rested particles of a realization share.

    Arrays of shape (realization,): `impacts` is 0 until it is known; `flights`, of shape
    (realization, 3), holds sum, sum of squares and maximum of the flight time.
    """

    impacts: Integers
    periods: Floats
    flights: Floats


def empty_rests(realizations: int) -> Rests:
    """Memory for so many realizations, of which nothing is known."""
    return Rests(
        np.zeros(realizations, np.int64), np.zeros(realizations), np.zeros((realizations, 3))
    )


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
def _count_cycle(s: Floats, j: int, place: int, reflect: int | None, rests: Rests) -> None:
    """Note the totals of the cycle that lane j has entered; `place` is that of its realization."""
    x_lift, u_lift = s[X_LIFT + j], s[U_LIFT + j]
    fixed = (s[E + j], s[A + j], s[R + j], x_lift, 0.0, u_lift)
    p, q, rested, total, squares, largest = once_round(fixed, s[X + j], s[U + j], reflect)
    if p == 0 or rested > 0:
        if rests.impacts[place] == 0:
            p, q, _, total, squares, largest = once_round(fixed, x_lift, u_lift, reflect)
            rests.impacts[place], rests.periods[place] = p, q
            flights = rests.flights[place]
            flights[0], flights[1], flights[2] = total, squares, largest
        rested = 1
        p, q = rests.impacts[place], rests.periods[place]
        flights = rests.flights[place]
        total, squares, largest = flights[0], flights[1], flights[2]
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
def look(
    s: Floats,
    j: int,
    place: int,
    reflect: int | None,
    window: int | None,
    all_of_them: int,
    jump: int,
    rests: Rests,
    cycles: Cycles,
) -> None:
    """Look at lane j, whose state has returned to its anchor or which is to take a new one.

    Parameters
    ----------
    s, j, place
        Scratch memory, lane, and place of its realization in `rests`.
    reflect, window
        As in `vibrosweep.kernels.advance.advance`.
    all_of_them
        1 where cycles are asked for, else only those are found that save work.
    jump
        1 where cycles are to be passed over.
    rests : Rests
        Of the realizations at hand.
    cycles : Cycles
        Where the cycle is written.
    """
    n, x, u = s[N + j], s[X + j], s[U + j]
    if x == s[X_ANCHOR + j] and u == s[U_ANCHOR + j] and n > s[N_ANCHOR + j]:
        last = True
        if all_of_them or -n > WORTH * (n - s[N_ANCHOR + j]):
            if s[C_IMPACTS + j] == 0.0:
                _count_cycle(s, j, place, reflect, rests)
            lane = int(s[LANE + j])
            if cycles.impacts[lane] == 0:
                cycles.impacts[lane] = int(s[C_IMPACTS + j])
                cycles.periods[lane] = int(s[C_PERIODS + j])
                cycles.rests[lane], cycles.age[lane] = int(s[C_RESTS + j]), int(s[AGE + j])
                cycles.whole[lane], cycles.phase[lane], cycles.flight[lane] = n, x, u
            if jump:
                last = _jump(s, j, window)
                if last:
                    s[AGE + j] = -np.inf  # what is left is less than a cycle
        s[NEXT_ANCHOR + j] = np.inf
        if last:
            s[X_ANCHOR + j] = np.nan
    elif s[AGE + j] >= s[NEXT_ANCHOR + j]:
        s[X_ANCHOR + j], s[N_ANCHOR + j], s[U_ANCHOR + j] = x, n, u
        s[NEXT_ANCHOR + j] = 2.0 * s[AGE + j]


@jit
def repeats(
    fixed: Scene, x: float, u: float, reflect: int | None, impacts: int, shorter: int
) -> int:
    """Periods of the shorter cycle that a cycle is up to rounding; 0 if it is none."""
    n = ahead_n = 0.0
    ahead_x, ahead_u = x, u
    for _ in range(shorter):
        _, _, ahead_n, ahead_x, ahead_u, _ = impact(fixed, ahead_n, ahead_x, ahead_u, reflect)
    periods = np.rint(ahead_n + (ahead_x - x))
    for _ in range(impacts):
        apart = (ahead_n - n - periods) + (ahead_x - x)
        if abs(apart) > SAME or abs(ahead_u - u) > SAME:
            return 0
        _, _, n, x, u, _ = impact(fixed, n, x, u, reflect)
        _, _, ahead_n, ahead_x, ahead_u, _ = impact(fixed, ahead_n, ahead_x, ahead_u, reflect)
    return int(periods)


@kernel
def shorten(
    first: int,
    last: int,
    problem: Dimensionless,
    particles: int,
    reflect: int | None,
    cycles: Cycles,
    impacts: Integers,
    periods: Integers,
) -> None:
    """Cycles of trajectories first ... last - 1 with states closer than `SAME` taken as one.

    Rounding lets an orbit alternate between neighbouring numbers; the cycle of its bits is then a
    multiple of the orbit's.  One with a rest never is: a rest sets the state exactly.

    Parameters
    ----------
    first, last
        Range of trajectories; trajectory t is particle t % N of realization t // N.
    problem : vibrosweep.scene.Dimensionless
    particles
        N.
    reflect
        None, or 1 for the `reflect` law; chosen at compile time.
    cycles : Cycles
        As they were found.
    impacts, periods
        Written: of the shortest cycle; 0 where there is none.
    """
    for t in range(first, last):
        impacts[t], periods[t] = cycles.impacts[t], cycles.periods[t]
        if cycles.rests[t] > 0:
            continue
        fixed = scene(problem, t // particles)
        x, u = cycles.phase[t], cycles.flight[t]
        for shorter in range(1, cycles.impacts[t] // 2 + 1):
            if cycles.impacts[t] % shorter == 0:
                found = repeats(fixed, x, u, reflect, cycles.impacts[t], shorter)
                if found > 0:
                    impacts[t], periods[t] = shorter, found
                    break
