"""Sine of a reduced phase in turns, as inlined arithmetic, which vectorises unlike a call."""

from __future__ import annotations

import math

from vibrosweep.kernels._jit import fma, jit
from vibrosweep.kernels.rounding import HALF_ULP

__all__ = ["COSINE_ERROR", "SINE_ERROR", "cos_turns", "sin_turns"]

# Relative error of `sin_turns`, proved: checks/sine_error.py finds 3.42 half ulps at most.
SINE_ERROR = 3.5 * HALF_ULP
# The cosine is the sine of 1/4 - |x|, itself rounded; absolute.
COSINE_ERROR = SINE_ERROR + 2.0 * math.pi * 2.0**-56


# sin(2 pi y) / y on 0 <= y <= 1/4 as a polynomial in y^2, by the Remez exchange at 60 digits for
# the least largest relative error of the sine (2.6e-19).  The first coefficient is kept as a sum
# of two doubles: a single one would cost half an ulp.
C0_HIGH = 6.283185307179586
C0_LOW = 2.4331317997472714e-16
C1 = -41.341702240399755
C2 = 81.60524927607341
C3 = -76.70585975279849
C4 = 42.05869392378512
C5 = -15.094641620506104
C6 = 3.819927050405184
C7 = -0.7177235794204939
C8 = 0.10085632779802037


@jit
def sin_turns(x: float) -> float:
    """sin(2 pi x) for a phase x in [-1/2, 1/2].

    The fold of |x| > 1/4 onto 1/2 - |x| is exact (Sterbenz), so the zeros at -1/2, 0 and 1/2 are
    exact and phases next to them keep their relative accuracy.
    """
    near = abs(x)
    far = 0.5 - near
    y = math.copysign(far if far < near else near, x)
    z = y * y
    # even and odd coefficients separately: halves the chain of dependent operations
    z2 = z * z
    even = fma(z2, C8, C6)
    odd = fma(z2, C7, C5)
    even = fma(z2, even, C4)
    odd = fma(z2, odd, C3)
    even = fma(z2, even, C2)
    odd = fma(z2, odd, C1)
    even = fma(z2, even, C0_LOW)
    return fma(y, C0_HIGH, y * fma(z, odd, even))


@jit
def cos_turns(x: float) -> float:
    """cos(2 pi x) for a phase x in [-1/2, 1/2]."""
    return sin_turns(0.25 - abs(x))
