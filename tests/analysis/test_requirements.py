"""A dataset that lacks what an analysis needs: the message names variable and key."""

import pytest
import xarray as xr

from vibrosweep.analysis.datasets import remedy, require
from vibrosweep.errors import DataError


def test_variables_that_are_present_pass():
    dataset = xr.Dataset({"dt_min": ("realization", [1.0])}, coords={"amplitude": 1.2})
    require(dataset, "separation statistics", "dt_min", "amplitude")


def test_each_missing_variable_is_named_with_its_key():
    dataset = xr.Dataset({"impact_count": ("realization", [1])})
    with pytest.raises(DataError) as caught:
        require(dataset, "separation statistics", "impact_count", "dt_min", "cycle_impacts")
    message = str(caught.value)
    assert "separation statistics" in message
    assert "dt_min (set separation = true in the [measure] section" in message
    assert "cycle_impacts (set regimes = true in the [measure] section" in message
    assert "impact_count" not in message


def test_the_function_is_named_whose_result_is_taken():
    basins = xr.Dataset({"regime": ("attractor", [2])})
    with pytest.raises(DataError, match=r"^capacity .*basins.*fraction$"):
        require(basins, "capacity", "regime", "fraction", source="basins")


def test_landings_come_from_a_record():
    assert "[record]" in remedy("landing_time")
