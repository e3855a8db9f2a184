"""Laws of restitution: the coefficient of restitution as a function of the speed of an impact.

An impact at the relative speed v leaves the speed E(v) = e(v) v, with the slope q(v) = E'(v).  A
law is an empty named tuple, whose type numba knows when it compiles.  `scale_of` combines the
restitution e and the speed of a law into one number, by which the law scales speeds; these are
durations of flights, in forcing periods.

This file implements the constant law, e(v) = e; `vibrosweep.kernels.falling` implements those that
fall with the speed.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from vibrosweep.kernels._jit import generic, implements, jit

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
def straight(law: Restitution) -> bool:
    """Return whether the coefficient of restitution does not depend on the speed."""


@generic
def slack(law: Restitution) -> float:
    """Rounding error of a slope, in units of that of a component of a Jacobian."""


@generic
def lost_speed(law: Restitution, e: float, scale: float, v: float, sign: float) -> float:
    """Return sign v - E(v), the change of speed that makes up for an impact at speed v."""


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
implements(straight, Constant)(lambda law: True)
implements(slack, Constant)(lambda law: 1.0)
# not as the difference of the speeds: rounding would lose digits of 1 - e near e = 1
implements(lost_speed, Constant)(lambda law, e, scale, v, sign: (sign - e) * v)
implements(arrival_to_repeat, Constant)(lambda law, e, scale, k: 2.0 * k / (1.0 + e))
implements(leaving_to_repeat, Constant)(lambda law, e, scale, k: 2.0 * e * k / (1.0 + e))
implements(rise_to_repeat, Constant)(lambda law, e, scale, k: (1.0 - e) * k)
