"""Flights between two given instants: the speeds that they begin and end with."""

from __future__ import annotations

from vibrosweep.kernels._jit import generic, implements
from vibrosweep.kernels.bases import Constants as AnyConstants
from vibrosweep.kernels.bases.high_bounce import Constants
from vibrosweep.kernels.bases.landing_search import clearance, start, turn
from vibrosweep.kernels.bases.moving import MovingConstants


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
