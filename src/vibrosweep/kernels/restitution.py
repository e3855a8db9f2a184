"""Laws of rebound and of restitution: the speed after an impact as a function of that before it.

A law is a named tuple, whose type numba knows when it compiles.  It is empty, or has numbers that
all realizations share.  Speeds are the durations of the flights that they begin, in forcing
periods.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from fractions import Fraction
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit, types

from vibrosweep.kernels import arithmetic
from vibrosweep.kernels._jit import (
    OPTIONS,
    compiled_anew,
    fma,
    generic,
    implements,
    jit,
    kind_named,
    require_compilable,
)
from vibrosweep.kernels.arithmetic import HALF_ULP, KICK_ERROR
from vibrosweep.model.restitution_laws import (
    CONSTANT,
    OUTSIDE,
    PADE,
    PLASTIC,
    POWER,
    VISCOELASTIC,
    lines_of,
    name_of,
    numbers_of,
)
from vibrosweep.model.restitution_laws import Law as OutsideLaw

# --- Laws of rebound ------------------------------------------------------------------------------
# The speed after an impact, from the retained share of the arrival speed, and the kick.  A new law
# needs a class with its implementations here, and its name here and in
# `vibrosweep.model.parameters.LAWS_OF`.


Law = Any


@generic
def speed_after(law: Law, share: float, v: float, kick: float) -> float:
    """Speed after an impact at speed v, of which a share is retained.

    A particle rests if this speed does not exceed the threshold.
    """


@generic
def direction(law: Law, w: float) -> float:
    """Return -1 if a law reverses the speed w, else 1."""


class Rest(NamedTuple):
    """A particle whose rebound points into the base stays on it."""


implements(speed_after, Rest)(lambda law, share, v, kick: fma(share, v, kick))
implements(direction, Rest)(lambda law, w: 1.0)


class Reflect(NamedTuple):
    """A rebound that points into the base is reversed, as in the Fermi accelerator."""


implements(speed_after, Reflect)(lambda law, share, v, kick: abs(fma(share, v, kick)))
implements(direction, Reflect)(lambda law, w: -1.0 if w < 0.0 else 1.0)


REBOUND_OF: Final[Mapping[str, Law]] = {"rest": Rest(), "reflect": Reflect()}


# --- Laws of restitution --------------------------------------------------------------------------
# The coefficient of restitution as a function of the speed of an impact.  An impact at the relative
# speed v leaves the speed E(v) = e(v) v, with the slope q(v) = E'(v).  `scale_of` combines the
# restitution e and the speed of a law into one number, by which the law scales speeds.


Restitution = Any


@generic
def scale_of(law: Restitution, e: float, speed: float) -> float:
    """Number by which a law scales speeds, from its restitution and its speed."""


@generic
def ratio(law: Restitution, e: float, scale: float, v: float) -> float:
    """Coefficient of restitution e(v) of an impact at speed v."""


@generic
def slope(law: Restitution, e: float, scale: float, v: float) -> float:
    """Derivative q(v) of the speed that an impact at speed v leaves."""


@generic
def slope_range(
    law: Restitution, e: float, scale: float, low: float, high: float
) -> tuple[float, float]:
    """Bounds of the slope over the speeds from `low` to `high`."""


@generic
def ratio_error(law: Restitution, e: float, scale: float, v: float) -> float:
    """Bound of the relative error of e(v), for an exact speed v."""


@generic
def is_constant(law: Restitution) -> bool:
    """Return whether the coefficient of restitution does not depend on the speed."""


@generic
def slack(law: Restitution) -> float:
    """Rounding error of a slope, in units of that of a component of a Jacobian."""


@generic
def lost_speed(law: Restitution, e: float, scale: float, v: float, sign: float) -> float:
    """Return sign v - E(v), the kick that compensates for an impact at speed v."""


@generic
def arrival_to_repeat(law: Restitution, e: float, scale: float, k: float) -> float:
    """Speed c of an impact with c + E(c) = 2 k: relative to a base that rises with c - k."""


@generic
def leaving_to_repeat(law: Restitution, e: float, scale: float, k: float) -> float:
    """Return E(c), of the speed c of `arrival_to_repeat`."""


@generic
def rise_to_repeat(law: Restitution, e: float, scale: float, k: float) -> float:
    """Return (1 + e)(c - k), with the speed c of `arrival_to_repeat`."""


@jit
def slope_change(
    law: Restitution, e: float, scale: float, v: float, error: float
) -> tuple[float, float]:
    """Slope at speed v, and how much it changes within an error of the speed.

    By the mean value theorem, the second number times the error bounds the nonlinear remainder.
    """
    q = slope(law, e, scale, v)
    low, high = slope_range(law, e, scale, v - error, v + error)
    return q, max(high - q, q - low)


class Constant(NamedTuple):
    """The same share of any speed."""


implements(scale_of, Constant)(lambda law, e, speed: 0.0)
implements(ratio, Constant)(lambda law, e, scale, v: e)
implements(slope, Constant)(lambda law, e, scale, v: e)
implements(slope_range, Constant)(lambda law, e, scale, low, high: (e, e))
implements(ratio_error, Constant)(lambda law, e, scale, v: 0.0)
implements(is_constant, Constant)(lambda law: True)
implements(slack, Constant)(lambda law: 1.0)
# not as the difference of the speeds: rounding would lose digits of 1 - e near e = 1
implements(lost_speed, Constant)(lambda law, e, scale, v, sign: (sign - e) * v)
implements(arrival_to_repeat, Constant)(lambda law, e, scale, k: 2.0 * k / (1.0 + e))
implements(leaving_to_repeat, Constant)(lambda law, e, scale, k: 2.0 * e * k / (1.0 + e))
implements(rise_to_repeat, Constant)(lambda law, e, scale, k: (1.0 - e) * k)


# --- Laws of restitution whose coefficient falls with the speed -----------------------------------
# - plastic (Johnson 1985, Contact Mechanics, section 11.5): e(v) = e up to the speed v_y at which
#   yielding begins, and e (v / v_y)^(-1/4) above it.  E has a kink there.
# - power: the same with another exponent.
# - points: e(v) is linear between points and constant beyond both ends; its kinks are there.
# - viscoelastic (Mueller and Poeschel 2011, Phys. Rev. E 84, 021302): e(v) = P(y), the quotient of
#   two polynomials of y = y_0 (v / v_r)^(1/10), where P(y_0) = e.
#
# Their slopes fall too, apart from jumps at points: over a range of speeds a slope lies between
# those at its ends and on both sides of the points within.


# The bits of t^(-1/4), to 3.2 %, are these less a quarter of the bits of t
QUARTER_BITS = np.int64(0x4FEB_0312_0000_0000)
# (1 - h)^(-1/4) = 1 + h (Q1 + h (Q2 + h Q3)) + ...
Q1, Q2, Q3 = 1.0 / 4.0, 5.0 / 32.0, 15.0 / 128.0
# The following errors are proved by checks/law_error.py.
# Relative error of e(v) above the speed of yielding, a product of e with a fourth root, and of
# q(v), 3/4 of it; each with that of v_y, of which a fourth root is taken
PLASTIC_ERROR: Final = 5.0 * HALF_ULP + 0.25 * KICK_ERROR
# Of v / v_r, relative
SPEED_ERROR: Final = 2.0 * HALF_ULP + KICK_ERROR
# Relative errors of e(v) and q(v) of a power, and how much they grow with |ln (e(v) / e)|
POWER_ERROR: Final = 9.0 * HALF_ULP
POWER_LOG_ERROR: Final = 3.75 * HALF_ULP
# Relative error of e(v) between points, and that of q(v), relative to e(v)
POINTS_ERROR: Final = 15.0 * HALF_ULP
N1, D2, D3, D4 = PADE
STEPS = 40  # of the iteration for y_0, each of which reduces the error to a fifth
# Relative errors: of y_0^10 / v_r, ten times 8 of y_0, 10 of the powers, 3 of v_r and the quotient;
# of P for an exact y; of y where ln y = 0, and how much it grows with |ln y|
SCALE_ERROR: Final = 93.0 * HALF_ULP + KICK_ERROR
PADE_ERROR: Final = 10.0 * HALF_ULP
ROOT_ERROR: Final = 0.1 * SCALE_ERROR + 2.5 * HALF_ULP
LOG_ERROR: Final = 4.5 * HALF_ULP


class Plastic(NamedTuple):
    """Yielding above a speed."""


@jit
def inverse_fourth_root(t: float) -> float:
    """Return t^(-1/4) to 2 half ulps, for a positive normal number t.

    The guess from the bits has the error h = 1 - root^4 t of at most 0.124; each step reduces it to
    0.38 h^4.
    """
    root = np.int64(QUARTER_BITS - (np.float64(t).view(np.int64) >> 2)).view(np.float64)
    for _ in range(2):
        square = root * root
        h = fma(-t, square * square, 1.0)
        root = np.float64(fma(root * h, fma(h, fma(h, Q3, Q2), Q1), root))
    return root


implements(scale_of, Plastic)(lambda law, e, speed: 1.0 / speed)
implements(ratio_error, Plastic)(lambda law, e, scale, v: PLASTIC_ERROR)
implements(slack, Plastic)(lambda law: 2.0)


@implements(ratio, Plastic)
def ratio_plastic(law: Restitution, e: float, scale: float, v: float) -> float:
    t = v * scale
    yielding = e * inverse_fourth_root(t)  # computed in every lane, without a branch
    return yielding if t > 1.0 else e


@implements(slope, Plastic)
def slope_plastic(law: Restitution, e: float, scale: float, v: float) -> float:
    return 0.75 * ratio(law, e, scale, v) if v * scale > 1.0 else e


@implements(slope_range, Plastic)
def slope_range_plastic(
    law: Restitution, e: float, scale: float, low: float, high: float
) -> tuple[float, float]:
    # rounding may have put an end on either side of the kink
    near, far = 1.0 - 8.0 * HALF_ULP, 1.0 + 8.0 * HALF_ULP
    least = slope(law, e, scale, high * far) * near if high < np.inf else 0.0
    return least, slope(law, e, scale, low * near) * far


class Power(NamedTuple):
    """A fall with a power of the speed, above a speed."""

    exponent: float


@jit
def _excess(scale: float, v: float) -> float:
    """Speed in units of that of the law, from 1 to 1e300."""
    t = v * scale
    t = t if t > 1.0 else 1.0
    return t if t < 1e300 else 1e300


@implements(ratio, Power)
def ratio_power(law: Restitution, e: float, scale: float, v: float) -> float:
    # logarithm and exponential as in `_root`
    f, k = arithmetic.mantissa_and_exponent(_excess(scale, v))
    r, whole = arithmetic.reduced(-law.exponent * arithmetic.log_near_one(f, k))
    power = arithmetic.power_of_two(whole)
    return float(e * fma(power, arithmetic.exp_near_zero(r), power))


implements(scale_of, Power)(lambda law, e, speed: 1.0 / speed)
implements(slack, Power)(lambda law: 2.0)


@implements(slope, Power)
def slope_power(law: Restitution, e: float, scale: float, v: float) -> float:
    share = ratio(law, e, scale, v)
    return (1.0 - law.exponent) * share if v * scale > 1.0 else share


@implements(slope_range, Power)
def slope_range_power(
    law: Restitution, e: float, scale: float, low: float, high: float
) -> tuple[float, float]:
    # as for the plastic law; the error of a slope grows less than the slope falls
    near, far, error = 1.0 - 8.0 * HALF_ULP, 1.0 + 8.0 * HALF_ULP, e * 2.0 * POWER_ERROR
    least = slope(law, e, scale, high * far) - error if high < np.inf else 0.0
    return max(least, 0.0), slope(law, e, scale, low * near) + error


@implements(ratio_error, Power)
def ratio_error_power(law: Restitution, e: float, scale: float, v: float) -> float:
    fallen = law.exponent * arithmetic.log(_excess(scale, v))
    return float(POWER_ERROR + POWER_LOG_ERROR * fallen)


class Points(NamedTuple):
    """Points, the speed of the last of which is 1, and the lines after each of them."""

    speeds: tuple[float, ...]
    rises: tuple[float, ...]  # slopes of the lines
    starts: tuple[float, ...]  # their values at 0
    slowest: float  # e(v) up to the first point


def _points_of(law: str) -> Points:
    """Return the points of a law; each number is rounded once."""
    points = numbers_of(law)
    speeds = tuple(float(Fraction(v) / Fraction(points[-1][0])) for v, _ in points)
    lines = [*lines_of(points), (Fraction(0), Fraction(points[-1][1]))]
    rises, starts = zip(*((float(rise), float(start)) for rise, start in lines), strict=True)
    return Points(speeds, rises, starts, points[0][1])


@jit
def _line(law: Restitution, t: float) -> tuple[float, float]:
    """Slope and value at 0 of the line that holds at a speed."""
    rise, start = 0.0, law.slowest
    for k in range(len(law.speeds)):
        rise = law.rises[k] if t > law.speeds[k] else rise
        start = law.starts[k] if t > law.speeds[k] else start
    return rise, start


implements(scale_of, Points)(lambda law, e, speed: 1.0 / speed)
implements(slack, Points)(lambda law: 2.0)
implements(ratio_error, Points)(lambda law, e, scale, v: POINTS_ERROR)


@implements(ratio, Points)
def ratio_points(law: Restitution, e: float, scale: float, v: float) -> float:
    rise, start = _line(law, v * scale)
    return fma(rise, v * scale, start)


@implements(slope, Points)
def slope_points(law: Restitution, e: float, scale: float, v: float) -> float:
    rise, start = _line(law, v * scale)
    return fma(2.0 * rise, v * scale, start)


@implements(slope_range, Points)
def slope_range_points(
    law: Restitution, e: float, scale: float, low: float, high: float
) -> tuple[float, float]:
    # rounding may have put an end on either side of a point
    low, high = low * (1.0 - 8.0 * HALF_ULP), min(high, 2.0 / scale) * (1.0 + 8.0 * HALF_ULP)
    first, last = slope(law, e, scale, low), slope(law, e, scale, high)
    least, most = min(first, last), max(first, last)
    rise, start = 0.0, law.slowest
    for k in range(len(law.speeds)):
        t = law.speeds[k]
        before, after = fma(2.0 * rise, t, start), fma(2.0 * law.rises[k], t, law.starts[k])
        inside = low * scale <= t <= high * scale
        least = min(least, min(before, after)) if inside else least
        most = max(most, max(before, after)) if inside else most
        rise, start = law.rises[k], law.starts[k]
    error = law.slowest * POINTS_ERROR
    return max(least - error, 0.0), most + error


@implements(arrival_to_repeat, Points)
def arrival_to_repeat_points(law: Restitution, e: float, scale: float, k: float) -> float:
    # c + E(c) rises; on a line it is a square, whose root is one step of Newton's method away
    both = 2.0 * k * scale
    rise, start = 0.0, law.slowest
    for i in range(len(law.speeds)):
        t = law.speeds[i]
        later = fma(fma(law.rises[i], t, law.starts[i]), t, t) < both
        rise, start = law.rises[i] if later else rise, law.starts[i] if later else start
    half = 1.0 + start
    c = 2.0 * both / (half + math.sqrt(max(fma(4.0 * rise, both, half * half), 0.0))) / scale
    left = lost_speed(law, e, scale, c, -1.0) + 2.0 * k
    return float(c + left / (1.0 + slope(law, e, scale, c)))


class Viscoelastic(NamedTuple):
    """Viscoelastic spheres."""


@jit
def root_at(e: float) -> float:
    """Return y_0 where P is e, by (1 - e)(1 + n_1 y) = e y^2 (d_2 + d_3 y + d_4 y^2).

    The iteration converges for e in [0.4, 1], where y is at most 1.2, and retains relative accuracy
    where e is near 1.
    """
    y = 0.0
    for _ in range(STEPS):
        y = math.sqrt((1.0 - e) * fma(N1, y, 1.0) / (e * fma(y, fma(y, D4, D3), D2)))
    return y


@jit
def _root(scale: float, v: float) -> float:
    """Return y at speed v, at least 1e-30.

    Logarithm and exponential are those of `arithmetic` for normal numbers only: the loop over lanes
    is then vector code, two and a half times as fast.
    """
    t = v * scale
    f, k = arithmetic.mantissa_and_exponent(1e-300 if t < 1e-300 else t)
    r, whole = arithmetic.reduced(0.1 * arithmetic.log_near_one(f, k))
    power = arithmetic.power_of_two(whole)
    found = fma(power, arithmetic.exp_near_zero(r), power)
    return found if t == t else t


@jit
def pade(y: float) -> tuple[float, float]:
    """Return P(y), and the slope P + y P' / 10 of P(y_0 (v / v_r)^(1/10)) v."""
    top = fma(N1, y, 1.0)
    higher = y * y * fma(y, fma(y, D4, D3), D2)
    bottom = top + higher
    # y P' / P, from the logarithmic derivatives of top and bottom
    fall = N1 * y / top - (N1 * y + y * y * fma(y, fma(y, 4.0 * D4, 3.0 * D3), 2.0 * D2)) / bottom
    share = top / bottom
    return share, share * fma(0.1, fall, 1.0)


