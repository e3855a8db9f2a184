from __future__ import annotations

import itertools
import sys

import numpy as np
import pytest
from matplotlib.collections import PathCollection, QuadMesh
from matplotlib.colors import LogNorm

import vibrosweep as vs
from vibrosweep import theory
from vibrosweep.errors import DataError
from vibrosweep.figures import parameter_plane
from vibrosweep.figures.paint import commonest, equal_cells, grid_cells, median
from vibrosweep.figures.style import for_file
from vibrosweep.figures.windows import Forcing, window_curves


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
            gamma = end(2, one.restitution, f, g, **chosen) * 2.0 * np.pi * f / g
            np.testing.assert_allclose(one.forcing, gamma / (1.0 + one.restitution), rtol=1e-14)
            for curve in amplitudes:
                if curve.is_upper == is_upper:
                    exact = end(2, curve.restitution, f, g, **chosen)
                    np.testing.assert_array_equal(curve.forcing, exact)


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


@pytest.mark.parametrize(("low", "high"), [(-3.0, 0.5), (-3.0, -1.0), (1.0, 3.0)])
@pytest.mark.parametrize("as_grid", [True, False])
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


def test_a_grid_is_drawn_as_its_own_cells(small_grid):
    sweep = small_grid
    mesh = numbers_of(parameter_plane(sweep, "rebound_height_max").figure)
    assert isinstance(mesh, QuadMesh)
    np.testing.assert_array_equal(mesh.get_array().ravel(), sweep.rebound_height_max)
    corners = mesh.get_coordinates()
    np.testing.assert_allclose(corners[0, 0], [0.8 - 0.015, 0.3 - 0.4])
    assert mesh.axes.get_ylim()[0] == 0.0


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
    for size in (40_000, 400_000):
        sweep, count = synthetic_sweep(size), itertools.count()
        sys.setprofile(lambda *event, count=count: next(count))
        try:
            figure = parameter_plane(sweep, variable).figure
            figure.savefig(tmp_path / "plane.png", dpi=200)
        finally:
            sys.setprofile(None)
        calls.append(next(count))
        assert isinstance(numbers_of(figure), QuadMesh)
    assert calls[1] < 1.2 * calls[0]


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
    for name, one in texts.variables.items():
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
