"""Points, choices and tables of the page."""

import math
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.path import Path as Polygon

import vibrosweep as vs
from vibrosweep.engine.landings import launch_times
from vibrosweep.errors import DataError
from vibrosweep.explorer import words
from vibrosweep.explorer.points import (
    MOST_PERIODS,
    Choice,
    Column,
    Spread,
    of_result,
    open_points,
    points_of,
)
from vibrosweep.explorer.views import SCALES, Scale, colouring
from vibrosweep.explorer.words import TABLE, facts, facts_html, in_polygon, in_rectangle, table
from vibrosweep.model.parameters import BASES, PARAMETERS, Periods
from vibrosweep.scene.scene import Scene
from vibrosweep.store.arranged import flat

# Points of every kind of result, and the realizations behind them.

HERE = Path("out.h5")


def test_the_realization_behind_a_point_is_the_one_that_was_swept(results, base):
    points, swept = of_result(results[base], HERE, "sweep"), flat(results[base])
    counts = [points.choice(i).simulate().impact_count.sum() for i in range(points.count)]
    assert counts == swept.impact_count.values.tolist()
    assert {"frequency", "restitution"} <= points.choice(0).inputs.keys()


@pytest.mark.parametrize(
    ("of", "axes"),
    [
        ("high-bounce", ("restitution", "amplitude")),
        ("moving", ("restitution", "base_acceleration")),
        ("sprung", ("base_mass", "mount_frequency")),
    ],
)
def test_varied_parameters_become_the_axes(results, of, axes):
    assert of_result(results[of], HERE, "sweep").axes == axes


def test_codes_and_units_are_read_from_the_result(points):
    assert points.columns["amplitude"].label == "amplitude A (m s⁻¹)"
    assert points.columns["collision_free"].codes == {
        -1: "undetermined",
        0: "no",
        1: "yes",
    } or points.columns["collision_free"].codes.keys() >= {0, 1}
    assert points.columns["dt_min"].zero_apart
    assert not points.columns["impact_count"].codes


def test_ends_of_windows_are_points_and_open_ends_are_not():
    found = vs.windows(
        restitution=[0.7, 0.9],
        base_acceleration=np.linspace(0.05, 1.1, 12).tolist(),
        base="moving",
        conditions=["locked(1)", "locked(2)"],
    )
    points = of_result(found, HERE, "windows")
    ends = np.stack([found.Gamma_min.values, found.Gamma_max.values])
    assert points.count == np.isfinite(ends).sum() < ends.size
    assert np.array_equal(
        np.sort(points.columns["base_acceleration"].values), np.sort(ends[np.isfinite(ends)])
    )
    choice = points.choice(0)
    assert choice.scene.base == "moving"
    assert choice.inputs["base_acceleration"] == points.columns["base_acceleration"].values[0]
    assert "amplitude" not in choice.inputs
    assert points.columns["condition"].codes == {0: "locked(1)", 1: "locked(2)"}


@pytest.mark.parametrize("forcing", ["amplitude", "base_velocity"])
def test_impacts_of_a_bifurcation_diagram_are_points(forcing):
    scan = {forcing: [0.6, 1.2]}
    found = vs.bifurcation(restitution=0.9, **scan, launch=[0.125, 0.45], duration=1500.0)
    points = of_result(found, HERE, "bifurcation")
    name = found.attrs["observable"]
    ways = found[name].sel(direction="up"), found[name].sel(direction="down")
    ways = [np.isfinite(one.values).sum() for one in (*ways, found[f"launched_{name}"])]
    direction = points.columns["direction"]
    assert [np.count_nonzero(direction.values == code) for code in direction.codes] == ways
    assert [*direction.codes.values()] == ["up", "down", "new launches"]
    assert points.count == sum(ways)
    launched = direction.values == 2
    assert set(points.columns["regime"].values[launched]) == set(found.launched_regime.values.flat)
    assert points.choice(points.count - 1).inputs[forcing] == 1.2
    assert points.axes[0] == forcing
    assert points.choice(0).launch_time == (0.125, 0.45)
    assert "launched at each point" in points.remark


