"""Sine, logarithm and exponential with proved errors, and random deviates."""

import math

import flint
import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from elementary_error import STATED, check_schemes, families, prove, sample
from proved_pieces import sine
from tests.cases import each_of
from vibrosweep.kernels import arithmetic, noise
from vibrosweep.kernels._jit import kernel
from vibrosweep.kernels.arithmetic import (
    HALF_ULP,
    LAG_ERROR,
    SINE_ERROR,
    rough_lag_and_versine,
    sin_and_lag,
    sin_turns,
)
from vibrosweep.kernels.noise import DEVIATE_ERROR, deviate, deviates, key_of, philox
from vibrosweep.model.parameters import STREAM_PARTICLES, STREAMS, arcsin_turns

# The sine of a reduced phase against proved balls.

QUARTERS = np.array([0.0, 0.125, 0.25, 0.375, 0.5])


def phases():
    """Phases everywhere, next to each fold and zero, and tiny; `checks/sine_error.py` has more."""
    rng = np.random.default_rng(5)
    steps = np.arange(-75, 76)[:, np.newaxis]
    near = (QUARTERS + steps * np.spacing(np.maximum(QUARTERS, 2.0**-60))).ravel()
    near = near[(near >= 0.0) & (near <= 0.5)]
    tiny = np.concatenate([2.0 ** -np.arange(1.0, 1075.0), 10.0 ** rng.uniform(-300, -1, 500)])
    folded = 0.5 - 10.0 ** rng.uniform(-16, -1, 500)
    positive = np.concatenate([near, tiny, folded, rng.uniform(0.0, 0.5, 4_000)])
    return np.concatenate([positive, -positive])


@pytest.fixture(scope="module")
def compared():
    """Phases, sines, and proved bounds of their errors: absolute, and in units in the last place.

    The place is that of the double nearest to the exact value.
    """
    x = phases()
    assert x.size > 10_000
    found = np.array([sin_turns(turns) for turns in x.tolist()])
    exact, error = np.empty(x.size), np.empty(x.size)
    for i, (turns, value) in enumerate(zip(x.tolist(), found.tolist(), strict=True)):
        ball = sine(turns, bits=128)
        exact[i] = float(ball)
        error[i] = float(abs(ball - value).abs_upper())
    return x, found, error, error / np.spacing(np.abs(exact))


def test_absolute_error(compared):
    # below 1 the last rounding is half an ulp, 2^-54, at most; the product that is added there
    # (up to 0.57) and its factor are rounded once each: 2.33e-16 was seen
    *_, error, _ = compared
    assert error.max() < 2.4e-16


def test_error_in_units_of_the_last_place(compared):
    # the same roundings, of results just above a power of two: 2.09 was seen
    *_, places = compared
    assert places.max() < 2.25


def test_the_relative_error_is_within_that_of_the_error_bounds(compared):
    x, found, error, _ = compared
    normal = np.abs(x) > 2.0**-1000
    assert np.all(error[normal] <= SINE_ERROR * np.abs(found[normal]))


def test_small_phases_are_rounded_almost_exactly(compared):
    # the polynomial is its first coefficient, which is kept as a sum of two doubles
    x, *_, places = compared
    small = (np.abs(x) < 2.0**-30) & (np.abs(x) > 2.0**-1000)
    assert small.sum() > 3000
    assert places[small].max() < 0.51


def test_zeros_and_peaks():
    assert [sin_turns(x) for x in (0.0, 0.5, -0.5)] == [0.0, 0.0, 0.0]
    assert sin_turns(0.25) == 1.0
    assert sin_turns(-0.25) == -1.0


def test_no_sine_is_larger_than_one_by_more_than_a_rounding(compared):
    _, found, *_ = compared
    assert np.abs(found).max() <= 1.0 + 2.0**-52


def test_the_sine_is_odd_and_folds_about_its_peak(compared):
    x, found, *_ = compared
    half = x.size // 2
    assert np.array_equal(found[:half], -found[half:])
    folded = 0.5 - x[:half]
    exact = 0.5 - folded == x[:half]
    assert exact.sum() > half // 4
    mirrored = np.array([sin_turns(turns) for turns in folded[exact].tolist()])
    assert np.array_equal(mirrored, found[:half][exact])


