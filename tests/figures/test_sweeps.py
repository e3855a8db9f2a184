"""Figures of sweeps."""

from __future__ import annotations

import itertools
import sys

import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import FillBetweenPolyCollection, PathCollection, QuadMesh
from matplotlib.colors import LogNorm, to_rgb
from matplotlib.figure import Figure

import vibrosweep as vs
from tests.cases import each_of
from tests.scans import bifurcation, find_windows
from vibrosweep import theory
from vibrosweep.errors import DataError
from vibrosweep.figures import height_against_restitution, parameter_plane
from vibrosweep.figures.orbits import basins_of_attraction, bifurcation_diagram
from vibrosweep.figures.paint import commonest, equal_cells, grid_cells, median
from vibrosweep.figures.registry import FIGURES
from vibrosweep.figures.style import for_file
from vibrosweep.figures.sweeps import (
    plateaus,
    separation_distributions,
    separations_over_chance,
    sobol_bars,
)
from vibrosweep.figures.windows import Forcing, stability_windows, window_curves
from vibrosweep.model.forcing import FORCINGS
from vibrosweep.model.measures import Regime
from vibrosweep.scene.sweep import keyword_spec
from vibrosweep.theory import FIXED


def numbers_of(figure):
    """The artist whose colours the colour bar explains."""
    return figure.axes[1]._colorbar.mappable


def curves_of(figure):
    return [np.asarray(line.get_xydata()) for line in figure.axes[0].lines if len(line.get_xdata())]


@pytest.fixture
def small_grid(make_sweep):
    e, a = np.meshgrid(np.linspace(0.8, 0.98, 7), np.linspace(0.3, 3.5, 5))
    return make_sweep(35, 3, restitution=e.ravel(), amplitude=a.ravel())


def test_the_curves_are_those_of_theory(sweep):
    figure = parameter_plane(sweep).figure
    low, high = figure.axes[0].get_ylim()
    expected = [
        end(k, curves_of(figure)[0][:, 0])
        for end in (theory.amplitude_min, theory.amplitude_max)
        for k in (1, 2, 3)
    ]
    expected = [y for y in expected if np.any((y > low) & (y < high))]
    for curve, y in zip(curves_of(figure), expected, strict=True):
        np.testing.assert_array_equal(curve[:, 1], y)
    labels = [text.get_text() for text in figure.axes[0].texts]
    assert len(labels) == len(expected)
    assert r"${A}_{\mathrm{min}}(1)$" in labels


def test_curves_out_of_view_are_left_out():
    assert window_curves((0.8, 0.9), (5.0, 6.0), Forcing("A", "high-bounce", 1.0, 9.81)) == []
    (curve,) = window_curves((0.9, 0.95), (0.01, 0.48), Forcing("A", "high-bounce", 1.0, 9.81))
    assert (curve.mode, curve.is_upper) == (1, False)


@pytest.mark.parametrize("base", theory.FIXED)
def test_the_curves_are_those_of_the_base_and_of_its_acceleration(base):
    view = (0.3, 0.9), (0.0, 5.0)
    for is_upper, end in ((False, theory.amplitude_min), (True, theory.amplitude_max)):
        chosen = {"base": base} if is_upper else {}
        for f, g in ((1.0, 9.81), (20.0, 3.7)):
            amplitudes = window_curves(*view, Forcing("A", base, f, g), [2])
            accelerations = window_curves(*view, Forcing("G", base, name="base_acceleration"), [2])
            (one,) = [c for c in accelerations if c.is_upper == is_upper]
            gamma = end(2, one.x, f, g, **chosen) * 2.0 * np.pi * f / g
            np.testing.assert_allclose(one.y, gamma / (1.0 + one.x), rtol=1e-14)
            for curve in amplitudes:
                if curve.is_upper == is_upper:
                    exact = end(2, curve.x, f, g, **chosen)
                    np.testing.assert_array_equal(curve.y, exact)


def test_a_forcing_given_as_acceleration_is_drawn_as_such(sweep):
    gamma = 2.0 * np.pi * sweep.amplitude / (9.81 * (1.0 + sweep.restitution))
    given = sweep.assign_coords(base_acceleration=gamma).assign_attrs(
        forcing="base_acceleration", base="moving"
    )
    figure = parameter_plane(given).figure
    assert r"$\Gamma$" in figure.axes[0].get_ylabel()
    assert "moving base" in figure.axes[0].get_legend().get_title().get_text()
    np.testing.assert_array_equal(numbers_of(figure).get_offsets()[:, 1].max(), gamma.max())
    assert any("Gamma" in text.get_text() for text in figure.axes[0].texts)