def test_a_point_of_basins_simulates_its_launch_alone():
    found = vs.basins(
        restitution=0.9,
        amplitude=1.2,
        particles=4,
        launch_velocity=[2.0, 5.0, 8.0],
        duration=1500.0,
    )
    points = of_result(found, HERE, "basins")
    assert points.count == 12
    choice = points.choice(7)
    time, speed = float(found.launch_time[3]), float(found.launch_velocity[1])
    assert choice.launch_time == (time,)
    assert choice.inputs["launch_velocity"] == speed
    one = found.basin.sel(launch_time=time, launch_velocity=speed)
    assert points.columns["basin"].values[7] == one


def test_a_file_gives_the_same_points_as_its_dataset(compute, results):
    path = compute(
        "[sample]\ndesign = 'uniform'\nrealizations = 4\nrestitution = [0.8, 0.9]\n"
        "[measure]\nper_particle = true\n"
    )
    points = open_points(path)
    with vs.open_sweep(path) as found:
        assert np.array_equal(points.columns["impact_count"].values, found.impact_count)
    assert points.axes[0] == "restitution"


def test_a_result_without_a_plane_is_refused():
    with pytest.raises(DataError, match="no plane"):
        of_result(xr.Dataset(), HERE, "impacts")


def test_a_point_of_another_waveform_is_simulated_with_it(tmp_path):
    shape = {"harmonics": [[1, 1.0, 0.0], [2, 0.4, 1.1]]}
    path = tmp_path / "tones.h5"
    scene = {"waveform": shape, "amplitude": (0.3, 3.0), "realizations": 3, "duration": 2.0}
    vs.run(scene, path).close()
    choice = open_points(path).choice(1)
    with vs.open_sweep(path) as found:
        given = float(found["amplitude"][1])
        waveform = found.waveform
    shown = choice.simulate()
    assert shown.waveform == waveform
    expected = vs.simulate(waveform=shape, amplitude=given, duration=2.0)
    np.testing.assert_array_equal(shown["landing_time"], expected["landing_time"])
    for base in ("moving", "sprung"):
        assert choice.over(base).scene.waveform == choice.scene.waveform


@pytest.mark.parametrize("base", ["high-bounce", "moving"])
def test_a_particle_follows_the_closed_orbit_that_was_clicked(base):
    orbits = vs.orbits(
        restitution=[0.7, 0.8], amplitude=[1.5, 2.0], impacts=2, periods=2, base=base
    )
    branches = vs.branches(restitution=0.8, amplitude=[1.5, 2.0], points=20, base=base)
    for result in (orbits, branches):
        points = points_of(result)
        assert points.count > 2
        for index in range(0, points.count, 3):
            impacts = int(points.columns["cycle_impacts"].values[index])
            speeds = points.choice(index).simulate().rebound_velocity.values[0, 0]
            expected = points.columns["rebound_velocity"].values[index]
            if points.columns["admissible"].values[index] == 1:
                assert speeds[impacts - 1] == pytest.approx(expected, rel=1e-7)


@given(
    values=st.lists(st.floats(-1e6, 1e6, allow_subnormal=False), min_size=1, max_size=30),
    kind=st.sampled_from(SCALES),
    ends=st.tuples(*(st.none() | st.floats(-1e6, 1e6, allow_subnormal=False) for _ in range(2))),
)
@settings(max_examples=100, deadline=None)
def test_arrows_say_where_a_scale_is_clipped(values, kind, ends):
    """The colours have a scale whatever is wished, and an arrow wherever it hides a number."""
    found = colouring(Column("height (m)", np.array(values)), Scale(kind, *ends))
    assert found.low < found.high
    assert not found.log or found.low > 0.0
    words = "".join(found.ticks.values())
    assert ("▼" in words) == (min(values) < found.low)
    assert ("▲" in words) == (max(values) > found.high)
    assert all(math.isfinite(end) for end in (found.mapping["low"], found.mapping["high"]))


