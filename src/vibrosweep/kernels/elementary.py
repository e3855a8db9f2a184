"""Logarithm and exponential in plain arithmetic.

A library's functions differ in the last bit between processors and versions, and a call stops a
loop from becoming vector code.  The polynomials are minimax in the relative error, by the Remez
exchange with 60 digits.  checks/elementary_error.py proves the bounds given here.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from vibrosweep.kernels._jit import fma, jit
from vibrosweep.kernels.rounding import HALF_ULP

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
