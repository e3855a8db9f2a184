"""Small changes of the state, and frames of two of them, carried through an impact."""

from __future__ import annotations

import math

from vibrosweep.kernels._jit import jit
from vibrosweep.kernels.bases import Jacobian
from vibrosweep.kernels.rounding import ROUNDING


@jit
def carry(dx: float, du: float, jacobian: Jacobian) -> tuple[float, float]:
    """Image of a small change (dx, du) of the state."""
    xx, xu, ux, uu, _ = jacobian
    return xx * dx + xu * du, ux * dx + uu * du


@jit
def stretch(c: float, s: float, jacobian: Jacobian) -> tuple[float, float, float, float, float]:
    """Carry the orthonormal frame (c, s), (-s, c) through an impact and make it orthonormal again.

    Returns
    -------
    c, s
        The new frame.
    along, across
        Diagonal of the triangular factor (Gram-Schmidt): how much the first axis is stretched,
        and how much is left of the second across it.  Their product is the determinant, up to sign.
    slack
        Bound on the rounding error of the logarithm of that product.
    """
    ax, ay = carry(c, s, jacobian)
    bx, by = carry(-s, c, jacobian)
    along = math.sqrt(ax * ax + ay * ay)
    if along == 0.0:  # only at zero restitution: the first axis collapses
        return c, s, 0.0, 0.0, 0.0
    c, s = ax / along, ay / along
    across = abs(c * by - s * bx)
    slack = ROUNDING * jacobian.size
    return c, s, along, across, slack / along + slack / across
