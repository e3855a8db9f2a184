"""Capacity: slots of known attractors."""

import numpy as np
import pytest
import xarray as xr

from tests.scans import basins
from vibrosweep.analysis.basins import capacity
from vibrosweep.errors import DataError
from vibrosweep.scene.sweep import keyword_spec


def test_table_1_has_three_slots_to_lock_in():
    # modes 1 and 2 exist (a / (1 - e) = 2.4): one slot and two; the orbit with rests has one
    found = capacity(
        basins(
            keyword_spec({"duration": 4000.0}).scene, np.arange(20) / 20, np.linspace(1.0, 11.0, 11)
        )
    )
    assert int(found["capacity_without_rests"]) == 3
    assert int(found["capacity"]) == 4
    assert float(found["unsettled_fraction"]) == 0.0
    assert sorted(found["slots"].values) == [1, 1, 2]


def test_without_excitation_there_is_no_slot():
    found = capacity(
        basins(keyword_spec({"amplitude": 0.0, "duration": 100.0}).scene, [0.0], [1.0, 5.0])
    )
    assert int(found["capacity"]) == 0
    assert float(found["unsettled_fraction"]) == 1.0


def test_a_missing_variable_is_named():
    with pytest.raises(DataError, match=r"^capacity .*basins.*cycle_periods"):
        capacity(xr.Dataset({"regime": ("attractor", [2])}))
