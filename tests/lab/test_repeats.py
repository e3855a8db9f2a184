"""Quantities of recordings refuse datasets that are not landings."""

import pytest
import xarray as xr

from vibrosweep.errors import DataError
from vibrosweep.lab.impacts import agreement, quantities

OTHER = xr.Dataset({"flight_time": 0.5})


def test_landings_that_were_not_found_are_refused():
    with pytest.raises(DataError, match=r"quantities takes the result of find_impacts.*quality"):
        quantities(OTHER)


def test_a_repeat_without_quantities_is_refused():
    with pytest.raises(DataError, match=r"agreement takes the result of quantities.*dt_min"):
        agreement([OTHER])
