"""Flights between two given instants: speeds at both ends, and how closely they pass the base."""

from __future__ import annotations

import math

from vibrosweep.kernels._jit import generic, implements
from vibrosweep.kernels.bases import Constants as AnyConstants
from vibrosweep.kernels.bases import Flight
from vibrosweep.kernels.bases.high_bounce import Constants
from vibrosweep.kernels.bases.landing_search import clearance, start, turn
from vibrosweep.kernels.bases.moving import MovingConstants

PIECES = 32  # of a period, between the ends of which one minimum of a height is looked for
HALVINGS = 40  # the height at a minimum is off by the square of what is left


@generic
def chord(fixed: AnyConstants, x: float, s: float) -> tuple[float, float]:
    """Speeds relative to the base of a flight of s periods, s > 0, at its phase x and at its end.

    Whether the particle meets the base on the way is not asked.
    """


@implements(chord, Constants)
def chord_high_bounce(fixed: Constants, x: float, s: float) -> tuple[float, float]:
    return s, s


@implements(chord, MovingConstants)
def chord_moving(fixed: MovingConstants, x: float, s: float) -> tuple[float, float]:
    # the clearance is linear in the speed of lift-off: s y / 2 is added to that of y = 0
    clear = clearance(start(fixed.alpha, fixed.x_lift, x, 0.0), s, *turn(s))
    y = -2.0 * clear.f / s
    return y, -2.0 * clear.f1 - y


@generic
def clearing(fixed: AnyConstants, one: Flight) -> float:
    """Least height above the base, of a minimum within a flight; infinite without any."""


@implements(clearing, Constants)
def clearing_high_bounce(fixed: Constants, one: Flight) -> float:
    return math.inf


@implements(clearing, MovingConstants)
def clearing_moving(fixed: MovingConstants, one: Flight) -> float:
    # without a phase at which the base falls faster than gravity the height is concave
    if math.isnan(fixed.x_lift):
        return math.inf
    begin = start(fixed.alpha, fixed.x_lift, one.x, one.u)
    pieces = math.ceil(PIECES * one.time)
    least, before, falls = math.inf, 0.0, False
    for k in range(1, pieces):
        time = one.time * k / pieces
        rises = clearance(begin, time, *turn(time)).f1 > 0.0
        if rises and falls:
            low, high = before, time
            for _ in range(HALVINGS):
                time = 0.5 * (low + high)
                if clearance(begin, time, *turn(time)).f1 > 0.0:
                    high = time
                else:
                    low = time
            least = min(least, clearance(begin, low, *turn(low)).f)
            time = high
        before, falls = time, not rises
    return least