@implements(scale_of, Viscoelastic)
def scale_of_viscoelastic(law: Restitution, e: float, speed: float) -> float:
    y = root_at(e)
    square = y * y
    eighth = square * square
    eighth *= eighth
    return eighth * square / speed


implements(ratio, Viscoelastic)(lambda law, e, scale, v: pade(_root(scale, v))[0])
implements(slope, Viscoelastic)(lambda law, e, scale, v: pade(_root(scale, v))[1])
implements(slack, Viscoelastic)(lambda law: 3.0)


@implements(slope_range, Viscoelastic)
def slope_range_viscoelastic(
    law: Restitution, e: float, scale: float, low: float, high: float
) -> tuple[float, float]:
    error = 32.0 * HALF_ULP
    least = slope(law, e, scale, high) - error if high < np.inf else 0.0
    return max(least, 0.0), min(slope(law, e, scale, low) + error, 1.0)


@implements(ratio_error, Viscoelastic)
def ratio_error_viscoelastic(law: Restitution, e: float, scale: float, v: float) -> float:
    y = _root(scale, v)
    share, q = pade(y)
    of_root = ROOT_ERROR + LOG_ERROR * abs(arithmetic.log(y)) if y > 0.0 else 0.0
    return PADE_ERROR + 10.0 * (share - q) / share * of_root


