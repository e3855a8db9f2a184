"""Laws of restitution whose coefficient falls with the speed of the impact.

- plastic (Johnson 1985, Contact Mechanics, section 11.5): e(v) = e up to the speed v_y at which
  yielding begins, and e (v / v_y)^(-1/4) above it.  E has a kink there.
- viscoelastic (Mueller and Poeschel 2011, Phys. Rev. E 84, 021302): e(v) = P(y), the quotient of
  two polynomials of y = y_0 (v / v_r)^(1/10), where P(y_0) = e.

Their slopes fall too: over a range of speeds a slope lies between those at its ends.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from numba import njit, types

from vibrosweep.kernels import elementary
from vibrosweep.kernels._jit import OPTIONS, fma, implements, jit
from vibrosweep.kernels.anew import compiled_anew, require_compilable
from vibrosweep.kernels.markers import kind
from vibrosweep.kernels.restitution import (
    Constant,
    Restitution,
    arrival_to_repeat,
    leaving_to_repeat,
    lost_speed,
    ratio,
    ratio_error,
    rise_to_repeat,
    scale_of,
    slack,
    slope,
    slope_range,
    straight,
)
from vibrosweep.kernels.rounding import HALF_ULP, KICK_ERROR
from vibrosweep.model.restitution_laws import CONSTANT, OUTSIDE, PADE, PLASTIC, VISCOELASTIC
from vibrosweep.model.restitution_laws import Law as OutsideLaw

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


class Viscoelastic(NamedTuple):
    """Viscoelastic spheres."""


@jit
def root_at(e: float) -> float:
    """Return y_0 where P is e, by (1 - e)(1 + n_1 y) = e y^2 (d_2 + d_3 y + d_4 y^2).

    The iteration converges for e in [0.4, 1], where y is at most 1.2, and keeps relative accuracy
    where e is near 1.
    """
    y = 0.0
    for _ in range(STEPS):
        y = math.sqrt((1.0 - e) * fma(N1, y, 1.0) / (e * fma(y, fma(y, D4, D3), D2)))
    return y


@jit
def _root(scale: float, v: float) -> float:
    """Return y at speed v, at least 1e-30.

    Logarithm and exponential are those of `elementary` for normal numbers only: the loop over lanes
    is then vector code, two and a half times as fast.
    """
    t = v * scale
    f, k = elementary.mantissa_and_exponent(1e-300 if t < 1e-300 else t)
    r, whole = elementary.reduced(0.1 * elementary.log_near_one(f, k))
    power = elementary.power_of_two(whole)
    found = fma(power, elementary.exp_near_zero(r), power)
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
    of_root = ROOT_ERROR + LOG_ERROR * abs(elementary.log(y)) if y > 0.0 else 0.0
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
    implements(straight, *kinds)(lambda law: False)
    implements(lost_speed, *kinds)(_lost_speed_falling)
    implements(arrival_to_repeat, *kinds)(_arrival_to_repeat_falling)
    implements(leaving_to_repeat, *kinds)(_leaving_to_repeat_falling)
    implements(rise_to_repeat, *kinds)(_rise_to_repeat_falling)


_implement_falling(Plastic, Viscoelastic)
LAW_OF: Final[Mapping[str, Restitution]] = {
    CONSTANT: Constant(),
    PLASTIC: Plastic(),
    VISCOELASTIC: Viscoelastic(),
}


def restitution_of(name: str) -> Restitution:
    """Return a law by its name; one from outside the package with the code that it has now."""
    return LAW_OF[name] if name in LAW_OF else _from_outside(OUTSIDE[name].code, OUTSIDE[name])


@functools.cache
def _from_outside(code: str, law: OutsideLaw) -> Restitution:
    """Implement a law from outside the package."""
    for key, count in (("ratio", 2), ("slope", 2), ("bend", 1)):
        takes = (types.float64,) * count
        whose = f"law {law.name!r}: its {key}"
        require_compilable(getattr(law, key), takes, njit(**OPTIONS), whose, real=True)
    marker = kind(f"{law.name}_{code}")
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
    return marker()
