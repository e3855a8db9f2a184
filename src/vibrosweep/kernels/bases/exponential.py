"""Exponential decay and its remainders after the first terms, accurate at any time."""

from __future__ import annotations

import math

from vibrosweep.kernels import elementary
from vibrosweep.kernels._jit import fma, jit

TAYLOR = tuple(1.0 / math.factorial(k) for k in range(16))  # of the exponential up to 1/2


@jit
def bend(z: float) -> float:
    """Return exp(-z) - 1 + z for z >= 0 to some roundings."""
    if z > 0.5:
        return elementary.exp(-z) - 1.0 + z
    z2 = z * z
    even, odd = fma(z2, TAYLOR[14], TAYLOR[12]), fma(z2, TAYLOR[15], TAYLOR[13])
    even, odd = fma(z2, even, TAYLOR[10]), fma(z2, odd, TAYLOR[11])
    even, odd = fma(z2, even, TAYLOR[8]), fma(z2, odd, TAYLOR[9])
    even, odd = fma(z2, even, TAYLOR[6]), fma(z2, odd, TAYLOR[7])
    even, odd = fma(z2, even, TAYLOR[4]), fma(z2, odd, TAYLOR[5])
    even, odd = fma(z2, even, TAYLOR[2]), fma(z2, odd, TAYLOR[3])
    return z2 * fma(-z, odd, even)


@jit
def decayed(z: float) -> tuple[float, float, float]:
    """Return exp(-z), 1 - exp(-z) and 1 - (1 + z) exp(-z) for z >= 0, each to some roundings."""
    if z > 0.5:
        left = elementary.exp(-z)
        return left, 1.0 - left, 1.0 - left - z * left
    bent = bend(z)
    lost = z - bent
    return 1.0 - lost, lost, fma(-bent, 1.0 + z, z * z)
