"""Imperfections behind Table 4, one by one, and their figure."""

import numpy as np
import pytest
import xarray as xr

from study.figures.imperfections import imperfections
from study.table4 import Imperfection, in_band, study_imperfections, verdict


def test_imperfections_one_by_one():
    """A wrong scale moves heights alone; frames alone move single periods by sign change only."""
    study = study_imperfections(
        imperfections=(
            Imperfection("scale_error", "1", (0.05,), "scale_error"),
            Imperfection("frame_rate", "Hz", (240.0,), "frame_rate"),
        ),
        cases={"A": 1, "B": 2},
        repeats=2,
        duration=23.0,
    )
    assert study["height_error"].dims == ("trial", "procedure", "reading", "case")
    fit = study.sel(procedure="fit", case="A")
    # measured heights are 5 % too large: 100 * 0.05 / 1.05 of what was measured
    np.testing.assert_allclose(fit["height_error"][0], 100.0 * 0.05 / 1.05, rtol=1e-3)
    assert (fit["period_error"][0] < 1e-3).all()
    assert (fit["height_error"][1] < 1e-3).all()
    # at 10.43 frames a flight is seen as 10 or 11: 2 * 0.43 * 0.57 of a frame off on average
    sign = study.sel(procedure="sign_change", case="A", reading="flight")["period_error"][1]
    expected = 0.43 * 0.57 * (1.0 / 10.0 + 1.0 / 11.0) * 100.0
    assert float(sign) == pytest.approx(expected, rel=0.1)
    judged = in_band(study)
    assert bool(judged["height_in_band"].sel(procedure="fit", reading="particle")[0])
    assert bool(judged["period_in_band"].sel(procedure="sign_change", reading="flight")[1])
    assert not judged["period_grows"].any()
    words = verdict(study)
    assert "scale_error 0.05 (fit: ensemble, particle, worst, flight" in words[0]
    assert words[-1] == "both, and growing: nothing that was tried"


def test_an_imperfection_too_large_to_measure_is_no_error():
    blind = Imperfection("pixel", "m", (5e-3,), "pixel", {"noise": 1.0})
    study = study_imperfections(imperfections=(blind,), cases={"A": 1}, repeats=1, duration=22.0)
    assert np.isnan(study["height_error"].values).all()
    assert float(study["compared"][0, 0]) == 0.0


def test_imperfections_are_rows():
    dims = ("trial", "procedure", "reading", "case")
    values = np.array([1.0, 2.0, 40.0, 3.0]).reshape(2, 1, 1, 2)
    study = xr.Dataset(
        {
            f"{q}_error{end}": (dims, factor * values)
            for q in ("height", "period")
            for end, factor in (("", 1.0), ("_sd", 0.1))
        },
        coords={
            "imperfection": ("trial", ["pixel", "scale_error"]),
            "size": ("trial", [1e-4, 0.05]),
            "units": ("trial", ["m", "1"]),
            "procedure": ["fit"],
            "reading": ["flight"],
            "case": ["A", "D"],
            "particles": ("case", [1, 50]),
        },
        attrs={"study_height": (3.8, 7.1), "study_period": (2.9, 6.0), "repeats": 4},
    )
    figure = imperfections(study, "flight", "fit")[0].figure
    axes = figure.axes[0]
    assert [t.get_text() for t in axes.get_yticklabels()] == ["pixel 0.0001 m", "scale error 0.05"]
    # an error beyond the axis is drawn at its end, which is labelled "30 +"
    assert axes.lines[0].get_xdata().tolist() == [1.0, 30.0]
    # standard error of the mean of four repeats
    bar = axes.containers[0].lines[2][0].get_segments()[0]
    assert bar[:, 0].tolist() == pytest.approx([0.95, 1.05])
