"""Times in forcing periods end where they should, in every realization."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibrosweep.model.parameters import (
    MAX_PERIODS,
    PARAMETERS,
    Periods,
    dimensionless,
    in_periods,
    in_seconds,
    precedes,
    representable,
)

PERIODS = st.floats(1e-3, 1e9)


def parameters(**changed):
    own = {name: np.array([p.default]) for name, p in PARAMETERS.items()}
    return own | {name: np.array([value]) for name, value in changed.items()}


@given(number=PERIODS, begin=PERIODS, phase=st.floats(-9.0, 9.0))
def test_at_one_hertz_periods_are_seconds_to_the_bit(number, begin, phase):
    own = parameters(phase=phase)
    one, other = (
        dimensionless(own, number, begin),
        dimensionless(own, Periods(number), Periods(begin)),
    )
    assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


@given(number=PERIODS, frequency=st.floats(1e-3, 1e4))
def test_the_end_is_that_many_periods_at_any_frequency(number, frequency):
    found = dimensionless(parameters(frequency=frequency), Periods(number))
    assert Fraction(found.end_count.item()) + Fraction(found.end_phase.item()) == Fraction(number)


@given(number=PERIODS, frequency=st.floats(1e-3, 1e4))
def test_periods_and_seconds_are_one_time(number, frequency):
    f = np.array([frequency])
    seconds = in_seconds(Periods(number), f).item()
    assert in_periods(seconds, f).item() == pytest.approx(number, rel=1e-15)
    assert precedes(Periods(number), 1.001 * seconds, f)
    assert not precedes(1.001 * seconds, Periods(number), f)


def test_periods_are_counted_whatever_the_frequency():
    own = {n: np.repeat(v, 2) for n, v in parameters().items()} | {
        "frequency": np.array([1e-9, 1e9])
    }
    assert representable(own, [1e3, Periods(MAX_PERIODS)]).tolist() == [True, True]
    assert representable(own, [1e7, Periods(MAX_PERIODS)]).tolist() == [True, False]
    assert representable(own, [1e3, Periods(2.0 * MAX_PERIODS)]).tolist() == [False, False]


def test_an_amplitude_that_is_too_large_is_not_representable():
    assert not representable(parameters(amplitude=1e31), [1.0]).any()
