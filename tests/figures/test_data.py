from __future__ import annotations

import pytest
import xarray as xr

from vibrosweep.figures.data import conditions, fixed, format_units, label, varies


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