def _lost_speed_falling(law: Restitution, e: float, scale: float, v: float, sign: float) -> float:
    return fma(-ratio(law, e, scale, v), v, sign * v)


def _arrival_to_repeat_falling(law: Restitution, e: float, scale: float, k: float) -> float:
    # E is concave: Newton's method from below never passes the root
    c = k
    for _ in range(STEPS):
        left = lost_speed(law, e, scale, c, -1.0) + 2.0 * k
        c += left / (1.0 + slope(law, e, scale, c))
    return c


def _leaving_to_repeat_falling(law: Restitution, e: float, scale: float, k: float) -> float:
    c = arrival_to_repeat(law, e, scale, k)
    return ratio(law, e, scale, c) * c


def _rise_to_repeat_falling(law: Restitution, e: float, scale: float, k: float) -> float:
    # c - k is half of c - E(c), because c + E(c) = 2 k
    c = arrival_to_repeat(law, e, scale, k)
    return 0.5 * (1.0 + e) * lost_speed(law, e, scale, c, 1.0)


def _implement_falling(*kinds: type) -> None:
    """Implement the functions shared by all laws whose coefficient falls with the speed."""
    implements(is_constant, *kinds)(lambda law: False)
    implements(lost_speed, *kinds)(_lost_speed_falling)
    implements(leaving_to_repeat, *kinds)(_leaving_to_repeat_falling)
    implements(rise_to_repeat, *kinds)(_rise_to_repeat_falling)


