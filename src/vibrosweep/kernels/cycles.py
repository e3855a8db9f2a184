"""Orbits that repeat: the rest of a trajectory counted from one cycle instead of followed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, Integers, jit
from vibrosweep.kernels.impact import land, lift_off, rebound
from vibrosweep.kernels.lanes import (
    LANDINGS,
    LANE,
    LARGEST,
    N_ANCHOR,
    N_BEGIN,
    RESTS,
    SQUARES,
    SUM,
    U_LIFT,
    WAIT,
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

__all__ = ["SAME", "Cycles", "close_cycle", "empty_cycles"]

SAME = 2.0**-40  # periods


class Cycles(NamedTuple):
    """Cycles that trajectories have entered, each array of shape (trajectory,).

    Attributes
    ----------
    impacts, periods, rests
        Impacts, forcing periods and rests in one cycle; 0 where no recurrence was found.  Rounding
        lets an orbit alternate between neighbouring numbers: states closer than `SAME` are one.
    begin
        When it had been entered at the latest: whole periods from the end's, plus the phase; NaN
        without.
    """

    impacts: Integers
    periods: Integers
    rests: Integers
    begin: Floats


def empty_cycles(trajectories: int) -> Cycles:
    """Room for the cycles of a batch."""
    impacts, periods, rests = (np.empty(trajectories, np.int64) for _ in range(3))
    return Cycles(impacts, periods, rests, np.empty(trajectories))


@jit
def _occurrences(first: float, last: float, period: float) -> float:
    """Count the members of first, first + period, ... up to last; all are whole numbers."""
    # below 2**53 the quotient is never rounded across a whole number
    times: float = np.floor((last - first) / period) + 1.0
    return max(0.0, times)


@jit
def _impact(
    s: Floats, j: int, n: float, x: float, u: float, reflect: int | None
) -> tuple[float, float, float, float, float, bool]:
    """Landing and lift-off of lane j after a flight u from (n, x)."""
    x, passed = land(x, u)
    n += passed
    w = rebound(x, u, s[E + j], s[A + j], reflect)
    n_off, x_off, u, leaves = lift_off(n, x, w, s[R + j], s[X_LIFT + j], s[WAIT + j], s[U_LIFT + j])
    return n, x, n_off, x_off, u, leaves


@jit
def _cycle(s: Floats, j: int, reflect: int | None) -> tuple[int, int, float]:
    """Impacts, rests and forcing periods of the cycle that lane j has entered."""
    x, n, u = s[X + j], s[N + j], s[U + j]
    impacts, rests = 0, 0
    while impacts == 0 or x != s[X + j] or u != s[U + j]:
        _, _, n, x, u, leaves = _impact(s, j, n, x, u, reflect)
        impacts += 1
        rests += 0 if leaves else 1
    return impacts, rests, n - s[N + j]


@jit
def _repeats(
    s: Floats, j: int, reflect: int | None, impacts: int, shorter: int
) -> tuple[bool, float]:
    """Whether a cycle of lane j is, up to rounding, a shorter one; and that one's periods."""
    x, n, u = s[X + j], s[N + j], s[U + j]
    ahead_x, ahead_n, ahead_u = x, n, u
    for _ in range(shorter):
        _, _, ahead_n, ahead_x, ahead_u, _ = _impact(s, j, ahead_n, ahead_x, ahead_u, reflect)
    periods = np.rint((ahead_n - n) + (ahead_x - x))
    for _ in range(impacts):
        apart = (ahead_n - n - periods) + (ahead_x - x)
        if abs(apart) > SAME or abs(ahead_u - u) > SAME:
            return False, periods
        _, _, n, x, u, _ = _impact(s, j, n, x, u, reflect)
        _, _, ahead_n, ahead_x, ahead_u, _ = _impact(s, j, ahead_n, ahead_x, ahead_u, reflect)
    return True, periods


@jit
def close_cycle(s: Floats, j: int, reflect: int | None, window: int | None, cycles: Cycles) -> None:
    """Count each landing of the cycle that lane j has entered as often as it recurs.

    The landing decided by n <= x_end - x is decided by n <= floor(x_end - x), for n is whole: the
    number of landings is the one that going on would find.
    """
    lane = int(s[LANE + j])
    impacts, rests, period = _cycle(s, j, reflect)
    x, n, u = s[X + j], s[N + j], s[U + j]
    for _ in range(impacts):
        landed_n, landed_x, n, x, u, leaves = _impact(s, j, n, x, u, reflect)
        times = _occurrences(landed_n, np.floor(s[X_END + j] - landed_x), period)
        if window is not None:
            early = s[N_BEGIN + j] - np.floor(landed_x - s[X_BEGIN + j]) - 1.0
            times -= _occurrences(landed_n, early, period)
        s[LANDINGS + j] += times
        s[RESTS + j] += 0.0 if leaves else times
        s[SUM + j] += times * u
        s[SQUARES + j] += times * (u * u)
        s[LARGEST + j] = max(s[LARGEST + j], u if times > 0.0 else 0.0)
    cycles.impacts[lane], cycles.rests[lane], cycles.periods[lane] = impacts, rests, int(period)
    for shorter in range(1, impacts // 2 + 1):
        if impacts % shorter == 0:
            same, period = _repeats(s, j, reflect, impacts, shorter)
            if same:
                cycles.impacts[lane], cycles.periods[lane] = shorter, int(period)
                cycles.rests[lane] = rests * shorter // impacts
                break
    cycles.begin[lane] = s[N_ANCHOR + j] + s[X_ANCHOR + j]