def test_separations_below_the_contact_time_are_coloured_and_zeros_have_a_marker(sweep):
    figure = parameter_plane(sweep).figure
    dots = numbers_of(figure)
    dt = sweep.dt_min.values
    close = (dt > 0.0) & (dt < 1e-4)
    assert close.any()
    assert isinstance(dots.norm, LogNorm)
    np.testing.assert_array_equal(dots.get_array(), dt[dt > 0.0])
    (crosses,) = [
        c for c in figure.axes[0].collections if isinstance(c, PathCollection) and c is not dots
    ]
    assert len(crosses.get_offsets()) == np.count_nonzero(dt == 0.0) > 0
    names = [t.get_text() for t in figure.axes[0].get_legend().get_texts()]
    assert names == ["landing or resting together", "$\\tau_c$ = 0.0001 s"]


@each_of(("low", "high"), [(-3.0, 0.5), (-3.0, -1.0), (1.0, 3.0)])
@each_of("as_grid", [True, False])
def test_signed_numbers_diverge_from_zero_and_the_legend_has_minus_infinity(
    low, high, as_grid, small_grid, make_sweep
):
    sweep = small_grid if as_grid else make_sweep(35, 3)
    exponents = np.linspace(low, high, 35)
    exponents[3:6], exponents[7] = -np.inf, np.nan
    figure = parameter_plane(sweep.assign(lyapunov=("realization", exponents)), "lyapunov").figure
    norm = numbers_of(figure).norm
    assert norm(0.0) == 0.5
    assert (norm.vmin, norm.vmax) == (min(low, -3.0), high if high > 0.0 else 3.0)
    bottom, top = figure.axes[1].get_ylim()
    ticks = figure.axes[1].get_yticks()
    assert bottom <= ticks[0] < 0.0 < ticks[-1] <= top
    assert 0.0 in ticks
    names = [t.get_text() for t in figure.axes[0].get_legend().get_texts()]
    assert names == [r"$-\infty$ (rests)", "no value"]


def test_without_separation_the_height_gives_the_colour(sweep):
    dots = numbers_of(parameter_plane(sweep.drop_vars(["dt_min", "base_shared"])).figure)
    np.testing.assert_array_equal(dots.get_array(), sweep.rebound_height_max)
    assert not isinstance(dots.norm, LogNorm)


@pytest.mark.parametrize("far", [{0: -1e6}, {7: 1e6}, {0: -1e6, 7: 1e6}, {}])
def test_a_value_far_from_the_others_does_not_spoil_the_scale(far, make_sweep):
    sweep, values = make_sweep(1000, 3), np.linspace(1.0, 3.0, 1000)
    values[list(far)] = list(far.values())
    if far:
        values -= 2.0  # of both signs
    bar = parameter_plane(sweep.assign(drift=("realization", values)), "drift").figure.axes[-1]
    norm, extend = bar._colorbar.norm, bar._colorbar.extend
    assert -1.0 <= norm.vmin < norm.vmax <= 3.0
    assert extend == {(): "neither", (0,): "min", (7,): "max", (0, 7): "both"}[tuple(far)]


def test_the_names_of_curves_stand_above_the_dots(sweep):
    axes = parameter_plane(sweep)
    dots = max(drawn.zorder for drawn in axes.collections)
    assert axes.texts
    assert min(text.zorder for text in axes.texts) > dots


@pytest.mark.parametrize("most", [4, 1])
def test_a_scale_of_counts_has_no_halves(most, sweep):
    counted = sweep.assign(slots=("realization", np.arange(60) % most, {"long_name": "slots"}))
    bar = parameter_plane(counted, "slots").figure.axes[-1]
    assert all(tick == round(tick) for tick in bar.get_yticks())


def test_a_sweep_whose_particles_meet_everywhere(sweep):
    everywhere = sweep.assign(dt_min=("realization", np.zeros(60)))
    figure = parameter_plane(everywhere).figure
    assert len(figure.axes) == 1
    figure.canvas.draw()


