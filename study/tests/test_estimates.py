"""Intervals against their definitions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from study.estimates import Estimate, exact, magnitude, mean, share

ENDS = st.floats(-1e3, 1e3)


@pytest.mark.parametrize(("count", "size"), [(0, 20), (7, 20), (20, 20), (1, 1)])
def test_the_ends_of_a_share_are_where_the_score_test_turns(count, size):
    """Wilson: |p' - p| = z sqrt(p (1 - p) / n) at both ends p, except where p is 0 or 1."""
    found = share(np.arange(size) < count)
    assert found.value == count / size
    for end in {found.low, found.high} - {0.0, 1.0}:
        score = (found.value - end) / math.sqrt(end * (1.0 - end) / size)
        assert abs(score) == pytest.approx(norm.ppf(0.975), rel=1e-9)


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=30))
def test_what_is_not_known_counts_neither_as_false_nor_as_true(rows):
    flags, known = (np.array(column) for column in zip(*rows, strict=True))
    found = share(flags, known)
    least, most = share(flags & known), share(flags | ~known)
    assert (found.low, found.high) == (least.low, most.high)
    assert math.isnan(found.value) == (not known.all())
    assert known.any() or (found.low < 1e-12 and found.high > 1.0 - 1e-12)


def test_no_cases_give_no_share_and_one_seed_gives_no_interval():
    for found in (share([]), mean([1.0]), mean([1.0, math.nan]), mean([1.0, 2.0] + [math.nan] * 3)):
        assert math.isnan(found.low)
        assert math.isnan(found.high)


def test_the_interval_of_a_mean_is_students():
    # the quantile for 2 degrees of freedom has a closed form; scipy's is good to 1e-10
    two_sided = 0.95 * math.sqrt(2.0 / (1.0 - 0.95**2))
    found = mean([1.0, 2.0, 3.0])
    assert found.value == 2.0
    assert found.high - 2.0 == pytest.approx(two_sided / math.sqrt(3.0), rel=1e-9)
    assert 2.0 - found.low == pytest.approx(found.high - 2.0, rel=1e-12)


def test_a_mean_leaves_out_unknown_values_and_counts_the_others():
    assert mean([1.0, math.nan, 2.0, 3.0]) == mean([1.0, 2.0, 3.0])
    assert mean([1.0, math.nan, 2.0]).cases == 2


def test_a_bound_of_the_number_cuts_off_its_interval():
    found = mean([0.0, 0.0, 1.0], least=0.0)
    assert (found.low, found.high) == (0.0, mean([0.0, 0.0, 1.0]).high)


@given(ENDS, ENDS, st.floats(0.0, 1.0))
def test_a_magnitude_holds_that_of_every_number_in_the_interval(one, other, part):
    low, high = sorted((one, other))
    found = magnitude(Estimate(low, low, high))
    inside = abs(min(max(low + part * (high - low), low), high))
    assert found.low <= inside <= found.high
    assert found.low in (0.0, abs(low), abs(high))


def test_a_number_without_doubt_has_no_width():
    assert exact(2) == Estimate(2.0, 2.0, 2.0)
    assert exact(Estimate(1.0, 0.0, 2.0)) == Estimate(1.0, 0.0, 2.0)
