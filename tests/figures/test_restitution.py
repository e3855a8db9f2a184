from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import FillBetweenPolyCollection, PathCollection, QuadMesh

from vibrosweep import theory
from vibrosweep.errors import DataError
from vibrosweep.figures import height_against_restitution
from vibrosweep.figures.sweeps import plateaus


def dots_of(figure, label):
    return next(
        c
        for c in figure.axes[0].collections
        if isinstance(c, PathCollection) and c.get_label() == label
    )


def lines_at(figure):
    return [float(line.get_ydata()[0]) for line in figure.axes[0].lines]


def test_one_dot_per_realization_coloured_by_amplitude(sweep):
    dots = dots_of(height_against_restitution(sweep).figure, "rebounds")
    expected = np.column_stack([sweep.restitution, sweep.rebound_height_max])
    np.testing.assert_array_equal(np.asarray(dots.get_offsets()), expected)
    np.testing.assert_array_equal(dots.get_array(), sweep.amplitude)


def test_a_forcing_given_as_acceleration_colours_the_dots(sweep):
    gamma = 2.0 * np.pi * sweep.amplitude / (9.81 * (1.0 + sweep.restitution))
    given = sweep.assign_coords(base_acceleration=gamma)
    figure = height_against_restitution(given.assign_attrs(forcing="base_acceleration")).figure
    np.testing.assert_array_equal(dots_of(figure, "rebounds").get_array(), gamma)
    assert any(r"$\Gamma$" in axes.get_ylabel() for axes in figure.axes)


def test_small_dots_are_seen_in_the_legend(synthetic_sweep):
    sweep = synthetic_sweep(2000)
    sweep["rebound_height_max"][:3] = np.nan
    figure = height_against_restitution(sweep).figure
    dots = dots_of(figure, "rebounds")
    assert len(dots.get_offsets()) == 1997
    figure.draw_without_rendering()
    (handle, *_) = figure.axes[0].get_legend().legend_handles
    assert dots.get_sizes().max() < handle.get_sizes().max()
    assert handle.get_facecolor()[0, 3] == 1.0
    sweep["rebound_height_max"][:] = np.nan
    assert "no rebound in 2000" in (
        height_against_restitution(sweep).get_legend().get_title().get_text()
    )


def test_open_circles_where_the_launch_is_highest(sweep):
    circles = np.asarray(
        dots_of(height_against_restitution(sweep).figure, "including the launch").get_offsets()
    )
    lower = sweep.rebound_height_max.values < 25 / (2 * 9.81)
    assert 0 < lower.sum() < lower.size
    np.testing.assert_array_equal(circles[:, 0], sweep.restitution.values[lower])
    np.testing.assert_allclose(circles[:, 1], 25 / (2 * 9.81))


def test_plateaus_are_the_closed_form_and_in_view(sweep):
    figure = height_against_restitution(sweep).figure
    top = figure.axes[0].get_ylim()[1]
    expected = [h for h in theory.locked_height(np.arange(1, 9)) if h < top]
    launch, *drawn = lines_at(figure)
    assert launch == pytest.approx(25 / (2 * 9.81))
    np.testing.assert_allclose(drawn, expected)


def test_plateaus_too_close_to_be_labelled_are_left_out():
    modes, heights = plateaus(1.0, 400.0)
    np.testing.assert_array_equal(heights, modes**2)
    assert modes[0] == 1
    assert np.diff(heights).min() >= 0.06 * 400.0
    assert plateaus(2.0, 1.0)[0].size == 0


def test_a_laboratory_sweep_is_drawn_in_units_of_the_first_plateau(make_sweep):
    frequency = np.linspace(8.0, 35.0, 12)
    sweep = make_sweep(
        12, 2, frequency=frequency, amplitude=2.0 / frequency, launch_velocity=0.3, duration=1.0
    )
    figure = height_against_restitution(sweep).figure
    offsets = np.asarray(dots_of(figure, "rebounds").get_offsets())
    np.testing.assert_allclose(
        offsets[:, 1], sweep.rebound_height_max / theory.locked_height(1, frequency)
    )
    assert "H_1" in figure.axes[0].get_ylabel()
    assert set(np.sqrt(lines_at(figure))) <= {1.0, 2.0, 3.0, 4.0, 5.0, 6.0}


def test_a_fixed_amplitude_needs_no_colour_bar(make_sweep):
    figure = height_against_restitution(make_sweep(10, 2, amplitude=1.2)).figure
    assert len(figure.axes) == 1


def test_realizations_without_a_rebound_are_counted(make_sweep):
    sweep = make_sweep(10, 1)
    sweep["rebound_height_max"][:3] = np.nan
    figure = height_against_restitution(sweep).figure
    heading = figure.axes[0].get_legend().get_title().get_text()
    assert "no rebound in 3 of 10 realizations" in heading
    sweep["rebound_height_max"][:] = np.nan
    sweep["flight_height_max"][:] = np.nan
    height_against_restitution(sweep).figure.canvas.draw()


def test_very_many_realizations_are_counted_in_cells(synthetic_sweep):
    sweep = synthetic_sweep(30_000)
    figure = height_against_restitution(sweep).figure
    (mesh,) = [c for c in figure.axes[0].collections if isinstance(c, QuadMesh)]
    assert mesh.get_array().sum() == 30_000


def test_missing_variables_and_ranges_are_named(sweep):
    with pytest.raises(DataError, match="variable rebound_height_max"):
        height_against_restitution(sweep.drop_vars("rebound_height_max"))
    with pytest.raises(DataError, match=r"restitution = \[low, high\]"):
        height_against_restitution(sweep.isel(realization=[0]))


def test_over_a_moving_base_highest_points_of_stable_orbits_are_shaded():
    e = np.linspace(0.8, 0.9, 9)
    mode = np.where(np.arange(9) % 2, 1, 2)
    ends = theory.amplitude_min(mode, e), theory.amplitude_max(mode, e, base="moving")
    for share in (1e-6, 0.5, 1.0):
        amplitude = ends[0] + share * (ends[1] - ends[0])
        apex = theory.locked_apex(mode, e, amplitude)
        sweep = xr.Dataset(
            dict.fromkeys(("rebound_height_max", "flight_height_max"), ("realization", apex)),
            coords={
                "restitution": ("realization", e),
                "amplitude": ("realization", amplitude),
                "frequency": 1.0,
                "gravity": 9.81,
                "launch_velocity": 5.0,
            },
            attrs={"base": "moving"},
        )
        axes = height_against_restitution(sweep)
        bands = [c for c in axes.collections if isinstance(c, FillBetweenPolyCollection)]
        assert len(bands) == 2
        outlines = [band.get_paths()[0].vertices for band in bands]
        for x, y, k in zip(e, apex, mode, strict=True):
            band = outlines[k - 1]
            upper = band[band[:, 1] > band[:, 1].min() + 1e-9]
            top = np.interp(x, *upper[np.argsort(upper[:, 0])].T)
            assert band[:, 1].min() * (1.0 - 1e-9) <= y <= top * (1.0 + 1e-4)
        assert not [line for line in axes.lines if "launch" in str(line.get_label())]


def test_heights_below_the_mean_level_are_in_view(make_sweep):
    sweep = make_sweep(20, 2).assign_attrs(base="moving")
    sweep["rebound_height_max"] = sweep["rebound_height_max"] - 1.0
    lowest = float(sweep["rebound_height_max"].min())
    assert lowest < 0.0
    assert height_against_restitution(sweep).get_ylim()[0] < lowest
