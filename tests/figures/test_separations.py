"""Figures of analyses refuse what is no result of them."""

import pytest
import xarray as xr

from vibrosweep.errors import DataError
from vibrosweep.figures.sensitivity import sobol_bars
from vibrosweep.figures.separations import decay_in_a_slot, separation_distributions

OTHER = xr.Dataset({"separation": ("particle", [1.0])})


def test_what_is_no_distribution_is_refused():
    with pytest.raises(DataError, match=r"result of separation_distribution.*cumulative_fraction"):
        separation_distributions([OTHER], ["other"], 1e-4)


def test_what_is_no_decay_is_refused():
    with pytest.raises(DataError, match=r"result of slot_decay.*modulus_predicted"):
        decay_in_a_slot(OTHER)


def test_what_holds_no_indices_is_refused():
    with pytest.raises(DataError, match=r"result of sobol\b.*first_order"):
        sobol_bars(OTHER)
