"""Turns of an angle that grows with time, against exact arithmetic."""

from fractions import Fraction

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from vibrosweep.model.turns import reduced_turns


def turns_off(count, phase, exact):
    """Distance in turns between the sum of count and phase and the exact value."""
    return abs(Fraction(float(count)) + Fraction(float(phase)) - exact)


@given(
    rate=st.floats(1e-3, 1e3),
    time=st.floats(-1e12, 1e12, allow_subnormal=False),
    offset=st.floats(-0.5, 0.5, allow_subnormal=False),
)
@example(rate=0.1, time=1e9 / 0.1, offset=0.0)
@example(rate=1.0, time=1e9, offset=-0.5)
@example(rate=3.0, time=2.5, offset=0.5)
def test_reduced_turns_keep_the_phase_of_any_time(rate, time, offset):
    count, phase = reduced_turns(rate, time, offset)
    exact = Fraction(rate) * Fraction(time) + Fraction(offset)
    assert float(count).is_integer()
    assert -0.5 <= phase <= 0.5
    # two sums below 1 are rounded: the error of the product itself is carried along
    assert turns_off(count, phase, exact) <= Fraction(3, 2**54)


@given(
    time=st.integers(-(2**60), 2**60).map(lambda n: n / 2**20),
    exponent=st.integers(-8, 8),
)
def test_reduced_turns_of_dyadic_numbers_are_exact(time, exponent):
    rate = 2.0**exponent
    count, phase = reduced_turns(rate, time, 0.0)
    assert turns_off(count, phase, Fraction(rate) * Fraction(time)) == 0


def test_reduced_turns_broadcast():
    count, phase = reduced_turns(np.array([[1.0], [2.0]]), np.array([0.25, 1.0, -1.75]), 0.0)
    assert np.array_equal(count, [[0, 1, -2], [0, 2, -4]])
    assert np.array_equal(phase, [[0.25, 0, 0.25], [0.5, 0, 0.5]])
