"""Sine of a reduced phase in turns, as inlined arithmetic, which unlike a call vectorises."""

from __future__ import annotations

import math

import numpy as np

from vibrosweep.kernels._jit import Floats, fma, jit, kernel
from vibrosweep.kernels.rounding import HALF_ULP

# Relative error of `sin_turns`, proved: checks/sine_error.py finds 3.42 half ulps at most.
SINE_ERROR = 3.5 * HALF_ULP
# Absolute error of the cosine, the sine of 1/4 - |x|, which is itself rounded.
COSINE_ERROR = SINE_ERROR + 2.0 * math.pi * 2.0**-56
# Relative error of 2 pi s - sin(2 pi s).  Below a quarter turn: eight roundings and the polynomial,
# which is more accurate; beyond, (1 + (0.4 * 2 pi s + 3.5) / (2 pi s - 1)) half ulps.
LAG_ERROR = 9.0 * HALF_ULP


# sin(2 pi y) / y on 0 <= y <= 1/4 as a polynomial in y^2, minimax in the relative error of the sine
# (2.6e-19), by the Remez exchange with 60 digits.  The first coefficient is kept as a sum of two
# doubles: a single one would cost half an ulp.
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
# 2 pi y - sin(2 pi y) over y^3 and 1 - cos(2 pi y) over y^2 on 0 <= y <= 1/2 as polynomials in y^2,
# minimax in the relative error (1.3e-5 and 5.3e-5).
LAG = (41.3412, -81.546718, 75.586321, -34.958706)
VERSINE = (19.738179, -64.828729, 83.433458, -47.744328)


@jit
def _terms(z: float) -> tuple[float, float]:
    """Sums of the odd terms of the polynomial over z, and of the even ones from z^2 on over z^2.

    Summed separately, they halve the chain of dependent operations.
    """
    z2 = z * z
    even = fma(z2, C8, C6)
    odd = fma(z2, C7, C5)
    even = fma(z2, even, C4)
    odd = fma(z2, odd, C3)
    even = fma(z2, even, C2)
    odd = fma(z2, odd, C1)
    return odd, even


@jit
def sin_near(y: float) -> float:
    """sin(2 pi y) for a phase y in [-1/4, 1/4]."""
    z = y * y
    odd, even = _terms(z)
    even = fma(z * z, even, C0_LOW)
    return fma(y, C0_HIGH, y * fma(z, odd, even))


@jit
def folded(x: float) -> float:
    """Phase in [-1/4, 1/4] with the same sine; exact (Sterbenz)."""
    near = abs(x)
    far = 0.5 - near
    return math.copysign(far if far < near else near, x)


@jit
def sin_turns(x: float) -> float:
    """sin(2 pi x) for a phase x in [-1/2, 1/2].

    As the fold is exact, the zeros at -1/2, 0 and 1/2 are exact and phases next to them keep their
    relative accuracy.
    """
    return sin_near(folded(x))


@jit
def sin_and_lag(s: float, part: float) -> tuple[float, float]:
    """sin(2 pi s) and 2 pi s - sin(2 pi s), each to a few relative roundings; s = part + integer.

    Below a quarter turn the difference is the polynomial without its first term.
    """
    y = folded(part)
    z = y * y
    odd, even = _terms(z)
    sine = fma(y, C0_HIGH, y * fma(z, odd, fma(z * z, even, C0_LOW)))
    near = -(y * z) * fma(z, even, odd)
    return sine, near if abs(s) <= 0.25 else fma(C0_HIGH, s, -sine)


@jit
def rough_lag_and_versine(y: float) -> tuple[float, float]:
    """2 pi y - sin(2 pi y) and 1 - cos(2 pi y) for y in [-1/2, 1/2], to relative 1.3e-5, 5.3e-5."""
    z = y * y
    lag = fma(z, fma(z, fma(z, LAG[3], LAG[2]), LAG[1]), LAG[0])
    versine = fma(z, fma(z, fma(z, VERSINE[3], VERSINE[2]), VERSINE[1]), VERSINE[0])
    return y * z * lag, z * versine


@jit
def cos_turns(x: float) -> float:
    """cos(2 pi x) for a phase x in [-1/2, 1/2]."""
    return sin_near(0.25 - abs(x))


@kernel
def waves(turns: Floats, sines: Floats, cosines: Floats) -> None:
    """Write the sine and the cosine of phases in turns, each an array of shape (phase,)."""
    for i in range(turns.size):
        x = turns[i] - np.rint(turns[i])
        sines[i], cosines[i] = sin_turns(x), cos_turns(x)