_implement_falling(Plastic, Viscoelastic, Power, Points)
implements(arrival_to_repeat, Plastic, Viscoelastic, Power)(_arrival_to_repeat_falling)
RESTITUTION_OF: Final[Mapping[str, Restitution]] = {
    CONSTANT: Constant(),
    PLASTIC: Plastic(),
    VISCOELASTIC: Viscoelastic(),
}


def restitution_of(law: str) -> Restitution:
    """Return a law by its text; one from outside the package with its present code."""
    if law in OUTSIDE:
        return _from_outside(OUTSIDE[law].code, OUTSIDE[law])
    return RESTITUTION_OF[law] if law in RESTITUTION_OF else _with_numbers(law)


@functools.cache
def _with_numbers(law: str) -> Restitution:
    return Power(numbers_of(law)) if name_of(law) == POWER else _points_of(law)


@functools.cache
def _from_outside(code: str, law: OutsideLaw) -> Restitution:
    """Implement a law from outside the package."""
    for key, count in (("ratio", 2), ("slope", 2), ("bend", 1)):
        takes = (types.float64,) * count
        whose = f"law {law.name!r}: its {key}"
        require_compilable(getattr(law, key), takes, njit(**OPTIONS), whose, real=True)
    marker = kind_named(f"{law.name}_{code}")
    share, kept_slope, bend = (compiled_anew(f, jit) for f in (law.ratio, law.slope, law.bend))
    roundings, rounding = law.roundings, law.roundings * HALF_ULP

    implements(scale_of, marker)(lambda law, e, speed: 1.0 / speed)
    implements(ratio, marker)(lambda law, e, scale, v: share(e, v * scale))
    implements(slope, marker)(lambda law, e, scale, v: kept_slope(e, v * scale))
    implements(slack, marker)(lambda law: 1.0 + 0.25 * roundings)

    @implements(slope_range, marker)
    def slope_range_outside(
        law: Restitution, e: float, scale: float, low: float, high: float
    ) -> tuple[float, float]:
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        q, change = kept_slope(e, middle * scale), bend(e) * half * scale
        change += abs(q) * rounding + bend(e) * abs(middle) * scale * SPEED_ERROR
        return q - change, q + change

    @implements(ratio_error, marker)
    def ratio_error_outside(law: Restitution, e: float, scale: float, v: float) -> float:
        # the derivative of e(v) by the logarithm of v is q - e
        kept = share(e, v * scale)
        off = abs(kept_slope(e, v * scale) - kept) + bend(e) * v * scale * SPEED_ERROR
        return rounding + off * SPEED_ERROR / abs(kept) if kept != 0.0 else rounding

    _implement_falling(marker)
    implements(arrival_to_repeat, marker)(_arrival_to_repeat_falling)
    return marker()
