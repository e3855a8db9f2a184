"""Flights between two given instants: speeds at both ends, derivatives, and least clearance."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import generic, implements, jit
from vibrosweep.kernels.bases import Constants as AnyConstants
from vibrosweep.kernels.bases import Flight, jacobian, moving, shaped
from vibrosweep.kernels.bases.high_bounce import HighBounceConstants
from vibrosweep.kernels.bases.moving import ANY, SINGLE, MovingConstants, ShapedConstants, begin_at
from vibrosweep.kernels.bases.moving_errors import along
from vibrosweep.kernels.restitution import slope
from vibrosweep.kernels.waveforms import next_phase

HALVINGS = 30  # the error of a minimum is of the order of the square of the last interval


@generic
def chord(fixed: AnyConstants, x: float, s: float) -> tuple[float, float]:
    """Speeds relative to the base of a flight of s periods, s > 0, at its phase x and at its end.

    The particle may meet the base on the way.
    """


@implements(chord, HighBounceConstants)
def chord_high_bounce(fixed: HighBounceConstants, x: float, s: float) -> tuple[float, float]:
    return s, s


@generic
def height(fixed: AnyConstants, x: float, y: float, s: float) -> tuple[float, float]:
    """Height above a base that moves, and its derivative, s periods after leaving it."""


@implements(height, MovingConstants)
def height_moving(fixed: MovingConstants, x: float, y: float, s: float) -> tuple[float, float]:
    clear = moving.clearance(fixed, begin_at(x, y), s, *moving.turn(s))
    return clear.f, clear.f1


@implements(height, ShapedConstants)
def height_shaped(fixed: ShapedConstants, x: float, y: float, s: float) -> tuple[float, float]:
    clear = shaped.clearance(fixed, begin_at(x, y), s, *shaped.turn(s))
    return clear.f, clear.f1


@implements(chord, *ANY)
def chord_moving(fixed: AnyConstants, x: float, s: float) -> tuple[float, float]:
    # the height is linear in the speed of lift-off: s y / 2 is added to that of y = 0
    f, f1 = height(fixed, x, 0.0, s)
    y = -2.0 * f / s
    return y, -2.0 * f1 - y


class Slopes(NamedTuple):
    """Jacobian of an impact and its determinant, times a scale that makes all of them finite.

    Over a base that moves the Jacobian is infinite where the speed of arrival is 0.
    """

    scale: float  # 1, or the speed of arrival
    # xx, xu, ux, uu: of phase and speed after the impact, by those before its flight
    xx: float
    xu: float
    ux: float
    uu: float
    determinant: float


@generic
def slopes(fixed: AnyConstants, arc: Flight) -> Slopes:
    """Jacobian of the impact that ends a flight, also where the speed of arrival is 0."""


@implements(slopes, HighBounceConstants)
def slopes_high_bounce(fixed: HighBounceConstants, arc: Flight) -> Slopes:
    xx, xu, ux, uu, _ = jacobian(fixed, arc)
    return Slopes(1.0, xx, xu, ux, uu, uu - ux)


@implements(slopes, *ANY)
def slopes_moving(fixed: AnyConstants, arc: Flight) -> Slopes:
    # as in `jacobian_moving`, without its divisions by the speed of arrival
    s, z = arc.time, arc.v
    q, at = slope(fixed.base.restitution, fixed.e, fixed.scale, z), along(fixed, arc.x, arc.u, s)
    pull, lost = 2.0 * (1.0 + at.acceleration), 2.0 * at.lost
    ux, uu = q * (pull * at.by_x - lost * z), q * (pull * s - z)
    return Slopes(z, z + at.by_x, s, ux, uu, q * arc.u)


@generic
def clearing(fixed: AnyConstants, arc: Flight) -> float:
    """Least local minimum of the height above the base in a flight; infinite if there is none."""


@implements(clearing, HighBounceConstants)
def clearing_high_bounce(fixed: HighBounceConstants, arc: Flight) -> float:
    return math.inf


@jit
def _least(fixed: AnyConstants, arc: Flight, fall: float, length: float) -> float:
    """Least local minimum in the stretches of a flight in which the base falls faster than gravity.

    They begin at phase `fall`, NaN if there are none.  The height is convex there and concave
    elsewhere: each has one minimum or none, and so has no other time.  Where a flight begins or
    ends in a stretch, it rises from the base or falls onto it, without a minimum.
    """
    least, low = math.inf, fall - arc.x
    low -= np.floor(low)  # unlike math.floor, of NaN too
    while low + length < arc.time:
        first, last = low, low + length
        if height(fixed, arc.x, arc.u, first)[1] < 0.0 < height(fixed, arc.x, arc.u, last)[1]:
            for _ in range(HALVINGS):
                middle = 0.5 * (first + last)
                if height(fixed, arc.x, arc.u, middle)[1] > 0.0:
                    last = middle
                else:
                    first = middle
            least = min(least, height(fixed, arc.x, arc.u, first)[0])
        low += 1.0
    return least


@implements(clearing, *SINGLE)
def clearing_single(fixed: AnyConstants, arc: Flight) -> float:
    return _least(fixed, arc, fixed.x_lift, 1.0 - 2.0 * fixed.x_lift)


@implements(clearing, ShapedConstants)
def clearing_shaped(fixed: ShapedConstants, arc: Flight) -> float:
    least = math.inf
    for k in range(len(fixed.falls)):
        press, passed = next_phase(fixed.presses, fixed.falls[k])
        least = min(least, _least(fixed, arc, fixed.falls[k], press - fixed.falls[k] + passed))
    return least