def test_a_kick_axis_where_frequency_varies(make_sweep):
    frequency = np.linspace(8.0, 35.0, 20)
    sweep = make_sweep(20, 2, frequency=frequency, amplitude=0.1, launch_velocity=0.3, duration=0.5)
    figure = parameter_plane(sweep, "rebound_height_max").figure
    offsets = np.asarray(numbers_of(figure).get_offsets())
    np.testing.assert_allclose(offsets[:, 1], 2.0 * frequency * 0.1 / 9.81)
    curve = curves_of(figure)[0]
    # at frequency 1 Hz and gravity 2 m/s2 the amplitude is the kick
    np.testing.assert_allclose(
        curve[:, 1], theory.amplitude_min(1, curve[:, 0], 1.0, 2.0), rtol=1e-15
    )


@pytest.mark.parametrize("as_grid", [True, False])
def test_codes_have_colours_of_their_own(as_grid, small_grid, make_sweep):
    sweep = small_grid if as_grid else make_sweep(35, 3)
    codes = np.where(sweep.rebound_height_max.values > 2.0, 3, 1).astype(np.int8)
    sweep["regime"] = (
        "realization",
        codes,
        {
            "flag_values": np.array([0, 1, 2, 3], np.int8),
            "flag_meanings": "at_rest resting locked unsettled",
            "long_name": "regime of the orbit",
        },
    )
    figure = parameter_plane(sweep, "regime").figure
    names = [t.get_text() for t in figure.axes[0].get_legend().get_texts()]
    assert names == ["resting", "unsettled"]
    heading = figure.axes[0].get_legend().get_title().get_text()
    assert heading == "regime of the orbit, $f$ = 1 Hz"
    assert len(figure.axes) == 1
    counts = [np.ma.count(c.get_array()) for c in figure.axes[0].collections]
    assert counts == [np.count_nonzero(codes == 1), np.count_nonzero(codes == 3)]


