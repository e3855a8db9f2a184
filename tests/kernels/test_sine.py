"""The sine of a reduced phase against proved balls."""

import numpy as np
import pytest
from flint import arb, ctx

from proved_pieces import sine
from vibrosweep.kernels.arithmetic import (
    LAG_ERROR,
    SINE_ERROR,
    rough_lag_and_versine,
    sin_and_lag,
    sin_turns,
)

QUARTERS = np.array([0.0, 0.125, 0.25, 0.375, 0.5])


def phases():
    """2 10^5 phases: everywhere, next to each fold and zero, and tiny."""
    rng = np.random.default_rng(5)
    steps = np.arange(-300, 301)[:, np.newaxis]
    near = (QUARTERS + steps * np.spacing(np.maximum(QUARTERS, 2.0**-60))).ravel()
    near = near[(near >= 0.0) & (near <= 0.5)]
    tiny = np.concatenate([2.0 ** -np.arange(1.0, 1075.0), 10.0 ** rng.uniform(-300, -1, 10_000)])
    folded = 0.5 - 10.0 ** rng.uniform(-16, -1, 10_000)
    positive = np.concatenate([near, tiny, folded, rng.uniform(0.0, 0.5, 80_000)])
    return np.concatenate([positive, -positive])


@pytest.fixture(scope="module")
def compared():
    """Phases, sines, and proved bounds of their errors: absolute, and in units in the last place.

    The place is that of the double nearest to the exact value.
    """
    x = phases()
    assert x.size > 200_000
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
    assert small.sum() > 5000
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
    assert exact.sum() > half // 2
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