# Choices for a simulation: bases, launches and times.

TABLE_1 = {name: one.default for name, one in PARAMETERS.items()}
MOUNT = {"mass_ratio": 0.001, "mount_frequency": 0.37, "mount_damping": 0.05}


@pytest.fixture
def choice():
    return Choice(Scene(inputs=TABLE_1, particles=4, rebound="reflect"), mount=MOUNT)


def test_launches_are_staggered_as_a_sweep_staggers_them(choice):
    times = choice.with_inputs(frequency=1.7).launch_time
    assert np.array_equal(times, launch_times("staggered", 4, 1.7))


def test_launches_can_be_shifted_and_spread(choice):
    spread = choice.with_inputs(frequency=2.0).launched(Spread(0.5, 0.1))
    assert np.allclose(spread.launch_time, 0.25 + 0.05 * np.arange(4) / 4, rtol=0, atol=1e-15)


def test_listed_launches_stay_until_their_number_changes(choice):
    times = (0.0, 0.1, 0.3, 0.4)
    listed = replace(choice, scene=replace(choice.scene, launch=times), spread=None)
    assert listed.with_particles(4).launch_time == (0.0, 0.1, 0.3, 0.4)
    assert len(listed.with_particles(7).launch_time) == 7


def test_the_mount_counts_over_a_sprung_base_only(choice):
    assert "mass_ratio" not in choice.keywords()
    assert choice.over("sprung").keywords()["mass_ratio"] == 0.001
    assert choice.over("sprung").over("moving") == choice.over("moving")


def test_another_base_gets_the_law_of_rebound_that_every_base_has(choice):
    assert choice.over("high-bounce").scene.rebound == "reflect"
    assert choice.over("moving").scene.rebound == "rest"


def test_long_observations_are_drawn_in_part(choice):
    assert choice.shortened() == choice
    longer = choice.lasting(5000.0).shortened()
    assert longer.scene.duration == Periods(MOST_PERIODS)
    assert longer.periods == MOST_PERIODS


def test_observations_are_of_the_same_particles(choice):
    launched = choice.over("moving")
    observed = launched.settle()
    assert observed.regime.shape == (1, 4)
    assert float(observed.duration[()]) == 2000.0
    coupled = choice.over("sprung").observe()
    record = choice.over("sprung").simulate()
    assert int(coupled.impact_count[0]) == int(record.impact_count.sum())


# Chosen points as a design: computed again they give the same bits.


def test_a_table_is_a_design_that_gives_the_same_numbers(points, results, tmp_path):
    rows = np.array([3, 4, 17, 29])
    path = tmp_path / TABLE
    path.write_text(table(points, rows), encoding="utf-8")
    again = vs.sweep(
        design=str(path), separation=True, progress=False, **points.base_choice.sweep_keywords()
    )
    chosen = results["high-bounce"].isel(realization=rows)
    for name in ("restitution", "amplitude", "impact_count", "dt_min", "rebound_height_max"):
        assert again[name].values.tobytes() == chosen[name].values.tobytes()


def test_points_of_one_realization_make_one_row(points):
    assert table(points, np.array([5, 5, 5])).count("\n") == 2


corners = st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=3, max_size=8)


@given(corners)
@settings(max_examples=50)
def test_points_in_a_polygon_are_those_that_matplotlib_finds(places):
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.1, 1.1, 13), (0.11, 0.52, 0.93)))
    x = x + 1e-3 * np.sqrt(2.0)  # off the corners
    across, up = np.array(places).T
    found = in_polygon(x, y, across, up)
    # matplotlib uses the even-odd rule, too
    closed = Polygon([*places, places[0]])
    near = closed.contains_points(np.column_stack([x, y]), radius=1e-9)
    far = closed.contains_points(np.column_stack([x, y]), radius=-1e-9)
    sure = near == far
    inside = np.isin(np.arange(x.size), found)
    assert np.array_equal(inside[sure], near[sure])


def test_points_in_a_rectangle():
    x, y = np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 5.0])
    assert in_rectangle(x, y, 0.5, 2.5, 0.0, 2.0).tolist() == [1]


