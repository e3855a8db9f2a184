"""Figures of analyses refuse datasets that are not their results."""

import numpy as np
import pytest
import xarray as xr

from vibrosweep.errors import DataError
from vibrosweep.figures.registry import FIGURES
from vibrosweep.figures.sweeps import (
    separation_distributions,
    separations_over_chance,
    sobol_bars,
)

FLAGS = {"flag_values": np.array([-1, 0, 1], np.int8), "flag_meanings": "a b c"}
OTHER = xr.Dataset({"separation": ("particle", [1.0])})


def test_a_dataset_that_is_no_distribution_is_refused():
    with pytest.raises(DataError, match=r"result of separation_distribution.*cumulative_fraction"):
        separation_distributions([OTHER], ["other"], 1e-4)


def test_a_dataset_that_is_not_compared_with_chance_is_refused():
    with pytest.raises(DataError, match=r"result of separations_against.*dt_min_over_chance"):
        separations_over_chance([OTHER], ["other"])


def test_realizations_without_chance_are_left_out_and_counted():
    z = xr.Dataset({"dt_min_over_chance": ("realization", [20.0, np.nan, 0.0])})
    nowhere = z.isel(realization=[1])
    axes = separations_over_chance([z, nowhere], ["some", "none"])
    some, none, chance = axes.lines
    np.testing.assert_array_equal(some.get_xdata(), [1e-3, 1e-3, 20.0, 20.0])
    np.testing.assert_array_equal(some.get_ydata(), [0.0, 0.5, 1.0, 1.0])
    assert axes.get_xlim()[1] == 20.0  # no value lies beyond
    assert axes.patches[0].get_height() == 0.5  # one of two lies below
    assert np.isfinite(none.get_ydata()).sum() == 1  # a single point draws no line
    with pytest.raises(DataError, match="rests or is locked"):
        separations_over_chance([nowhere], ["none"])
    assert [one.get_label() for one in (some, none)] == [
        "some: 2 of 3 realizations",
        "none: 0 of 1 realizations",
    ]
    np.testing.assert_allclose(chance.get_ydata(), 1.0 - np.exp(-chance.get_xdata()))


def test_a_noise_that_varies_has_a_curve_for_each_quarter_of_its_range():
    size = 40
    strength = np.linspace(0.0, 0.2, size)
    gap = {"dt_min": ("realization", np.geomspace(1e-6, 0.1, size)[::-1])}
    codes = {"collision_free": ("realization", np.ones(size, np.int8), FLAGS)}
    times = {"contact_time": 1e-4, "duration": 5.0, "frequency": 1.0, "gravity": 9.81}
    at = {"kick_noise": ("realization", strength)}
    sweep = xr.Dataset(gap | codes | times, at, attrs={"base": "high-bounce"})
    axes = FIGURES["separation_distribution"].draw(sweep)
    labels = [one.get_label() for one in axes.lines[:4]]
    assert labels == [r"$\sigma_V$ to 0.05", "to 0.1", "to 0.15", "to 0.2 (m s$^{-1}$)"]
    middles = [np.median(one.get_xdata()[1:-1]) for one in axes.lines[:4]]
    assert middles == sorted(middles, reverse=True)
    sweep["status"] = ("realization", (np.arange(size) == 3).astype(np.int8))
    sweep["contact_time"] = ("realization", np.geomspace(1e-5, 1e-3, size))
    axes = FIGURES["separation_distribution"].draw(sweep)
    assert axes.lines[0].get_label() == r"$\sigma_V$ to 0.05: 9 of 10 realizations"
    (band,) = axes.patches  # of contact times, which differ
    assert (band.get_x(), band.get_x() + band.get_width()) == pytest.approx((1e-5, 1e-3))
    assert len(axes.lines) == 4


def test_a_dataset_without_indices_is_refused():
    with pytest.raises(DataError, match=r"result of sobol\b.*first_order"):
        sobol_bars(OTHER)