def test_medians_and_commonest_codes_of_cells():
    rng = np.random.default_rng(3)
    x, y, values = rng.uniform(size=(3, 500))
    values[::7] = np.nan
    cells = equal_cells(x, y)
    drawn = median(cells, values).ravel()
    codes = np.floor(3 * rng.uniform(size=500))
    most = commonest(cells, codes, np.arange(3.0)).ravel()
    for i in np.unique(cells.index):
        inside = np.sort(values[(cells.index == i) & np.isfinite(values)])
        assert drawn[i] == inside[(inside.size - 1) // 2]
        counts = [np.count_nonzero(codes[cells.index == i] == c) for c in range(3)]
        assert counts[int(most[i])] == max(counts)
    assert np.isnan(median(cells, np.full(500, np.nan))).all()


def test_only_complete_grids_are_grids():
    x, y = (axis.ravel() for axis in np.meshgrid([1.0, 2.0, 4.0], [0.0, 1.0]))
    cells = grid_cells(np.tile(x, 4), np.tile(y, 4))
    assert cells is not None
    np.testing.assert_array_equal(cells.x_edges, [0.5, 1.5, 3.0, 5.0])
    assert grid_cells(x[:-1], y[:-1]) is None
    assert grid_cells(np.append(x[:-1], x[0]), np.append(y[:-1], y[0])) is None


@pytest.mark.parametrize("variable", [None, "rebound_height_max"])
def test_the_calls_that_draw_do_not_grow_with_the_sweep(variable, tmp_path, synthetic_sweep):
    """Realizations are gathered and drawn as arrays, not one by one."""
    calls = []
    for size in (40_000, 100_000):
        sweep, count = synthetic_sweep(size), itertools.count()
        sys.setprofile(lambda *event, count=count: next(count))
        try:
            figure = parameter_plane(sweep, variable).figure
            figure.savefig(tmp_path / "plane.png", dpi=200)
        finally:
            sys.setprofile(None)
        calls.append(next(count))
        assert isinstance(numbers_of(figure), QuadMesh)
    assert calls[1] < 1.1 * calls[0]


def test_missing_variables_and_ranges_are_named(sweep, make_sweep):
    with pytest.raises(DataError, match="dt_min or rebound_height_max"):
        parameter_plane(sweep.drop_vars(["dt_min", "rebound_height_max"]))
    with pytest.raises(DataError, match="variable regime"):
        parameter_plane(sweep, "regime")
    with pytest.raises(DataError, match="set separation = true"):
        parameter_plane(sweep.drop_vars("dt_min"), "dt_min")
    with pytest.raises(DataError, match=r"amplitude = \[low, high\]"):
        parameter_plane(make_sweep(10, 1, amplitude=1.0))


def test_any_variable_of_a_result_is_drawn_or_refused_in_words():
    """One number for each realization is drawn; several, texts and unknown names are refused."""
    drawn = {"restitution": (0.8, 0.95), "amplitude": (0.5, 3.0), "realizations": 20}
    asked = {"per_particle": True, "regimes": True, "lyapunov": True, "separation": True}
    sweep = vs.sweep(**drawn, **asked, particles=2, duration=30.0)
    texts = sweep.assign_coords(name=("realization", ["a"] * 20))
    of_a_sort = {(v.dims, v.dtype, "flag_values" in v.attrs): n for n, v in texts.variables.items()}
    for name in of_a_sort.values():
        one = texts.variables[name]
        if one.dims in ((), ("realization",)) and name != "name":
            assert for_file(parameter_plane, texts, name).axes
        else:
            words = f"{name} holds .* along .*: choose a variable with one number for each"
            words += (
                r".*or a particle, as sweep.isel\(particle=0\)$" if "particle" in one.dims else ""
            )
            with pytest.raises(DataError, match=words):
                parameter_plane(texts, name)
    with pytest.raises(DataError, match="one number for each"):
        vs.separations(texts, against="name")
    with pytest.raises(DataError, match='mean "lyapunov_'):
        parameter_plane(sweep, "lyapunov")
    with pytest.raises(DataError, match=r"no variable has that name$"):
        parameter_plane(sweep, "xyz")
    with pytest.raises(DataError, match="set trust = true"):
        parameter_plane(sweep, "landing_time_error")
    with pytest.raises(DataError, match="not the complete result"):
        parameter_plane(sweep.drop_vars("impact_count"), "impact_count")


def dots_of(figure, label):
    return next(
        c
        for c in figure.axes[0].collections
        if isinstance(c, PathCollection) and c.get_label() == label
    )


def lines_at(figure):
    return [float(line.get_ydata()[0]) for line in figure.axes[0].lines]


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


def test_missing_variables_and_ranges_are_named_restitution(sweep):
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


# Figures of analyses refuse datasets that are not their results.

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


# Figures of windows, bifurcation diagrams and basins show what their datasets hold.

SCENE = keyword_spec({"particles": 2, "duration": 300.0}).scene


@pytest.fixture(scope="module")
def windows():
    conditions = ["locked(1)", "locked(4)", "periodic"]
    scan = np.linspace(0.2, 6.0, 30)
    return find_windows(SCENE, [0.8, 0.85, 0.9], scan, conditions, continuation=True)


def ends_of(axes):
    """Ends of all windows of locked orbits."""
    lines = [line.get_ydata() for line in axes.lines if line.get_marker() == "."]
    return sorted(np.concatenate(lines)[np.isfinite(np.concatenate(lines))])


def labels(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_a_dataset_without_windows_is_refused(windows):
    with pytest.raises(DataError, match="figure stability_windows needs the variable A_min"):
        stability_windows(windows.drop_vars("A_min"))


@each_of("base", FIXED)
@each_of("forcing", FORCINGS)
def test_windows_of_any_forcing_are_drawn_with_its_symbol(forcing, base):
    scene, scan = (
        keyword_spec({"duration": 2000.0, "base": base, "frequency": 2.0}).scene,
        np.geomspace(0.01, 4.0, 8),
    )
    figure = stability_windows(
        find_windows(scene, [0.7, 0.9], scan, ["locked(1)"], forcing=forcing)
    )[0].figure
    figure.draw_without_rendering()
    assert len(figure.axes[0].texts) == 2


@pytest.mark.parametrize("width", [3.4, 7.0])
@pytest.mark.parametrize("base", ["moving", "high-bounce"])
def test_names_of_windows_do_not_lie_on_each_other(base, width):
    """Also where upper ends of one orbit cross lower ends of the next."""
    found = vs.windows(
        base=base, restitution=np.linspace(0.3, 0.98, 5), base_acceleration=[0.05, 1.0, 2.5],
        conditions=["locked(1)", "locked(2)", "locked(3)"], duration=100.0,
    )  # fmt: skip
    figure = Figure(figsize=(width, 0.75 * width), layout="constrained")
    (axes,) = stability_windows(found, ax=figure.add_subplot())
    figure.canvas.draw()
    middles = axes.transData.transform([text.get_position() for text in axes.texts]) / figure.dpi
    assert len(middles) >= 4
    for one, other in itertools.combinations(middles, 2):
        assert np.hypot(*(one - other)) > 0.3  # inches; they are 0.1 high and slant alike


def test_curves_under_the_reflect_law_are_labelled_as_orbits_without_reflection():
    found = find_windows(
        keyword_spec({"duration": 2000.0, "rebound": "reflect"}).scene,
        [0.8],
        [0.5, 1.0, 4.0],
        ["locked(1)"],
    )
    (axes,) = stability_windows(found)
    assert "curves: orbits without reflection" in axes.get_legend().get_title().get_text()


def test_windows_that_reach_the_end_of_the_scan_are_drawn_to_it_and_missing_ones_are_named():
    found = find_windows(SCENE, [0.9], [1.0, 2.0, 2.5], ["locked(1)", "locked(60)", "separated"])
    locked, _ = stability_windows(found)
    assert labels(locked) == ["locked(1)", "locked(60): no window found"]
    assert ends_of(locked) == [1.0, 2.5]
    assert locked.get_ylim() == (1.0, 2.5)


@pytest.mark.parametrize(
    "modes", [range(1, 9), range(1, 25), [999_999_999], [1, 30, 999_999_999]], ids=str
)
def test_any_number_of_conditions_and_any_mode_can_be_drawn(modes):
    names = [f"locked({k})" for k in modes]
    found = find_windows(SCENE, [0.5, 0.7, 0.95], np.linspace(0.05, 6.0, 12), names)
    figure = stability_windows(found)[0].figure
    figure.draw_without_rendering()
    (axes,) = figure.axes
    assert len(labels(axes)) == len(names)
    handles = axes.get_legend().get_lines()
    assert len({to_rgb(line.get_color()) for line in handles}) == len(names)


def test_a_bifurcation_diagram_says_how_many_orbits_are_unsettled():
    for duration, said in ((3.0, True), (3000.0, False)):
        diagram = bifurcation(keyword_spec({"duration": duration}).scene, [0.6, 0.7], samples=2)
        assert (diagram["regime"].values == Regime.UNSETTLED).any() == said
        upper, _ = bifurcation_diagram(diagram)
        assert upper.get_legend().get_title().get_text().endswith("of the orbits unsettled") == said


def test_colours_of_attractors_are_told_apart():
    count = 10
    fractions = xr.DataArray(np.full(count, 0.1), dims="attractor")
    found = xr.Dataset(
        {
            "basin": (("launch_velocity", "launch_time"), np.arange(12).reshape(3, 4) % count),
            "fraction": fractions,
            "regime": fractions.astype(np.int8) + int(Regime.LOCKED),
            "cycle_impacts": fractions.astype(int) + 1,
            "cycle_periods": fractions.astype(int) + 1,
        },
        {"launch_velocity": np.arange(3.0), "launch_time": np.arange(4.0)},
    )
    (axes,) = basins_of_attraction(found).figure.axes
    assert labels(axes)[-1] == "3 others, 30 %"
    colours = np.array([to_rgb(line.get_color()) for line in axes.lines])
    apart = np.abs(colours[:, np.newaxis] - colours).max(axis=-1)
    assert apart[np.triu_indices(len(colours), 1)].min() > 0.2


def test_windows_over_a_moving_base_are_drawn_with_its_closed_forms():
    scan = np.linspace(0.2, 8.0, 20)
    found = find_windows(
        keyword_spec({"duration": 2000.0, "base": "moving"}).scene,
        [0.5, 0.6, 0.7],
        scan,
        ["locked(1)"],
    )
    (axes,) = stability_windows(found)
    e = found["restitution"].values
    tops = theory.amplitude_max(1, e, base="moving")
    assert ends_of(axes)[-e.size :] == pytest.approx(sorted(tops))
    (dashed,) = [line for line in axes.lines if line.get_linestyle() == "--"]
    x, y = dashed.get_data()
    np.testing.assert_allclose(y, theory.amplitude_max(1, x, base="moving"), rtol=1e-14)
    assert "moving base" in axes.get_legend().get_title().get_text()


def test_a_diagram_along_the_acceleration_says_so():
    scene = {"base": "moving", "frequency": 20.0, "restitution": 0.7, "launch_velocity": 0.2}
    asked = {"duration_periods": 300.0, "observable": "flight_time", "samples": 3}
    found = vs.bifurcation(**scene, base_acceleration=[0.8, 1.0, 2.0], **asked)
    upper, lower = bifurcation_diagram(found)
    assert {"acceleration down", "acceleration up", "new launches"} <= set(labels(upper))
    assert "acceleration" in lower.get_xlabel()
    assert lower.lines[0].get_xdata().max() == pytest.approx(2.0, rel=1e-15)
