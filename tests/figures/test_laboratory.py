"""Figures of the laboratory: what is drawn is what the datasets hold."""

import numpy as np
import pytest
import xarray as xr

from vibrosweep.figures.laboratory import errors_by_case, fitted_track


@pytest.fixture
def flights():
    """Two flights of one particle, and one of another, with samples on the first."""
    time = np.linspace(0.0, 0.1, 11)
    height = 9.81 / 2.0 * time * (0.1 - time)
    return xr.Dataset(
        {
            "time": ("sample", time),
            "height": ("sample", height),
            "particle": ("sample", np.zeros(11, int)),
            "residual": ("sample", np.where(time == 0.0, np.nan, 1.0)),
            "within": ("sample", time / 0.1),
            "start": ("flight", [0.0, 0.1, 0.0]),
            "end": ("flight", [0.1, 0.18, 0.1]),
            "speed": ("flight", [0.4905, 0.3924, 0.4905]),
            "rise": ("flight", [0.0, 0.002, 0.0]),
            "owner": ("flight", [0, 0, 1]),
            "landing_time": ("landing", [0.1]),
            "landing_error": ("landing", [1e-3]),
            "landing_height": ("landing", [0.002]),
            "landing_owner": ("landing", [0]),
        },
        attrs={"noise": 1e-4, "base": 0.0, "curvature": 9.81, "frame_rate": 100.0},
    )


def test_the_track_shows_samples_flights_and_landings(flights):
    figure = fitted_track(flights)[0].figure
    top, residuals, _ = figure.axes
    curves = [
        line for line in top.lines if line.get_linestyle() == "-" and len(line.get_xdata()) > 9
    ]
    assert len(curves) == 2  # both of the particle that flies longest
    assert max(curves[0].get_ydata()) == pytest.approx(1e3 * 9.81 * 0.1**2 / 8.0, rel=1e-3)
    assert curves[1].get_ydata()[0] == pytest.approx(2.0)  # the height of the base at that time
    assert "height $y$ (mm)" in top.get_ylabel()
    dots = residuals.lines[0].get_ydata()
    assert len(dots) == 10
    assert set(dots) == {1.0}


def comparison():
    error = np.arange(2 * 2 * 4, dtype=float).reshape(2, 2, 4)
    return xr.Dataset(
        {"error": (("case", "quantity", "reading"), error)},
        coords={
            "case": ["N=1", "N=5"],
            "particles": ("case", [1, 5]),
            "quantity": ["height", "period"],
            "reading": ["ensemble", "particle", "worst", "flight"],
        },
        attrs={"study_height": np.array([3.8, 7.1]), "study_period": np.array([2.9, 6.0])},
    )


def test_errors_stand_beside_the_range_of_the_study():
    figure = errors_by_case(comparison())[0].figure
    heights, periods = figure.axes
    assert [text.get_text() for text in heights.get_xticklabels()] == ["N=1", "N=5"]
    assert [line.get_ydata().tolist() for line in periods.lines] == [
        [4.0, 12.0],
        [5.0, 13.0],
        [6.0, 14.0],
        [7.0, 15.0],
    ]
    box = heights.patches[0].get_extents().transformed(heights.transData.inverted())
    assert (box.y0, box.y1) == pytest.approx((3.8, 7.1))
    own = errors_by_case(comparison().drop_attrs())  # not an experiment of the study
    assert not own[0].patches
    unknown = comparison().drop_attrs()
    unknown["error"][:, 0] = np.nan
    assert errors_by_case(unknown)[0].get_ylim() == (0.0, 1.15)
