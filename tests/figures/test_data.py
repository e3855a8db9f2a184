from __future__ import annotations

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr

from vibrosweep.explorer.points import _column, _numbers
from vibrosweep.figures import style
from vibrosweep.figures.data import conditions, fixed, format_units, label, quantity, varies
from vibrosweep.model.measures import OF_REALIZATIONS


@pytest.mark.parametrize(
    ("units", "drawn"),
    [("m s-1", " (m s$^{-1}$)"), ("m s-2", " (m s$^{-2}$)"), ("Hz", " (Hz)"), ("1", ""), ("", "")],
)
def test_exponents_of_units_are_raised(units, drawn):
    assert format_units(units) == drawn


def test_labels_come_from_the_dataset_and_long_ones_are_wrapped():
    words = "smallest time between two landings of different particles"
    dataset = xr.Dataset({"dt_min": ((), 1.0, {"long_name": words, "units": "s"}), "other": 2.0})
    drawn = label(dataset, "dt_min")
    assert drawn.endswith(r"$\Delta t_{\mathrm{min}}$ (s)")
    assert drawn.startswith("smallest time between two\nlandings")
    assert label(dataset, "other") == "other"


def test_a_parameter_given_per_realization_is_fixed_where_all_agree():
    dataset = xr.Dataset(
        coords={
            "amplitude": ("realization", [1.0, 1.0]),
            "restitution": ("realization", [0.8, 0.9]),
            "frequency": 2.0,
        },
        attrs={"rebound": "reflect"},
    )
    assert fixed(dataset, "amplitude") == 1.0
    assert varies(dataset, "restitution")
    assert conditions(dataset) == "$A$ = 1 m s$^{-1}$, $f$ = 2 Hz, reflect law"


def test_a_parameter_that_varies_and_is_no_axis_has_its_range():
    coords = {
        "restitution": ("realization", [0.8, 0.9]),
        "drive_noise": ("realization", [0.05, 0.01]),
    }
    dataset = xr.Dataset(coords=coords | {"amplitude": 1.0, "frequency": [1.0, 2.0]})
    assert conditions(dataset) == r"$A$ = 1 m s$^{-1}$, drive noise $\sigma_A$ = 0.01 to 0.05"
    frequency = {"frequency": ("realization", [1.0, 2.0])}
    assert "$f$ = 1 to 2 Hz" in conditions(dataset.drop_vars("frequency").assign_coords(frequency))


def test_the_base_is_named_once_and_the_forcing_as_it_was_given():
    shared = {"amplitude": 1.0, "base_acceleration": 3.0, "frequency": 2.0}
    dataset = xr.Dataset(coords=shared, attrs={"base": "moving", "forcing": "base_acceleration"})
    assert conditions(dataset) == r"$\Gamma$ = 3 g, $f$ = 2 Hz, moving base"
    dataset.attrs["forcing"] = "base_velocity"  # not in this dataset
    assert conditions(dataset) == "$A$ = 1 m s$^{-1}$, $f$ = 2 Hz, moving base"


def test_a_remark_that_fits_no_line_is_broken_after_commas():
    parts = ["$e$ = 0.9", "$A$ = 0.349 m s$^{-1}$", "$f$ = 17 Hz", "moving base"]
    remark = ", ".join(parts)
    for width, lines in ((style.PAGE, 1), (style.COLUMN, 2)):
        with mpl.rc_context(style.RC):
            axes = style.axes_on(None, width, 2.0)
            axes.plot([0.0], [0.0], label="a line")
            style.head(axes, remark)
            axes.figure.draw_without_rendering()
        title = axes.get_legend().get_title()
        assert title.get_text().replace("\n", " ") == remark
        assert title.get_text().count("\n") == lines - 1
        assert title.get_window_extent().x1 < axes.figure.bbox.x1


@pytest.mark.parametrize("name", sorted(OF_REALIZATIONS))
def test_codes_for_no_value_are_left_blank(name):
    variable = OF_REALIZATIONS[name]
    none = np.nan if variable.dtype == "float64" else 0 if variable.cycle else -1
    values = np.array([none, 1.0]).astype(variable.dtype)
    data = {name: ("realization", values, variable.attributes)}
    dataset = xr.Dataset(data | {variable.cycle or name: data[name]})
    drawn, column = quantity(dataset, name), _column(name, _numbers(name, dataset))
    expected = values if variable.flags else [np.nan, 1.0]  # flags are drawn with their names
    np.testing.assert_array_equal(drawn, expected)
    np.testing.assert_array_equal(column.values, expected)
    assert bool(column.codes) == bool(variable.flags)