# Facts in words agree with a sweep of the same realization.

TABLE_1_FACTS = {name: one.default for name, one in PARAMETERS.items()}


@pytest.mark.parametrize("base", BASES)
def test_facts_are_those_of_the_observation(base):
    choice = Choice(Scene(inputs=TABLE_1_FACTS, particles=2, duration=60.0), mount=MOUNT).over(base)
    observed, settled = choice.observe(), None if base == "sprung" else choice.settle()
    said = dict(facts(choice, observed, settled))
    one = observed.isel(realization=0)
    assert said["observed"] == "60 forcing periods"
    assert said["base"] == base
    assert said["largest rebound height"] == f"{float(one['rebound_height_max']):.5g} m"
    if base == "sprung":
        exponent = float(one["joint_exponent"])
        assert said["largest Lyapunov exponent per period"] == f"{exponent:.5g}"
    else:
        assert "regimes after 2000 periods" in said
        assert said["orbits, slots"].startswith(f"{int(settled.orbit_count[0])}, ")
    assert f"<td>{base}</td>" in facts_html(choice)


def test_a_missing_value_is_shown_as_not_known():
    choice = Choice(Scene(inputs=TABLE_1_FACTS, particles=2))
    observed = choice.observe()
    observed = observed.assign(
        {name: observed[name] * np.nan for name in ("dt_min", "rebound_height_max")}
    )
    said = dict(facts(choice, observed, None))
    assert said["smallest separation Δt min"] == "not known"
    assert said["largest rebound height"] == "not known"


def test_separations_are_those_of_the_window_of_the_result():
    scene = {"restitution": [0.8, 0.9], "amplitude": 1.9, "particles": 5, "duration": 9.0}
    for window in ({"transient": 3.0}, {"transient_periods": 2.5}):
        found = vs.sweep(**scene, **window, separation=True)
        choice = of_result(found, Path("memory.h5"), "sweep").choice(1).shortened()
        said = dict(facts(choice, choice.observe(), None))
        assert said["smallest separation Δt min"] == f"{found.dt_min.values[1]:.5g} s"
        begin = next(iter(window.values()))
        assert said["observed"] == f"{begin:g} to 9 forcing periods"


# The lines that the page gives run, and draw what the page draws.


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mpl.use("Agg")
    yield
    import matplotlib.pyplot as plt

    plt.close("all")


def executed(text):
    names = {}
    exec(text, names)
    return names


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("picture", words.PICTURES)
def test_lines_of_motions_give_the_record_and_a_picture(points, picture, tmp_path):
    choice = points.choice(3)
    names = executed(words.motion_lines(choice, picture))
    assert names["record"].equals(choice.simulate())
    assert len(list(tmp_path.glob("*.png"))) == 1
    if picture == "separations":
        drawn = names["axes"].collections[0].get_offsets()
        assert np.array_equal(
            drawn[:, 1], vs.analysis.landing_separations(choice.simulate())["separation"]
        )


SPECS = {
    "random": "restitution = [0.8, 0.9]\nrealizations = 4\n",
    "grid": 'design = "grid"\nrestitution = [0.8, 0.9]\namplitude = [1.0, 2.0, 3.0]\n',
}


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("kind", SPECS)
def test_lines_of_the_plane_and_of_a_table_run(kind, compute, tmp_path):
    path = compute(f"[scene]\nparticles = 2\n[sample]\n{SPECS[kind]}")
    points = open_points(path)
    names = executed(words.plane_lines(points, *points.axes, points.colour))
    drawn = names["axes"].collections[0].get_offsets()
    assert np.array_equal(drawn[:, 0], points.columns[points.axes[0]].values)
    assert (tmp_path / "plane.png").stat().st_size > 0
    (tmp_path / TABLE).write_text(table(points, np.array([1, 2])), encoding="utf-8")
    again = executed(words.table_lines(points, TABLE))["found"]
    assert np.array_equal(again.impact_count, points.columns["impact_count"].values[1:3])
