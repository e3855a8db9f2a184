"""Turns of an angle that grows with time, without loss of digits."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from vibrosweep.arrays import Array


def _split_product(a: Array, b: Array) -> tuple[Array, Array]:
    """Return the product of a and b as rounded value and exact rounding error (Dekker 1971)."""

    def halves(v: Array) -> tuple[Array, Array]:
        shifted = 134217729.0 * v  # 2**27 + 1
        high = shifted - (shifted - v)
        return high, v - high

    product = a * b
    a_high, a_low = halves(a)
    b_high, b_low = halves(b)
    error = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
    return product, error


def reduced_turns(rate: ArrayLike, time: ArrayLike, phase: ArrayLike) -> tuple[Array, Array]:
    """Split ``rate * time + phase`` into whole turns and a phase in [-1/2, 1/2].

    The arguments are in turns per second, seconds and turns; they broadcast.  The product is
    computed with its rounding error, so that the phase after 10**9 periods is as accurate as an
    early one.
    """
    rate, time, offset = np.broadcast_arrays(
        *(np.asarray(v, dtype=np.float64) for v in (rate, time, phase))
    )
    product, error = _split_product(rate, time)
    count = np.rint(product)
    turns = ((product - count) + error) + offset
    carry = np.rint(turns)
    return count + carry, turns - carry


def turns_of_radians(phi: Array) -> Array:
    """Return phi / 2 pi, reduced to [-1/2, 1/2] and corrected for the rounding of 2 pi."""
    two_pi, two_pi_low = 2.0 * math.pi, 2.4492935982947064e-16
    quotient = phi / two_pi
    product, error = _split_product(quotient, np.asarray(two_pi))
    correction = (((phi - product) - error) - quotient * two_pi_low) / two_pi
    turns = (quotient - np.rint(quotient)) + correction
    return np.asarray(turns - np.rint(turns))
