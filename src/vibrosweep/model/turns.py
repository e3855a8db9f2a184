"""Angles in turns: of a phase that grows with time, without loss of digits, and of a sine."""

from __future__ import annotations

import math
from typing import Any

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


# Bound of the relative error, proved by checks/elementary_error.py
ARCSINE_ERROR = 6.3 * 2.0**-53
# 1 / (2 pi) as a sum of two doubles; a single one would cost half an ulp
ARCSINE_FIRST, ARCSINE_FIRST_LOW = 0.15915494309189535, -9.839338337591243e-18
# Polynomial in x^2 for (arcsin(x) / x - 1) / x^2 in turns, for x^2 <= 1/4, highest power first: the
# minimax of the relative error of the arcsine (9.8e-19), by the Remez exchange with 60 digits
ARCSINE_HIGHER = (
    0.005200684761607661,
    -0.0033545498665686958,
    0.003463765046412365,
    0.0005861756317760742,
    0.0017167290890160065,
    0.0018140124485332078,
    0.002225139116032715,
    0.002761592926005343,
    0.003560648710192094,
    0.004835436358835583,
    0.007105131393165858,
    0.011936620731844823,
    0.026525823848649373,
)


def arcsin_turns(x: Any) -> Any:
    """Return the phase in turns, from 0 to 1/4, whose sine is x, from 0 to 1."""
    far = x > 0.5
    z = far * (0.5 * (1.0 - x)) + (1 - far) * (x * x)
    root = far * np.sqrt(z) + (1 - far) * x
    higher = 0.0
    for coefficient in ARCSINE_HIGHER:
        higher = higher * z + coefficient
    near = root * ARCSINE_FIRST + root * (z * higher + ARCSINE_FIRST_LOW)
    return far * (0.25 - 2.0 * near) + (1 - far) * near
