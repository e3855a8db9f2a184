"""Normal deviates that depend on nothing but their place: seed, stream, particle, number, purpose.

The generator is Philox 4x32-10 (Salmon, Moraes, Dror & Shaw, SC'11): ten rounds that turn a counter
of four 32-bit words, with the seed as its key, into four others.  No state is kept, so that no
deviate depends on threads, chunks, the order of computation, or what was computed before.

    word 0, 1    low and high half of a number of 64 bits, half of that of the impact of the
                 particle, counted from 0, or of the forcing period: each counter gives two deviates
    word 2, 3    stream + 2^36 particle + 2^62 purpose, low and high half

The four words are two fractions of 52 bits, p and q in [0, 1), and with the radius
sqrt(-2 ln(1 - p)) the two deviates are its products with the cosine and the sine of 2 pi (q - 1/2)
(Box & Muller 1958): `LARGEST` at most.  The arithmetic is that of every kernel: the same bits
come from plain Python and from vectors of any width.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, fma, jit
from vibrosweep.kernels.elementary import (
    ERRORS,
    SHIFT,
    SHIFT_BITS,
    log_near_one,
    mantissa_and_exponent,
)
from vibrosweep.kernels.lanes import ROW
from vibrosweep.kernels.rounding import HALF_ULP
from vibrosweep.kernels.sine import SINE_ERROR, cos_turns, sin_turns
from vibrosweep.model.parameters import Strengths

LARGEST: Final = 8.4908  # sqrt(2 * 52 ln 2), rounded up: the modulus of no deviate is larger
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
FRACTION = np.uint64(12)  # bits of 64 that a fraction leaves
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
def _round(a: Word, b: Word, c: Word, d: Word, low: Word, high: Word) -> Words:
    first, second = FIRST_FACTOR * a, SECOND_FACTOR * c
    return (second >> HALF) ^ b ^ low, second & LOW, (first >> HALF) ^ d ^ high, first & LOW


@jit
def philox(a: Word, b: Word, c: Word, d: Word, low: Word, high: Word) -> Words:
    """Four words of Philox 4x32-10, of a counter (a, b, c, d) and a key (low, high)."""
    for _ in range(10):
        a, b, c, d = _round(a, b, c, d, low, high)
        low, high = (low + FIRST_STEP) & LOW, (high + SECOND_STEP) & LOW
    return a, b, c, d


@jit
def _near_one(low: Word, high: Word) -> float:
    """1 + p of the fraction p of two words."""
    return np.uint64((((high << HALF) | low) >> FRACTION) | ONE).view(np.float64)


@jit
def two_deviates(words: Words) -> tuple[float, float]:
    """Two normal deviates, independent of each other, of four words."""
    f, k = mantissa_and_exponent(2.0 - _near_one(words[0], words[1]))
    radius = math.sqrt(-2.0 * log_near_one(f, k))
    turns = _near_one(words[2], words[3]) - 1.5
    return radius * cos_turns(turns), radius * sin_turns(turns)


@jit
def _integer(value: float) -> int:
    """A float below 2^51 that is an integer, as one; by no instruction that vectors may lack."""
    return np.float64(value + SHIFT).view(np.int64) - SHIFT_BITS  # type: ignore[return-value]


@jit
def deviates(
    key: Key, stream: float, particle: float, number: float, purpose: Word
) -> tuple[float, float]:
    """The two deviates of a number, and of a stream and a particle within their limits."""
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


class Noise(NamedTuple):
    """The field `noise` of a base: what is random, each 1 or None, and the seed."""

    restitution: int | None
    kick: int | None
    drive: int | None
    key: Key


class Source(NamedTuple):
    """Noise of one realization, in its constants; zeros for what is not random."""

    restitution: float
    kick: float
    drive: float
    stream: float
    end: float  # whole periods at the end of the observation, from which counts may be taken


class Draw(NamedTuple):
    """What is random in one impact; zeros for what is not."""

    slip: float  # added to the restitution
    push: float  # added to the speed of the rebound
    drive: float  # relative change of the amplitude


SILENT: Final = Source(0.0, 0.0, 0.0, 0.0, 0.0)
STILL: Final = Draw(0.0, 0.0, 0.0)


def noise_of(strengths: Strengths | None, seed: int) -> Noise | None:
    """Return the noise of a base over which realizations have such noise; None without any."""
    if strengths is None:
        return None
    restitution, kick, drive = (None if values is None else 1 for values in strengths[:3])
    return Noise(restitution, kick, drive, key_of(seed))


@jit
def source_of(strengths: Strengths | None, end_count: Floats, i: int) -> Source:
    """Noise of realization i."""
    if strengths is None:
        return SILENT
    return Source(
        _entry(strengths.restitution, i),
        _entry(strengths.kick, i),
        _entry(strengths.drive, i),
        strengths.stream[i],
        end_count[i],
    )


@jit
def _entry(values: Floats | None, i: int) -> float:
    if values is None:
        return 0.0
    return values[i]  # type: ignore[no-any-return]


@jit
def period_of(n: float, x: float) -> float:
    """The forcing period that the phase x after n whole periods, from -1/2 to 1/2, lies in."""
    return n - (1.0 if x < 0.0 else 0.0)


@jit
def draw_of(
    noise: Noise | None, source: Source, particle: float, number: float, period: float
) -> Draw:
    """What is random in an impact of a particle, counted from 0, in a forcing period."""
    if noise is None:
        return STILL
    key, stream = noise.key, source.stream
    return Draw(
        _scaled(
            noise.restitution, source.restitution, key, stream, particle, number, OF_RESTITUTION
        ),
        _scaled(noise.kick, source.kick, key, stream, particle, number, OF_KICK),
        _scaled(noise.drive, source.drive, key, stream, 0.0, period, OF_DRIVE),
    )


@jit
def _scaled(
    on: int | None,
    size: float,
    key: Key,
    stream: float,
    particle: float,
    number: float,
    purpose: Word,
) -> float:
    if on is None:
        return 0.0
    return size * deviate(key, stream, particle, number, purpose)


@jit
def drawn_in(noise: Noise | None, s: Floats, j: int) -> Draw:
    """What is random in the next impact of lane j."""
    if noise is None:
        return STILL
    return Draw(
        _taken(noise.restitution, s, ROW.SLIP + j),
        _taken(noise.kick, s, ROW.PUSH + j),
        _taken(noise.drive, s, ROW.DRIVE + j),
    )


@jit
def _taken(on: int | None, s: Floats, place: int) -> float:
    if on is None:
        return 0.0
    return s[place]  # type: ignore[no-any-return]


@jit
def slipped(noise: Noise | None, e: float, slip: float) -> float:
    """Restitution of an impact, from 0 to 1."""
    if noise is None:
        return e
    moved = e + slip
    moved = moved if moved > 0.0 else 0.0
    return moved if moved < 1.0 else 1.0


@jit
def pushed(noise: Noise | None, kick: float, push: float) -> float:
    """Kick of an impact."""
    if noise is None:
        return kick
    return kick + push


@jit
def thrown(noise: Noise | None, w: float, push: float) -> float:
    """Speed above a base, which a particle cannot enter, after an impact with speed w."""
    if noise is None:
        return w
    return abs(w + push)


@jit
def slope_of(noise: Noise | None, share: float, q: float, draw: Draw, v: float) -> float:
    """Derivative of the speed above such a base after an impact by the speed v of arrival.

    Without noise the impact leaves a share of v, with the derivative q.
    """
    if noise is None:
        return q
    moved = slipped(noise, q, draw.slip)
    return -moved if slipped(noise, share, draw.slip) * v + draw.push < 0.0 else moved


@jit
def driven(noise: Noise | None, a: float, drive: float) -> float:
    """Amplitude of the kick in a forcing period."""
    if noise is None:
        return a
    return fma(a, drive, a)


@jit
def exceeds(noise: Noise | None, kick: float, r: float) -> bool:
    """Return whether the kick of a particle that has come to rest lifts it at once.

    Without noise of its own it would not have come to rest then.
    """
    if noise is None:
        return False
    return kick > r


@jit
def strongest(noise: Noise | None, a: float, source: Source) -> float:
    """Largest amplitude that any forcing period may have."""
    if noise is None:
        return a
    return fma(a, LARGEST * source.drive, a)


@jit
def lifted(
    noise: Noise | None, known: tuple[float, float], n: float, x: float
) -> tuple[float, float]:
    """Instant at which a particle is lifted that has come to rest at (n, x).

    The known one, but its own where the amplitude is random: `vibrosweep.kernels.bases.wake` finds
    it from there.  A rest for good has an infinite count, or no phase.
    """
    if noise is None:
        return known
    return _lifted(noise.drive, known, (n, x if known[1] == known[1] else np.nan))


@jit
def _lifted(
    on: int | None, known: tuple[float, float], own: tuple[float, float]
) -> tuple[float, float]:
    return known if on is None else own
