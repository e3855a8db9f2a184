"""Normal deviates that depend only on seed, stream, particle, number and purpose.

The generator is Philox 4x32-10 (Salmon, Moraes, Dror & Shaw, SC'11): ten rounds that turn a counter
of four 32-bit words, with the seed as its key, into four others.  No state is kept, so that no
deviate depends on threads, chunks, the order of computation, or what was computed before.

    word 0, 1    low and high 32 bits of floor(number / 2); the number is that of the impact of the
                 particle, from 0, or of the forcing period, and each counter gives two deviates
    word 2, 3    stream + 2^36 particle + 2^62 purpose, low and high half

The four words are two fractions of 52 bits, p and q in [0, 1), and with the radius
sqrt(-2 ln(1 - p)) the two deviates are its products with the cosine and the sine of 2 pi (q - 1/2)
(Box & Muller 1958), at most `LARGEST` in modulus.  The arithmetic is that of every kernel: the same
bits come from plain Python and from vectors of any width.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, jit, kernel
from vibrosweep.kernels.elementary import (
    ERRORS,
    SHIFT,
    SHIFT_BITS,
    log_near_one,
    mantissa_and_exponent,
)
from vibrosweep.kernels.rounding import HALF_ULP
from vibrosweep.kernels.sine import SINE_ERROR, cos_turns, sin_turns

__all__ = ["LARGEST", "OF_DRIVE", "OF_KICK", "OF_RESTITUTION", "Word", "draw", "key_of"]

LARGEST: Final = 8.4908  # sqrt(2 * 52 ln 2), rounded up: the largest modulus of a deviate
# Relative error of a deviate against Box and Muller's formula for its two fractions: half of that
# of the logarithm, the root, the sine (the phase of the cosine is exact here) and the product.
DEVIATE_ERROR: Final = 0.5 * ERRORS["log"] + SINE_ERROR + 2.1 * HALF_ULP

# Purposes
OF_RESTITUTION = np.uint64(0)
OF_KICK = np.uint64(1)
OF_DRIVE = np.uint64(2)

FIRST_FACTOR, SECOND_FACTOR = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
FIRST_STEP, SECOND_STEP = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
LOW = np.uint64(0xFFFFFFFF)
HALF = np.uint64(32)
FRACTION = np.uint64(12)  # bits of 64 that a fraction does not use
ONE = np.uint64(0x3FF0000000000000)  # bits of 1.0

Word = np.uint64  # below 2^32
Words = tuple[Word, Word, Word, Word]


class Key(NamedTuple):
    """The seed, as the generator takes it."""

    low: Word
    high: Word


def key_of(seed: int) -> Key:
    """Return the key of a seed, from 0 to 2^64 - 1."""
    return Key(np.uint64(seed & 0xFFFFFFFF), np.uint64(seed >> 32))


@jit
def philox(a: Word, b: Word, c: Word, d: Word, low: Word, high: Word) -> Words:
    """Four words of Philox 4x32-10, of a counter (a, b, c, d) and a key (low, high)."""
    for _ in range(10):
        first, second = FIRST_FACTOR * a, SECOND_FACTOR * c
        a, b = (second >> HALF) ^ b ^ low, second & LOW
        c, d = (first >> HALF) ^ d ^ high, first & LOW
        low, high = (low + FIRST_STEP) & LOW, (high + SECOND_STEP) & LOW
    return a, b, c, d


@jit
def _near_one(low: Word, high: Word) -> float:
    """1 + p, with the fraction p in two words."""
    return np.uint64((((high << HALF) | low) >> FRACTION) | ONE).view(np.float64)


@jit
def two_deviates(words: Words) -> tuple[float, float]:
    """Two normal deviates, independent of each other, from four words."""
    f, k = mantissa_and_exponent(2.0 - _near_one(words[0], words[1]))
    radius = math.sqrt(-2.0 * log_near_one(f, k))
    turns = _near_one(words[2], words[3]) - 1.5
    return radius * cos_turns(turns), radius * sin_turns(turns)


@jit
def _integer(value: float) -> int:
    """Convert a float below 2^51 that is an integer, by instructions that all vectors have."""
    return np.float64(value + SHIFT).view(np.int64) - SHIFT_BITS  # type: ignore[return-value]


@jit
def deviates(
    key: Key, stream: float, particle: float, number: float, purpose: Word
) -> tuple[float, float]:
    """The two deviates of a number, a stream and a particle, all within their limits."""
    count, place = _integer(number), _integer(stream)
    above = np.uint64((place >> 32) & 0xF) | (np.uint64(_integer(particle)) << np.uint64(4))
    return two_deviates(
        philox(
            np.uint64(count & 0xFFFFFFFF),
            np.uint64((count >> 32) & 0xFFFFFFFF),
            np.uint64(place & 0xFFFFFFFF),
            above | (purpose << np.uint64(30)),
            key.low,
            key.high,
        )
    )


@jit
def deviate(key: Key, stream: float, particle: float, number: float, purpose: Word) -> float:
    """The deviate of an impact, counted from 0, or of a forcing period."""
    pair = np.floor(0.5 * number)
    even, odd = deviates(key, stream, particle, pair, purpose)
    return odd if number != 2.0 * pair else even


@kernel
def draw(
    key: Key, stream: float, particle: float, first: float, purpose: Word, out: Floats
) -> None:
    """Write the deviates of the numbers from the first on."""
    for i in range(out.size):
        out[i] = deviate(key, stream, particle, first + i, purpose)
