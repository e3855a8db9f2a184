"""Noise of a realization: its normal deviates, and their effects on an impact."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from vibrosweep.kernels import arithmetic
from vibrosweep.kernels._jit import Floats, fma, jit, kernel
from vibrosweep.kernels.memory import ROW
from vibrosweep.model.parameters import Strengths

__all__ = ["LARGEST", "OF_DRIVE", "OF_KICK", "OF_RESTITUTION", "Word", "draw", "key_of"]

# --- Normal deviates ------------------------------------------------------------------------------
# The generator is Philox 4x32-10 (Salmon, Moraes, Dror & Shaw, SC'11): ten rounds that turn a
# counter of four 32-bit words, with the seed as its key, into four others.  No state is stored, so
# that no deviate depends on threads, chunks, the order of computation, or what was computed before.
#
#     word 0, 1    low and high 32 bits of floor(number / 2); the number is that of the impact of
#                  the particle, from 0, or of the forcing period; a counter gives two deviates
#     word 2, 3    stream + 2^36 particle + 2^62 purpose, low and high half
#
# The four words are two fractions of 52 bits, p and q in [0, 1), and with the radius sqrt(-2 ln(1 -
# p)) the two deviates are its products with the cosine and the sine of 2 pi (q - 1/2) (Box & Muller
# 1958), at most `LARGEST` in modulus.  The arithmetic is that of every kernel: the same bits come
# from plain Python and from vectors of any width.


LARGEST: Final = 8.4908  # sqrt(2 * 52 ln 2), rounded up: the largest modulus of a deviate
# Relative error of a deviate against Box and Muller's formula for its two fractions: half of that
# of the logarithm, the root, the sine (the phase of the cosine is exact here) and the product.
DEVIATE_ERROR: Final = (
    0.5 * arithmetic.ERRORS["log"] + arithmetic.SINE_ERROR + 2.1 * arithmetic.HALF_ULP
)

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
    f, k = arithmetic.mantissa_and_exponent(2.0 - _near_one(words[0], words[1]))
    radius = math.sqrt(-2.0 * arithmetic.log_near_one(f, k))
    turns = _near_one(words[2], words[3]) - 1.5
    return radius * arithmetic.cos_turns(turns), radius * arithmetic.sin_turns(turns)


@jit
def _integer(value: float) -> int:
    """Convert a float below 2^51 that is an integer, by instructions that all vectors have."""
    return np.float64(value + arithmetic.SHIFT).view(np.int64) - arithmetic.SHIFT_BITS  # type: ignore[return-value]


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


# --- Effects on an impact -------------------------------------------------------------------------
# Each function does nothing where its first argument, the field `noise` of a base, or the kind of
# noise that it needs, is None.  These are known when a kernel is compiled, and a function that does
# nothing leaves no machine code.


class Noise(NamedTuple):
    """The field `noise` of a base: which quantities are random, each 1 or None, and the seed."""

    restitution: int | None
    kick: int | None
    drive: int | None
    key: Key


class Source(NamedTuple):
    """Noise of one realization, in its constants; zeros where nothing is random."""

    restitution: float
    kick: float
    drive: float
    stream: float
    end: float  # whole periods at the end of the observation, from which n may count
    turns: float  # whole turns in the phase of the forcing at t = 0, which n leaves out


class Draw(NamedTuple):
    """Random numbers of one impact; zeros where nothing is random."""

    restitution: float  # added to that of the law
    kick: float  # added to the speed of the rebound
    drive: float  # relative change of the amplitude


SILENT: Final = Source(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
STILL: Final = Draw(0.0, 0.0, 0.0)


def noise_of(strengths: Strengths | None, seed: int) -> Noise | None:
    """Return the noise of a base with such strengths in its realizations; None if it has none."""
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
        strengths.turns[i],
    )


@jit
def _entry(values: Floats | None, i: int) -> float:
    if values is None:
        return 0.0
    return values[i]  # type: ignore[no-any-return]


@jit
def period_of(n: float, x: float) -> float:
    """Return the number of the forcing period of the instant (n, x), x from -1/2 to 1/2."""
    return n - (1.0 if x < 0.0 else 0.0)


@jit
def draw_of(
    noise: Noise | None, source: Source, particle: float, number: float, period: float
) -> Draw:
    """Random numbers of an impact of a particle, counted from 0, in a forcing period."""
    if noise is None:
        return STILL
    key, stream, restitution, kick, drive = noise.key, source.stream, 0.0, 0.0, 0.0
    if noise.restitution is not None:
        restitution = source.restitution * deviate(key, stream, particle, number, OF_RESTITUTION)
    if noise.kick is not None:
        kick = source.kick * deviate(key, stream, particle, number, OF_KICK)
    if noise.drive is not None:
        drive = source.drive * deviate(key, stream, 0.0, period, OF_DRIVE)
    return Draw(restitution, kick, drive)


@jit
def every_pass(noise: Noise | None) -> float:
    """Return 1 where each lane has an impact in every pass, 0 where some may wait in a rest."""
    if noise is None:
        return 1.0
    return 1.0 if noise.drive is None else 0.0


@jit
def lands_now(noise: Noise | None, s: Floats, j: int) -> bool:
    """Return whether lane j lands in this pass; with noise of the drive it may be at rest."""
    if noise is None:
        return True
    return bool(noise.drive is None or s[ROW.RESTING + j] == 0.0)


@jit
def count_impact(noise: Noise | None, s: Floats, j: int, landed: bool) -> None:
    """Count an impact of lane j, where not every pass is one."""
    if noise is not None and noise.drive is not None:
        s[ROW.AGE + j] += 1.0 if landed else 0.0


@jit
def drawn_in(noise: Noise | None, s: Floats, j: int) -> Draw:
    """Random numbers of the next impact of lane j."""
    if noise is None:
        return STILL
    return Draw(
        0.0 if noise.restitution is None else s[ROW.RESTITUTION_DRAWN + j],
        0.0 if noise.kick is None else s[ROW.KICK_DRAWN + j],
        0.0 if noise.drive is None else s[ROW.DRIVE_DRAWN + j],
    )


@jit
def noisy_restitution(noise: Noise | None, e: float, drawn: float) -> float:
    """Restitution of an impact, from 0 to 1."""
    if noise is None:
        return e
    moved = e + drawn
    moved = moved if moved > 0.0 else 0.0
    return moved if moved < 1.0 else 1.0


@jit
def noisy_slope(noise: Noise | None, share: float, q: float, drawn: float) -> float:
    """Slope of the speed after an impact, whose law leaves a share of v with the slope q."""
    if noise is None:
        return q
    moved = share + drawn
    within = q + drawn if moved > 0.0 else 0.0
    return within if moved < 1.0 else 1.0


@jit
def noisy_kick(noise: Noise | None, kick: float, drawn: float) -> float:
    """Kick of an impact."""
    if noise is None:
        return kick
    return kick + drawn


@jit
def noisy_rebound(noise: Noise | None, w: float, drawn: float) -> float:
    """Speed relative to a moving base, which a particle cannot enter, after a rebound with w."""
    if noise is None:
        return w
    return abs(w + drawn)


@jit
def noisy_rebound_slope(noise: Noise | None, share: float, q: float, draw: Draw, v: float) -> float:
    """Derivative of the speed of `noisy_rebound` by the speed v of arrival.

    The law leaves a share of v, with the slope q.
    """
    if noise is None:
        return q
    moved = noisy_slope(noise, share, q, draw.restitution)
    return (
        -moved if noisy_restitution(noise, share, draw.restitution) * v + draw.kick < 0.0 else moved
    )


@jit
def noisy_amplitude(noise: Noise | None, a: float, drive: float) -> float:
    """Amplitude of the kick in a forcing period."""
    if noise is None:
        return a
    return fma(a, drive, a)


@jit
def amplitude_change(noise: Noise | None, a: float, drive: float) -> float:
    """Modulus of the change by noise of the drive that turned the nominal amplitude into a."""
    if noise is None:
        return 0.0
    return 0.0 if noise.drive is None else abs(a * (drive / (1.0 + drive)))


@jit
def rounding(noise: Noise | None, share: float, v: float, draw: Draw, kick: float = 0.0) -> float:
    """Bound of the rounding that noise adds to the speed after an impact, apart from the amplitude.

    The random parts of restitution and kick are products; the strength of the kick has five
    roundings, a relative one of the restitution has one; each part is added to the number that it
    changes.
    """
    if noise is None:
        return 0.0
    of_share = 3.0 * abs(draw.restitution) + 2.0 * share
    return arithmetic.HALF_ULP * (of_share * abs(v) + 8.0 * abs(draw.kick) + abs(kick))


@jit
def clip_is_doubtful(noise: Noise | None, share: float, drawn: float, error: float) -> bool:
    """Return whether the relative error of a speed may decide if its restitution is clipped.

    The relative change of the restitution of a law does not exceed that of the speed.
    """
    if noise is None:
        return False
    moved = share + drawn
    return noise.restitution is not None and not min(abs(moved), abs(moved - 1.0)) > 4.0 * error


@jit
def period_is_doubtful(noise: Noise | None, x: float, error: float) -> bool:
    """Return whether an error of a phase decides in which forcing period it lies."""
    if noise is None:
        return False
    return noise.drive is not None and abs(x) <= error


@jit
def lifts_at_once(noise: Noise | None, kick: float, r: float) -> bool:
    """Return whether the kick of a particle that has come to rest lifts it at once.

    Without noise such a particle would not have come to rest.
    """
    if noise is None:
        return False
    return kick > r


@jit
def strongest_kick(noise: Noise | None, up: float, down: float, source: Source) -> float:
    """Largest kick of any forcing period, where without noise they are between -down and up."""
    if noise is None:
        return up
    change = LARGEST * source.drive
    return max(fma(up, change, up), fma(down, change, -down))


@jit
def noisy_lift_off(
    noise: Noise | None, known: tuple[float, float], n: float, x: float
) -> tuple[float, float]:
    """Return the instant at which a particle that comes to rest at (n, x) lifts off.

    This is `known`, unless the amplitude is random: then it is the instant of the landing, from
    which `vibrosweep.kernels.bases.later_lift_off` searches.  A rest for good has an infinite
    count, or the phase NaN.
    """
    if noise is None:
        return known
    return known if noise.drive is None else (n, x)