def test_the_lag_of_a_sine_behind_its_angle():
    rng = np.random.default_rng(6)
    around = 0.25 + np.arange(-200, 201) * 2.0**-50
    s = np.concatenate(
        [10.0 ** rng.uniform(-9.0, 1.0, 5_000), rng.uniform(0.2, 3.0, 5_000), around]
    )
    with ctx.workprec(256):
        for time in s.tolist():
            turned, lag = sin_and_lag(time, time - float(np.rint(time)))
            exact = (2 * arb(time)).sin_pi()
            assert float(abs(exact - turned).abs_upper()) <= SINE_ERROR * float(
                abs(exact).abs_upper()
            )
            exact = 2 * arb.pi() * arb(time) - exact
            assert float(abs(lag / exact - 1).abs_upper()) <= LAG_ERROR


def test_rough_terms_are_as_good_as_they_say():
    with ctx.workprec(128):
        for turns in np.linspace(1e-6, 0.5, 2000).tolist():
            lag, versine = rough_lag_and_versine(turns)
            exact = 2 * arb.pi() * arb(turns) - (2 * arb(turns)).sin_pi()
            assert float(abs(lag / exact - 1).abs_upper()) <= 1.3e-5
            exact = 2 * arb(turns).sin_pi() ** 2
            assert float(abs(versine / exact - 1).abs_upper()) <= 5.3e-5
            assert rough_lag_and_versine(-turns) == (-lag, versine)


# Logarithm, exponential and arcsine: special values, inverses, the same bits, proved bounds.


@njit(error_model="numpy")
def compiled(x):
    found = np.empty((3, x.size))
    for i in range(x.size):
        found[0, i] = arithmetic.log(x[i])
        found[1, i] = arithmetic.exp(x[i])
        found[2, i] = arithmetic.expm1(x[i])
    return found


def test_special_values():
    x = np.array([0.0, 1.0, -1.0, np.inf, -np.inf, np.nan])
    log, exp, expm1 = compiled(x)
    np.testing.assert_array_equal(log, [-np.inf, 0.0, np.nan, np.inf, np.nan, np.nan])
    np.testing.assert_array_equal(exp[[0, 3, 4, 5]], [1.0, np.inf, 0.0, np.nan])
    np.testing.assert_array_equal(expm1[[0, 4, 5]], [0.0, -1.0, np.nan])
    np.testing.assert_array_equal(arcsin_turns(np.array([0.0, 1.0])), [0.0, 0.25])
    assert arithmetic.log(5e-324) == pytest.approx(-1074.0 * math.log(2.0), rel=1e-15)
    assert arithmetic.exp(-745.0) == 5e-324
    assert arithmetic.exp(710.0) == np.inf


@given(st.floats(-700.0, 700.0))
def test_exponential_and_logarithm_are_inverse(x):
    assert arithmetic.log(arithmetic.exp(x)) == pytest.approx(x, rel=1e-15, abs=4e-16)
    assert arithmetic.expm1(x) == pytest.approx(math.expm1(x), rel=1e-15)


@given(st.floats(0.0, 1.0))
def test_the_sine_of_the_arcsine(x):
    phase = arcsin_turns(x)
    assert 0.0 <= phase <= 0.25
    assert math.sin(2.0 * math.pi * phase) == pytest.approx(x, rel=2e-15)


def test_an_array_and_its_single_numbers_give_the_same_bits():
    x = np.random.default_rng(1).uniform(0.0, 1.0, 1000)
    found = arcsin_turns(x)
    assert found.tolist() == [arcsin_turns(one) for one in x]
    number = njit(arcsin_turns)
    assert found.tolist() == [number(one) for one in x]


def test_errors_of_the_elementary_functions_are_below_those_stated():
    for name, arguments in families(300, seed=3).items():
        assert sample(name, arguments) <= STATED[name] / HALF_ULP


@pytest.mark.weekly
def test_proved_bounds():
    check_schemes()
    proved = prove()
    for name, arguments in families(100, seed=3).items():
        assert (
            sample(name, arguments) <= proved[name] <= STATED[name] / HALF_ULP <= 1.1 * proved[name]
        )


# The generator of normal deviates: known answers, errors, moments, and independence of streams.

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


@each_of(
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
