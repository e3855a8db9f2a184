"""Jacobian of one impact: how a small change of phase and flight time is carried along.

For a state (x, u), the phase at lift-off and the flight that follows, an impact without rest has

    d(x', u') / d(x, u) = [[1, 1], [k, e + k]],      k = 2 pi a cos(2 pi x'),

with determinant e; the second row changes sign where the `reflect` law turns the particle back.  A
rest forgets the state: its Jacobian is zero.
"""

from __future__ import annotations

import math

from vibrosweep.kernels._jit import jit
from vibrosweep.kernels.sine import sin_turns

__all__ = ["HALF_ULP", "ROUNDING", "carry", "kick_slope", "stretch"]

HALF_ULP = 2.0**-53  # relative error of one rounding
ROUNDING = 16.0 * HALF_ULP  # of a component of an image, relative to the sum of its terms


@jit
def kick_slope(x: float, a: float) -> float:
    """Derivative 2 pi a cos(2 pi x) of the kick by the phase of the landing."""
    return 2.0 * math.pi * a * sin_turns(0.25 - abs(x))


@jit
def carry(dx: float, du: float, e: float, k: float, sign: float) -> tuple[float, float]:
    """Image of a small change (dx, du) of the state."""
    return dx + du, sign * (k * dx + (e + k) * du)


@jit
def stretch(
    c: float, s: float, e: float, k: float, sign: float
) -> tuple[float, float, float, float, float]:
    """Carry the orthonormal frame (c, s), (-s, c) through an impact and make it orthonormal again.

    Returns
    -------
    c, s
        The new frame.
    along, across
        Diagonal of the triangular factor (Gram-Schmidt): how much the first axis is stretched,
        and how much is left of the second across it.  Their product is the determinant, up to sign.
    slack
        Bound of the rounding error of the logarithm of that product.
    """
    ax, ay = carry(c, s, e, k, sign)
    bx, by = carry(-s, c, e, k, sign)
    along = math.sqrt(ax * ax + ay * ay)
    if along == 0.0:  # e = 0 alone: the first axis is lost
        return c, s, 0.0, 0.0, 0.0
    c, s = ax / along, ay / along
    across = abs(c * by - s * bx)
    slack = ROUNDING * (2.0 + e + 2.0 * abs(k))
    return c, s, along, across, slack / along + slack / across
