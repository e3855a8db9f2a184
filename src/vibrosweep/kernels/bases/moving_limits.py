"""Bounds of the motion of a base."""

from __future__ import annotations

import math
from typing import NamedTuple

from vibrosweep.kernels._jit import generic, implements
from vibrosweep.kernels.bases import Constants, Flight
from vibrosweep.kernels.bases.moving import SINGLE, MovingConstants, ShapedConstants
from vibrosweep.kernels.bases.shaped_search import at_phase, stretch
from vibrosweep.kernels.sine import COSINE_ERROR, cos_turns, sin_turns
from vibrosweep.model.shapes import TWO_PI

SURE = 1.0 + 2.0**-30  # factor for the rounding of compared numbers
AT_LIFT_OFF = 2.0**-48  # turns; this near to the phase of lift-off the base counts as falling
UPWARDS = 1.0 + 2.0**-30  # factor for the rounding of extremes of a shape


class Limits(NamedTuple):
    """Bounds of the acceleration G of a base, in units of gravity, and of its velocity."""

    # steep, fall: of |G|, and of -G
    steep: float
    fall: float
    speed: float  # of the velocity, times pi
    angle: float  # of |G'| relative to that of |G|, and so on for each further derivative
    # rounding, slope_rounding: of errors of velocity and G, beyond a few roundings of their values
    rounding: float
    slope_rounding: float


@generic
def limits(fixed: Constants, slack: float) -> Limits:
    """Bound the motion of the base for alpha times the factor `slack`."""


class Bends(NamedTuple):
    """Bounds of changes of the derivatives of a flight, in the notation of `moving_jacobian`.

    They are those of P, of 2 G(x + s), and of 2 (G(x) - G(x + s)).
    """

    of_p: float
    of_pull: float
    of_lost: float


@generic
def bends(fixed: Constants, flight: Flight, dx: float, off: float) -> Bends:
    """Bound changes within dx of the phase of a lift-off and `off` of the duration."""


@generic
def keeps_pressing(fixed: Constants, x: float, pull: float, error: float) -> bool:
    """Return whether a base with 1 + G >= pull at x presses at every phase within an error of x."""


@generic
def below_top(fixed: Constants, x: float, dx: float, slack: float) -> float:
    """Bound of the depth below the top of the base at phases within dx of x.

    The depth is given as pi^2 times the square of the speed with which a particle just reaches the
    top; alpha is enlarged by the factor `slack`.
    """


@generic
def first_stretch(fixed: Constants, x: float) -> tuple[bool, float]:
    """Return whether the base falls faster than gravity at x, and periods until that changes."""


@implements(limits, MovingConstants)
def limits_moving(fixed: MovingConstants, slack: float) -> Limits:
    gamma = math.pi * (fixed.alpha * slack)
    return Limits(gamma, gamma, gamma, TWO_PI, 0.0, 0.0)


@implements(limits, ShapedConstants)
def limits_shaped(fixed: ShapedConstants, slack: float) -> Limits:
    shape, alpha = fixed.base.waveform, fixed.alpha * slack * UPWARDS
    half = 0.5 * alpha
    return Limits(
        half * shape.steepest,
        half * shape.fall,
        math.pi * alpha * shape.fastest,
        TWO_PI * len(shape.p),
        alpha * shape.rounding,
        half * shape.slope_rounding,
    )


@implements(below_top, MovingConstants)
def below_top_moving(fixed: MovingConstants, x: float, dx: float, slack: float) -> float:
    gamma = math.pi * (fixed.alpha * slack)
    return 2.0 * gamma * (1.0 + cos_turns(x) + TWO_PI * dx + COSINE_ERROR)


@implements(below_top, ShapedConstants)
def below_top_shaped(fixed: ShapedConstants, x: float, dx: float, slack: float) -> float:
    shape = fixed.base.waveform
    _, _, level = at_phase(shape, sin_turns(x), cos_turns(x))
    below = (shape.top - level) + shape.fastest * UPWARDS * dx + 2.0 * shape.rounding
    return 4.0 * math.pi * math.pi * (fixed.alpha * slack) * below


@implements(bends, MovingConstants, ShapedConstants)
def bends_smooth(fixed: Constants, flight: Flight, dx: float, off: float) -> Bends:
    limit = limits(fixed, 1.0)
    gamma, angle = limit.steep, limit.angle
    q = angle * (flight.time + off)
    turns = min(2.0, q)
    return Bends(
        2.0 * gamma * (turns * off + min(q + turns, 0.5 * q * q) * dx),
        2.0 * angle * gamma * (dx + off),
        2.0 * angle * gamma * (off + turns * dx),
    )


@implements(keeps_pressing, MovingConstants, ShapedConstants)
def keeps_pressing_smooth(fixed: Constants, x: float, pull: float, error: float) -> bool:
    limit = limits(fixed, 1.0)
    return 2.0 * limit.angle * limit.steep * SURE * error <= pull


@implements(first_stretch, *SINGLE)
def first_stretch_moving(fixed: MovingConstants, x: float) -> tuple[bool, float]:
    falls = abs(x) >= fixed.x_lift
    to_press = (1.0 if x > 0.0 else 0.0) - fixed.x_lift - x
    return falls, to_press if falls else fixed.x_lift - x


@implements(first_stretch, ShapedConstants)
def first_stretch_shaped(fixed: ShapedConstants, x: float) -> tuple[bool, float]:
    _, to_fall, to_press = stretch(fixed, x)
    falls = to_press < to_fall or to_fall <= AT_LIFT_OFF
    return falls, to_press if falls else to_fall
