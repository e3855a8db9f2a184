"""The generator of normal deviates: known answers, errors, moments, and independence of streams."""

import math

import flint
import numpy as np
import pytest

from vibrosweep.kernels import noise
from vibrosweep.kernels._jit import kernel
from vibrosweep.kernels.noise import DEVIATE_ERROR, deviate, deviates, key_of, philox
from vibrosweep.model.parameters import STREAM_PARTICLES, STREAMS

# Random123's kat_vectors: counter, key and words of philox4x32 with 10 rounds
KNOWN = [
    ([0] * 4, [0] * 2, [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]),
    ([0xFFFFFFFF] * 4, [0xFFFFFFFF] * 2, [0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD]),
    (
        [0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344],
        [0xA4093822, 0x299F31D0],
        [0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1],
    ),
]


@kernel
def _words(given, key, found):
    for i in range(given.shape[0]):
        a, b, c, d = given[i]
        words = philox(a, b, c, d, key[i, 0], key[i, 1])
        for k in range(4):
            found[i, k] = words[k]


@kernel
def _many(key, stream, particle, number, found):
    for i in range(found.shape[1]):
        found[0, i], found[1, i] = deviates(key, stream, particle, number[i], noise.OF_KICK)


def drawn(numbers, stream=0.0, particle=0.0, seed=0):
    found = np.empty((2, len(numbers)))
    _many(key_of(seed), stream, particle, np.asarray(numbers, float), found)
    return found


def words_of(number, stream, particle, purpose, seed):
    """Words for one impact of a particle and a purpose, with the counter in Python's integers."""
    place = stream + (particle << 36) + (purpose << 62)
    counter = [number & 0xFFFFFFFF, number >> 32 & 0xFFFFFFFF, place & 0xFFFFFFFF, place >> 32]
    found = np.empty((1, 4), np.uint64)
    key = [[seed & 0xFFFFFFFF, seed >> 32]]
    _words(np.array([counter], np.uint64), np.array(key, np.uint64), found)
    return [int(word) for word in found[0]]


def exact(words):
    """Box and Muller's pair of deviates from four words, in ball arithmetic."""
    p, q = ((high << 32 | low) >> 12 for low, high in (words[:2], words[2:]))
    radius = (-2 * (1 - flint.arb(p) / 2**52).log()).sqrt()
    turns = flint.arb(q) / 2**52 - flint.arb("0.5")
    return radius * (2 * turns).cos_pi(), radius * (2 * turns).sin_pi()


def test_known_answers_of_the_generator():
    given, key, words = (np.array(column, np.uint64) for column in zip(*KNOWN, strict=True))
    found = np.empty_like(words)
    _words(given, key, found)
    assert (found == words).all()


@pytest.mark.parametrize(
    ("number", "stream", "particle", "seed"),
    [
        (0, 0, 0, 0),
        (1, 2, 3, 4),
        (2**50 - 1, STREAMS - 1, STREAM_PARTICLES - 1, 2**63 - 1),
        (-(2**50), 2**33 + 5, 7, 2**40 + 1),
        (range(200), 11, 12, 13),
    ],
)
def test_deviates_of_a_place_and_their_error(number, stream, particle, seed):
    numbers = number if isinstance(number, range) else [number]
    with flint.ctx.workprec(120):
        for given, values in zip(
            numbers, drawn(numbers, float(stream), float(particle), seed).T, strict=True
        ):
            pair = exact(words_of(given, stream, particle, 1, seed))
            for value, known in zip(values, pair, strict=True):
                error = abs(float(flint.arb(value) - known))
                assert error <= DEVIATE_ERROR * abs(float(known))


def test_no_deviate_exceeds_the_stated_largest():
    with flint.ctx.workprec(120):
        assert float((2 * 52 * flint.arb(2).log()).sqrt()) < noise.LARGEST


def test_impacts_take_the_deviates_of_a_pair_in_turn():
    first, second = drawn([3.0])
    key = key_of(0)
    assert deviate(key, 0.0, 0.0, 6.0, noise.OF_KICK) == first[0]
    assert deviate(key, 0.0, 0.0, 7.0, noise.OF_KICK) == second[0]


def test_moments_and_correlations():
    """For 2 * 10^5 deviates, all are within four standard errors."""
    z = drawn(np.arange(1e5)).ravel()
    for power, mean, variance in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96)):
        assert abs((z**power).mean() - mean) < 4 * math.sqrt(variance / z.size)
    others = [drawn(np.arange(1e5), *place).ravel() for place in ((1.0,), (0.0, 1.0))]
    others += [drawn(np.arange(1e5), seed=1).ravel(), np.roll(z, 1), np.roll(z, z.size // 2)]
    for other in others:
        assert abs((z * other).mean()) < 4 / math.sqrt(z.size)
