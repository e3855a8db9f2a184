"""Logarithm, exponential and arcsine: special values, inverses, the same bits, proved bounds."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from vibrosweep.kernels import arithmetic
from vibrosweep.model.turns import arcsin_turns


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


def test_proved_bounds():
    pytest.importorskip("flint")
    from elementary_error import STATED, check_schemes, families, prove, sample
    from vibrosweep.kernels.arithmetic import HALF_ULP

    check_schemes()
    proved = prove()
    for name, arguments in families(300, seed=3).items():
        assert (
            sample(name, arguments) <= proved[name] <= STATED[name] / HALF_ULP <= 1.1 * proved[name]
        )
