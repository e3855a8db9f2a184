"""Flights between two given instants: speeds at both ends, and least clearance above the base."""

from __future__ import annotations

import math

from vibrosweep.kernels._jit import generic, implements
from vibrosweep.kernels.bases import Constants as AnyConstants
from vibrosweep.kernels.bases import Flight, landing_search, shaped_search
from vibrosweep.kernels.bases.high_bounce import Constants
from vibrosweep.kernels.bases.landing_search import begin_at
from vibrosweep.kernels.bases.moving import ANY, MovingConstants, ShapedConstants

PIECES = 32  # of a period, in each of which one minimum of the height is searched for
HALVINGS = 40  # the error of a minimum is of the order of the square of the last interval


@generic
def chord(fixed: AnyConstants, x: float, s: float) -> tuple[float, float]:
    """Speeds relative to the base of a flight of s periods, s > 0, at its phase x and at its end.

    The particle may meet the base on the way.
    """


@implements(chord, Constants)
def chord_high_bounce(fixed: Constants, x: float, s: float) -> tuple[float, float]:
    return s, s


@generic
def height(fixed: AnyConstants, x: float, y: float, s: float) -> tuple[float, float]:
    """Height above a base that moves, and its derivative, s periods after leaving it."""


@implements(height, MovingConstants)
def height_moving(fixed: MovingConstants, x: float, y: float, s: float) -> tuple[float, float]:
    clear = landing_search.clearance(fixed, begin_at(x, y), s, *landing_search.turn(s))
    return clear.f, clear.f1


@implements(height, ShapedConstants)
def height_shaped(fixed: ShapedConstants, x: float, y: float, s: float) -> tuple[float, float]:
    clear = shaped_search.clearance(fixed, begin_at(x, y), s, *shaped_search.turn(s))
    return clear.f, clear.f1


@implements(chord, *ANY)
def chord_moving(fixed: AnyConstants, x: float, s: float) -> tuple[float, float]:
    # the height is linear in the speed of lift-off: s y / 2 is added to that of y = 0
    f, f1 = height(fixed, x, 0.0, s)
    y = -2.0 * f / s
    return y, -2.0 * f1 - y


@generic
def clearing(fixed: AnyConstants, arc: Flight) -> float:
    """Least local minimum of the height above the base in a flight; infinite if there is none."""


@implements(clearing, Constants)
def clearing_high_bounce(fixed: Constants, arc: Flight) -> float:
    return math.inf


@implements(clearing, *ANY)
def clearing_moving(fixed: AnyConstants, arc: Flight) -> float:
    pieces = math.ceil(PIECES * arc.time)
    least, before, falls = math.inf, 0.0, False
    for k in range(1, pieces):
        time = arc.time * k / pieces
        rises = height(fixed, arc.x, arc.u, time)[1] > 0.0
        if rises and falls:
            low, high = before, time
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                if height(fixed, arc.x, arc.u, middle)[1] > 0.0:
                    high = middle
                else:
                    low = middle
            least = min(least, height(fixed, arc.x, arc.u, low)[0])
        before, falls = time, not rises
    return least
