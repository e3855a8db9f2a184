"""Arithmetic that gives the same bits on every processor: sine, logarithm and exponential.

A library's functions differ in the last bit between processors and versions, and a call stops a
loop from becoming vector code.  These are polynomials, inlined into the loops.  The bounds on their
errors, and those of the kernels' inputs, are the beginning of all error bounds.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vibrosweep.kernels._jit import Floats, fma, jit, kernel

# --- Rounding -------------------------------------------------------------------------------------


HALF_ULP = 2.0**-53  # relative error of one rounding
ROUNDING = 16.0 * HALF_ULP  # of a component of an image, relative to the sum of its terms
SMALLEST = 2.0**-1020  # absolute, of a product or quotient that is subnormal
# x0 is a reduced sum of launch and phase, each rounded; a staggered launch is known to an ulp.
LAUNCH_ERROR = 4.0 * HALF_ULP
# a = 2 f A / g and u0 = 2 f v0 / g take two roundings, r = f tau_c one.
KICK_ERROR = 2.0 * HALF_ULP
REST_ERROR = HALF_ULP


# --- Sine and cosine ------------------------------------------------------------------------------
# Phases are in turns and reduced, in [-1/2, 1/2].


# Relative error of `sin_turns`, proved: checks/sine_error.py finds 3.42 half ulps at most.
SINE_ERROR = 3.5 * HALF_ULP
# Absolute error of the cosine, the sine of 1/4 - |x|, which is itself rounded.
COSINE_ERROR = SINE_ERROR + 2.0 * math.pi * 2.0**-56
# Relative error of 2 pi s - sin(2 pi s).  Below a quarter turn: eight roundings and the polynomial,
# which is more accurate; beyond, (1 + (0.4 * 2 pi s + 3.5) / (2 pi s - 1)) half ulps.
LAG_ERROR = 9.0 * HALF_ULP


# sin(2 pi y) / y on 0 <= y <= 1/4 as a polynomial in y^2, minimax in the relative error of the sine
# (2.6e-19), by the Remez exchange with 60 digits.  The first coefficient is stored as a sum of two
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


# --- Logarithm and exponential --------------------------------------------------------------------
# The polynomials are minimax in the relative error, by the Remez exchange with 60 digits.
# checks/elementary_error.py proves the bounds given here.


# Relative errors of the results, proved; of `exp` where the result is a normal number.
ERRORS: Final = {
    "log": 2.6 * HALF_ULP,
    "exp": 1.8 * HALF_ULP,
    "expm1": 3.7 * HALF_ULP,
}

ONE = np.int64(0x3FF0000000000000)  # bits of 1.0
ROOT_HALF = np.int64(0x3FE6A09E667F3BCD)  # of sqrt(1/2)
# Added to a number below 2^51, it leaves the nearest integer in the lowest bits.
SHIFT = 1.5 * 2.0**52
SHIFT_BITS = np.int64(0x4338000000000000)
SMALLEST_NORMAL = 2.0**-1022

LOG2_E = 1.4426950408889634
LN2_HIGH = 0.6931471804855391  # its product with an exponent is exact
LN2_LOW = 7.440617110012397e-11

# (2 artanh(s) / s - 2) / s^2 on s^2 <= (3 - 2 sqrt 2)^2 in powers of s^2; error 1.2e-18 of the log
L0, L1, L2, L3 = 0.6666666666666734, 0.399999999994147, 0.2857142874238399, 0.22222198573443874
L4, L5, L6 = 0.18183564317949694, 0.15314050634846998, 0.14795950039050715
# (exp(r) - 1 - r - r^2 / 2) / r^3 on |r| <= ln(2) / 2; error 2.6e-19 of exp(r) - 1
E0, E1, E2 = 0.16666666666666677, 0.04166666666666669, 0.008333333333321745
E3, E4, E5 = 0.0013888888888870206, 0.00019841269885874285, 2.4801587355996754e-05
E6, E7, E8 = 2.7557244437459772e-06, 2.7557245673645776e-07, 2.5108963688916518e-08
E9 = 2.0923730942550706e-09


@jit
def log_near_one(f: float, k: float) -> float:
    """ln(1 + f) + k ln 2 for 1 + f in [sqrt(1/2), sqrt(2)] and an integer k."""
    s = f / (2.0 + f)
    z = s * s
    higher = fma(z, fma(z, fma(z, fma(z, fma(z, fma(z, L6, L5), L4), L3), L2), L1), L0)
    half_square = 0.5 * f * f
    tail = fma(s, fma(z, higher, half_square), k * LN2_LOW)
    return fma(k, LN2_HIGH, f - (half_square - tail))


@jit
def mantissa_and_exponent(x: float) -> tuple[float, float]:
    """Numbers f and k of a normal x above 0: x = (1 + f) 2^k, 1 + f in [sqrt(1/2), sqrt(2)]."""
    bits = np.float64(x).view(np.int64)
    exponent = (bits - ROOT_HALF + ONE) >> 52
    k = np.int64(exponent + SHIFT_BITS).view(np.float64) - (SHIFT + 1023.0)
    return np.int64(bits - (exponent << 52) + ONE).view(np.float64) - 1.0, k


@jit
def log(x: float) -> float:
    """Natural logarithm: -inf of 0, NaN of a negative number."""
    tiny = x < SMALLEST_NORMAL
    f, k = mantissa_and_exponent(x * 2.0**54 if tiny else x)
    found = log_near_one(f, k - 54.0 if tiny else k)
    found = found if x < np.inf else x
    found = found if x != 0.0 else -np.inf
    return np.nan if x < 0.0 else found


@jit
def exp_near_zero(r: float) -> float:
    """exp(r) - 1 for |r| <= ln(2) / 2."""
    higher = fma(r, fma(r, fma(r, fma(r, fma(r, E9, E8), E7), E6), E5), E4)
    higher = fma(r, fma(r, fma(r, fma(r, higher, E3), E2), E1), E0)
    square = r * r
    return r + fma(square * r, higher, 0.5 * square)


@jit
def power_of_two(k: int) -> float:
    """Two to the power of k, from -1022 to 1023."""
    return np.int64((k << 52) + ONE).view(np.float64)


@jit
def reduced(x: float) -> tuple[float, int]:
    """Number r within ln(2) / 2 of 0, and an integer k, with x = k ln 2 + r."""
    shifted = np.float64(fma(x, LOG2_E, SHIFT))
    k = shifted - SHIFT
    r = fma(-k, LN2_LOW, fma(-k, LN2_HIGH, x))
    return r, shifted.view(np.int64) - SHIFT_BITS  # type: ignore[return-value]


@jit
def exp(x: float) -> float:
    """Return e to the power of x."""
    inside = min(max(x, -746.0), 710.0)
    r, k = reduced(inside)
    half = k >> 1  # in two steps: the power alone may be too large or too small for a double
    found = (1.0 + exp_near_zero(r)) * power_of_two(half) * power_of_two(k - half)
    return found if x == x else x


@jit
def expm1(x: float) -> float:
    """Return e to the power of x, less 1, up to x = 700."""
    inside = min(max(x, -700.0), 700.0)
    r, k = reduced(inside)
    power = power_of_two(k)
    found = fma(power, exp_near_zero(r), power - 1.0)
    return found if x == x else x
