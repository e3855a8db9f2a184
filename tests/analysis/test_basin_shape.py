"""Measures of basins against cases whose values are known."""

import math

import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.analysis.basins import basin_measures, share_interval

SPEEDS = np.linspace(0.0, 10.0, 200)


def measures(index, speeds=SPEEDS):
    return {name: value[1] for name, value in basin_measures(np.asarray(index), speeds).items()}


def test_one_basin_has_no_entropy_and_no_boundary():
    found = measures(np.zeros((200, 50), int))
    assert found["basin_entropy"] == 0.0
    assert math.isnan(found["boundary_entropy"])
    assert math.isnan(found["uncertainty_exponent"])


def test_a_smooth_boundary_has_the_exponent_one():
    """The share of launches within some distance of a line grows with that distance."""
    index = (SPEEDS[:, np.newaxis] > 5.1 + 0.0 * np.arange(50)).astype(int)
    found = measures(index)
    assert found["uncertainty_exponent"] == pytest.approx(1.0, abs=1e-12)
    assert 0.0 < found["boundary_entropy"] <= math.log(2.0)


def test_basins_mixed_at_random_have_the_exponent_zero_and_the_entropy_of_a_coin():
    index = np.random.default_rng(1).integers(0, 2, (200, 400))
    found = measures(index)
    assert found["uncertainty_exponent"] == pytest.approx(0.0, abs=0.01)
    # mean of the entropy of 25 fair coins: log 2 less 1 / (2 * 25), to first order
    assert found["basin_entropy"] == pytest.approx(math.log(2.0) - 0.02, abs=2e-3)


def test_unsettled_launches_are_no_attractor():
    index = -np.random.default_rng(2).integers(0, 2, (200, 50))
    found = measures(index)
    assert found["basin_entropy"] == 0.0
    assert found["unsettled_fraction"] == pytest.approx((index == -1).mean())


def test_intervals_hold_the_share_and_stay_within_0_and_1():
    ends = share_interval(np.array([0, 3, 10]), 10)
    assert (ends["low"] <= [0.0, 0.3, 1.0]).all()
    assert (ends["high"] >= [0.0, 0.3, 1.0]).all()
    assert ends["low"][0] == 0.0 < ends["high"][0]
    assert ends["high"][2] == 1.0 > ends["low"][2]


def test_uneven_or_few_speeds_have_no_exponent():
    index = np.random.default_rng(3).integers(0, 2, (200, 50))
    assert math.isnan(measures(index, speeds=SPEEDS**2)["uncertainty_exponent"])
    assert math.isnan(measures(index[:20], speeds=SPEEDS[:20])["uncertainty_exponent"])


def test_basins_hold_the_measures():
    found = vs.basins(launch_velocity=[3.0, 4.0, 5.0], particles=20, duration=2000.0)
    assert (found.fraction_low <= found.fraction).all()
    assert (found.fraction_high >= found.fraction).all()
    assert float(found.unsettled_fraction) == 0.0
