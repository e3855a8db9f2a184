"""Smallest gaps in a list of landings, against all pairs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibrosweep.kernels.ordering import (
    FARTHEST,
    NARROWEST,
    ORDERED,
    closest,
    put_in_order,
    workspace,
)


def listed(whole, phase, who):
    """A list that holds these landings, and room for cells."""
    work = workspace(len(who))
    work.listed[:ORDERED, : len(who)] = whole, phase, np.zeros(len(who)), who
    return work.listed, work.cells


def all_pairs(whole, phase, who):
    apart = np.abs(np.subtract.outer(whole, whole) + np.subtract.outer(phase, phase))
    inside = (who >= 0)[:, None] & (who >= 0) & ~np.eye(len(who), dtype=bool)
    return np.min(apart, where=inside, initial=np.inf)


@st.composite
def landings(draw):
    """Landings, each of another particle, alone, in clusters and at the same instant."""
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    number = draw(st.integers(2, 200))
    centres = rng.uniform(-0.5, 0.5, draw(st.integers(1, number)))
    width = 10.0 ** -draw(st.integers(0, 17))
    phase = rng.choice(centres, number) + width * rng.uniform(-0.5, 0.5, number)
    phase = np.clip(phase, -0.5, 0.5)
    whole = -1e6 + np.round(rng.uniform(0, draw(st.sampled_from([0.0, 2.0, 300.0])), number))
    early = rng.random(number) < draw(st.sampled_from([0.0, 0.0, 0.5, 1.0]))
    who = np.where(early, -1 - np.arange(number), np.arange(number))
    return whole, phase, who


@given(landings(), st.floats(-14.0, 1.0))
def test_the_closest_of_landings_that_are_not_in_order(given_landings, exponent):
    whole, phase, who = given_landings
    gap = 10.0**exponent
    found = closest(*listed(whole, phase, who), len(who), gap)
    if gap < NARROWEST:
        assert np.isnan(found)
    else:
        assert found == min(gap, all_pairs(whole, phase, who))


@pytest.mark.parametrize("gap", [np.inf, 0.0, NARROWEST / 2])
def test_gaps_that_only_sorted_landings_can_give_are_nan(gap):
    phase = np.linspace(-0.4, 0.4, 9)
    assert np.isnan(closest(*listed(np.zeros(9), phase, np.arange(9)), 9, gap))


def test_the_gap_of_landings_that_are_too_far_apart_is_nan():
    whole = np.array([0.0, FARTHEST + 1.0])
    assert np.isnan(closest(*listed(whole, np.zeros(2), np.arange(2)), 2, 0.1))


@given(landings(), st.floats(0.0, 400.0))
def test_any_cells_give_the_order_of_time(given_landings, span):
    whole, phase, who = given_landings
    landings_listed, cells = listed(whole, phase, who)
    put_in_order(landings_listed, cells, len(who), whole[0], phase[0], span)
    ordered = landings_listed[ORDERED:, : len(who)]
    assert sorted(ordered[3]) == sorted(who)
    assert np.all(np.diff(ordered[0]) + np.diff(ordered[1]) >= 0.0)
    for values, original in zip(ordered[:2], (whole, phase), strict=True):
        place = np.argsort(who)
        assert np.array_equal(values[np.argsort(ordered[3])], original[place])
