"""Points of every kind of result, and the realizations behind them."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import vibrosweep as vs
from vibrosweep.errors import DataError
from vibrosweep.explorer.points import of_result, open_points
from vibrosweep.store.arranged import flat

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
    values = found[found.attrs["observable"]].values
    assert points.count == np.isfinite(values).sum()
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
