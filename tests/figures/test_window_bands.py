"""Figures of windows, bifurcation diagrams and basins show what their datasets hold."""

import io

import numpy as np
import pytest
import xarray as xr
from matplotlib.colors import to_rgb

import vibrosweep as vs
from tests.scans import basins, bifurcation, find_windows
from vibrosweep import theory
from vibrosweep.errors import DataError
from vibrosweep.figures.orbits import basins_of_attraction, bifurcation_diagram
from vibrosweep.figures.windows import stability_windows
from vibrosweep.model.forcing import FORCINGS
from vibrosweep.model.measures import Regime
from vibrosweep.scene.sweep import keyword_spec
from vibrosweep.theory import FIXED

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


def test_every_window_is_a_bar_between_its_ends(windows):
    locked, periodic = stability_windows(windows)
    assert labels(locked) == ["locked(1)", "locked(4)"]
    ways = {f"periodic, {way}" for way in ("both ways", "up only", "down only")}
    assert set(labels(periodic)) - {"undetermined"} <= ways
    lower = windows["A_min"].sel(condition=["locked(1)", "locked(4)"], direction="up")
    upper = windows["A_max"].sel(condition=["locked(1)", "locked(4)"], direction="up")
    known = np.isfinite(lower.values)
    found = sorted([*lower.values[known], *upper.values[known]])
    assert ends_of(locked) == pytest.approx(found)
    names = [text.get_text() for text in locked.texts]
    assert any("(4)" in name for name in names)
    assert not any("(2)" in name for name in names)


def test_a_dataset_without_windows_is_refused(windows):
    with pytest.raises(DataError, match="figure stability_windows needs the variable A_min"):
        stability_windows(windows.drop_vars("A_min"))


@pytest.mark.parametrize("base", FIXED)
@pytest.mark.parametrize("forcing", FORCINGS)
def test_windows_of_any_forcing_are_drawn_with_its_symbol(forcing, base):
    scene, scan = (
        keyword_spec({"duration": 2000.0, "base": base, "frequency": 2.0}).scene,
        np.geomspace(0.01, 4.0, 8),
    )
    figure = stability_windows(
        find_windows(scene, [0.7, 0.9], scan, ["locked(1)"], forcing=forcing)
    )[0].figure
    figure.savefig(io.BytesIO())
    assert len(figure.axes[0].texts) == 2


@pytest.mark.parametrize("rebound", ["rest", "reflect"])
def test_undetermined_points_are_grey(rebound):
    scene = keyword_spec({"particles": 2, "duration": 20.0, "rebound": rebound}).scene
    found = find_windows(scene, [0.9, 0.95], [0.5, 1.0, 1.5, 2.0], ["ordered"])
    unknown = found["holds"].values[0, 0] == -1
    assert unknown.any()
    (axes,) = stability_windows(found)
    (mesh,) = axes.collections
    np.testing.assert_array_equal(
        np.ma.getmaskarray(mesh.get_array()).T.reshape(-1), ~unknown.ravel()
    )
    assert "undetermined" in labels(axes)


def test_windows_of_another_forcing_have_its_axis_and_curves():
    scene, scan = (
        keyword_spec({"duration": 2000.0, "base": "moving"}).scene,
        np.linspace(0.1, 2.0, 8),
    )
    found = find_windows(scene, [0.7, 0.8, 0.9], scan, ["locked(1)"], forcing="base_acceleration")
    (axes,) = stability_windows(found)
    assert r"$\Gamma$" in axes.get_ylabel()
    ends = [*found["Gamma_min"].values.ravel(), *found["Gamma_max"].values.ravel()]
    assert ends_of(axes) == pytest.approx(sorted(ends))
    upper = axes.lines[-1]
    e = upper.get_xdata()
    exact = theory.amplitude_max(1, e, base="moving") * 2.0 * np.pi / (9.81 * (1.0 + e))
    assert upper.get_ydata() == pytest.approx(exact, rel=1e-12)


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
    figure.savefig(io.BytesIO())
    (axes,) = figure.axes
    assert len(labels(axes)) == len(names)
    handles = axes.get_legend().get_lines()
    assert len({to_rgb(line.get_color()) for line in handles}) == len(names)


def test_a_bifurcation_diagram_shows_every_impact_and_exponent():
    diagram = bifurcation(SCENE, np.linspace(0.4, 3.4, 15), samples=5)
    upper, lower = bifurcation_diagram(diagram)
    shown = np.concatenate([np.asarray(c.get_offsets()) for c in upper.collections])
    assert shown.shape == (2 * 15 * 2 * 5, 2)
    assert np.nanmax(shown[:, 1]) == pytest.approx(float(diagram["rebound_velocity"].max()))
    assert "velocity at lift-off" in upper.get_ylabel()
    heights = np.concatenate([np.asarray(line.get_ydata(), float) for line in lower.lines])
    assert np.isfinite(heights).all()
    assert lower.get_ylim()[0] < heights.min()


def test_a_bifurcation_diagram_says_how_many_orbits_are_unsettled():
    for duration, said in ((3.0, True), (3000.0, False)):
        diagram = bifurcation(keyword_spec({"duration": duration}).scene, [0.6, 0.7], samples=2)
        assert (diagram["regime"].values == Regime.UNSETTLED).any() == said
        upper, _ = bifurcation_diagram(diagram)
        assert upper.get_legend().get_title().get_text().endswith("of the orbits unsettled") == said


def test_basins_are_named_with_their_fractions():
    found = basins(
        keyword_spec({"duration": 3000.0}).scene,
        np.linspace(0.0, 0.95, 20),
        np.linspace(0.0, 9.0, 15),
    )
    (axes,) = basins_of_attraction(found).figure.axes
    assert len(labels(axes)) == found.sizes["attractor"]
    first = float(found["fraction"][0])
    assert labels(axes)[0].endswith(f"{100 * first:.3g} %")
    mesh = axes.collections[0].get_array()
    assert np.array_equal(np.asarray(mesh).ravel(), found["basin"].values.ravel())


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


def test_a_diagram_along_the_acceleration_is_that_along_the_amplitude(tmp_path):
    path = tmp_path / "shaker.toml"
    path.write_text(
        """title = "A shaker"
        [scene]
        base = "moving"
        frequency = 20.0
        duration_periods = 300.0
        launch_velocity = 0.2
        [sample]
        design = "grid"
        restitution = 0.7
        base_acceleration = [0.8, 1.0, 2.0]
        """,
        encoding="utf-8",
    )
    found = vs.bifurcation(path, observable="flight_time", samples=3)
    assert found["base_acceleration"].values == pytest.approx([0.8, 1.0, 2.0], rel=1e-15)
    amplitude = found["amplitude"].values
    assert amplitude == pytest.approx(np.array([0.8, 1.0, 2.0]) * 1.7 * 9.81 / (40.0 * np.pi))
    scene = keyword_spec(
        {
            "base": "moving",
            "frequency": 20.0,
            "restitution": 0.7,
            "launch_velocity": 0.2,
            "duration_periods": 300.0,
        }
    ).scene
    plain = bifurcation(scene, amplitude, observable="flight_time", samples=3)
    np.testing.assert_array_equal(found["flight_time"], plain["flight_time"])
    for diagram, words in ((found, "acceleration"), (plain, "amplitude")):
        upper, lower = bifurcation_diagram(diagram)
        assert labels(upper) == [f"{words} down", f"{words} up"]
        assert words in lower.get_xlabel()
        high = {"acceleration": 2.0, "amplitude": amplitude[-1]}[words]
        assert lower.lines[0].get_xdata().max() == pytest.approx(high, rel=1e-15)
