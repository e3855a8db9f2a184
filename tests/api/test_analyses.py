"""Analyses from Python give the same as those of a sweep file, with any number of threads."""

import numpy as np
import pytest
import xarray as xr

import vibrosweep as vs
from vibrosweep.analysis.basins import basins
from vibrosweep.analysis.bifurcation import bifurcation
from vibrosweep.analysis.separations import separation_against, separation_distribution
from vibrosweep.analysis.windows import find_windows
from vibrosweep.cli import main
from vibrosweep.errors import (
    DataError,
    ParameterError,
    ShortObservationWarning,
    SpecError,
    TableError,
)
from vibrosweep.model.measures import UNDETERMINED
from vibrosweep.scene.sweep import parse_spec

TITLE = 'title = "x"\n'


def only_numbers(dataset):
    return dataset.drop_attrs(deep=False)


@pytest.mark.parametrize(
    ("function", "keywords", "text", "of_file"),
    [
        (
            vs.windows,
            {"amplitude": [0.3, 0.6, 4.0], "restitution": 0.8, "tolerance": 1e-6},
            '[scene]\nrestitution = 0.8\n[windows]\nconditions = ["locked(1)"]\ntolerance = 1e-6\n'
            '[sample]\ndesign = "grid"\namplitude = [0.3, 0.6, 4.0]',
            find_windows,
        ),
        (
            vs.bifurcation,
            {
                "base_velocity": [0.3, 0.4],
                "samples": 5,
                "observable": "flight_time",
                "duration": 1500.0,
            },
            '[scene]\nduration = 1500.0\n[sample]\ndesign = "grid"\nbase_velocity = [0.3, 0.4]',
            lambda spec, threads: bifurcation(spec, "flight_time", 5, threads),
        ),
        (
            vs.basins,
            {"launch_velocity": [4.0, 5.0], "launch": [0.0, 0.5], "duration": 1500.0},
            "[scene]\nduration = 1500.0\nlaunch = [0.0, 0.5]\n"
            '[sample]\ndesign = "grid"\nlaunch_velocity = [4.0, 5.0]',
            basins,
        ),
    ],
)
def test_keywords_and_a_file_give_the_same(function, keywords, text, of_file):
    expected = only_numbers(of_file(parse_spec(TITLE + text), 1))
    for threads in (1, 2):
        found = only_numbers(function(**keywords, threads=threads))
        xr.testing.assert_identical(found, expected)


def test_a_mapping_means_what_the_same_keywords_mean():
    scene = {"amplitude": [0.1, 1.0, 2.0], "restitution": 0.9, "duration": 60.0}
    assert vs.windows(scene).equals(vs.windows(**scene))
    result = vs.sweep(scene)
    assert vs.windows(result).equals(vs.windows(scene))
    assert vs.windows(result, tolerance=1e-3).attrs["tolerance"] == 1e-3
    with pytest.raises(DataError, match="attributes"):
        vs.windows(result.drop_attrs())
    ranges = {"restitution": (0.8, 0.98), "duration": 2.0}
    assert vs.sobol(ranges).equals(vs.sobol(**ranges))


def test_sobol_takes_fixed_parameters_and_chooses_its_outputs():
    asks = {"restitution": (0.5, 0.9), "launch_velocity": (4.0, 5.0), "realizations": 64}
    found = vs.sobol(**asks, amplitude=0.0, gravity=2.0, outputs=["rebound_height_max"])
    mean = found["mean"].item()
    # e^2 v0^2 / 2g over both ranges
    assert mean == pytest.approx((0.9**3 - 0.5**3) / 1.2 * (61.0 / 3.0) / 4.0, rel=0.02)
    of_pairs = vs.sobol(**asks, particles=2)
    assert "dt_min" in of_pairs.output
    assert "dt_min" not in vs.sobol(**asks).output


def test_separations_of_keywords_and_of_a_result():
    asks = {"amplitude": (0.5, 3.5), "realizations": 32, "particles": 4}
    result = vs.sweep(**asks, separation=True)
    xr.testing.assert_identical(vs.separations(**asks), separation_distribution(result))
    xr.testing.assert_identical(
        vs.separations(result, against="amplitude", bins=3),
        separation_against(result, "amplitude", bins=3),
    )


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: vs.windows(amplitude=1.0, restitution=[0.8]), SpecError, "a list of values"),
        (
            lambda: vs.windows(amplitude=(1.0, 2.0), phase=(0.0, 1.0)),
            SpecError,
            "phase",
        ),
        (lambda: vs.windows(amplitude=[1.0, 2.0], conditions=["what"]), SpecError, "'what' is not"),
        (lambda: vs.windows(amplitude=[1.0, 2.0], continuaton=True), SpecError, '"continuation"'),
        (lambda: vs.bifurcation(amplitude=1.0), SpecError, "a list of values for amplitude"),
        (lambda: vs.bifurcation(amplitude=[1.0], samples=0), ParameterError, "samples = 0"),
        (lambda: vs.bifurcation(amplitude=[1.0], observable="x"), ParameterError, "observable"),
        (lambda: vs.basins(particles=3), SpecError, "a list of values for launch_velocity"),
        (lambda: vs.sobol(amplitude=[1.0, 2.0]), SpecError, r"restitution = \(low, high\)"),
        (lambda: vs.sobol(amplitude=(1.0, 2.0), realizations=3), ParameterError, "power of 2"),
        (lambda: vs.sobol(amplitude=(1.0, 2.0), outputs="dt_min"), ParameterError, "outputs = 'd"),
        (lambda: vs.sobol(amplitude=(1.0, 2.0), outputs=[]), ParameterError, "must be a list"),
        (lambda: vs.sobol(amplitude=(1.0, 2.0), confidence=95), ParameterError, "confidence = 95"),
        (lambda: vs.separations(vs.sweep(), bins=0), ParameterError, "bins = 0:"),
        (lambda: vs.separations(design="none.csv"), TableError, "table; check design$"),
        (lambda: vs.separations(vs.sweep()), DataError, "dt_min"),
        (lambda: vs.separations(vs.sweep(), particles=2), ParameterError, "particles: cannot"),
        (lambda: vs.separations({}, particles=2), ParameterError, "particles: cannot"),
    ],
)
def test_messages_about_mistakes_name_the_keyword(call, error, message):
    with pytest.raises(error, match=message):
        call()


ORBITS = [
    (vs.windows, {"amplitude": [0.5, 1.0], "conditions": ["ordered"]}),
    (vs.windows, {"amplitude": [0.5, 1.0], "conditions": ["regular"], "continuation": True}),
    (vs.bifurcation, {"amplitude": [0.5, 1.0], "samples": 2}),
    (vs.basins, {"launch_velocity": [4.0]}),
]


@pytest.mark.parametrize("base", ["high-bounce", "moving"])
@pytest.mark.parametrize(("analysis", "keywords"), ORBITS)
def test_orbits_that_are_observed_too_briefly_are_warned_of_once_and_noted(
    analysis, keywords, base
):
    enough = vs.theory.recognition_periods(0.9, base=base)
    for given in ({"duration": 12.0}, {"duration_periods": 0.9 * enough}):
        with pytest.warns(ShortObservationWarning, match="unsettled") as caught:
            found = analysis(**keywords, **given, base=base, restitution=0.9)
        (warning,) = caught
        assert warning.filename == __file__
        assert found.attrs["notes"] == str(warning.message)
    found = analysis(**keywords, duration_periods=1.1 * enough, base=base, restitution=0.9)
    assert found.attrs["notes"] == ""


@pytest.mark.parametrize("base", ["high-bounce", "moving"])
@pytest.mark.parametrize(("analysis", "keywords"), ORBITS)
def test_without_a_duration_orbits_are_observed_until_they_settle(analysis, keywords, base):
    found = analysis(**keywords, base=base, restitution=0.9, frequency=25.0)
    enough = vs.theory.recognition_periods(0.9, base=base)
    assert found.attrs["notes"] == ""
    assert found.duration * 25.0 > 3.9 * enough
    with pytest.warns(ShortObservationWarning, match="100000 are observed"):
        analysis(**keywords, base=base, restitution=0.9999)  # longest default duration


def test_windows_of_regular_motion_do_not_fall_apart():
    found = vs.windows(
        restitution=np.linspace(0.8, 0.95, 4),
        amplitude=np.linspace(0.2, 3.5, 50),
        conditions=["regular"],
        particles=5,
    )
    assert found.window_count.values.ravel().tolist() == [1, 1, 1, 1]
    assert not (found.holds == UNDETERMINED).any()


def test_windows_scan_the_ranges_of_a_random_sweep():
    spec = {"restitution": (0.8, 0.9), "amplitude": (0.2, 3.5), "realizations": 7, "seed": 3}
    found = vs.windows(spec)
    assert found.sizes["restitution"] == 25
    assert found.scan.values[[0, -1]].tolist() == [0.2, 3.5]
    assert "over the ranges of the uniform design" in found.attrs["grid"]
    one = found.isel(condition=0, direction=0, window=0)
    closed = vs.theory.amplitude_max(1, one.restitution.values)
    assert (abs(one.A_max - closed) <= one.A_max_bracket).all()


def test_a_condition_of_landings_keeps_the_duration_of_sweeps():
    found = vs.windows(amplitude=[0.5, 1.0], conditions=["separated"], particles=2)
    assert found.duration == 12.0


def test_sobol_warns_of_short_observations_for_outputs_of_orbits_only():
    asks = {"amplitude": (0.2, 3.0), "phase": (0.0, 1.0), "realizations": 8, "particles": 6}
    with pytest.warns(ShortObservationWarning):
        vs.sobol(**asks, outputs=["unsettled_count"], duration=100.0)
    assert vs.sobol(**asks).attrs["notes"] == ""


@pytest.mark.parametrize("command", ["windows", "basins", "bifurcation"])
def test_the_command_line_prints_the_note_once(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    swept = "launch_velocity = [4.0, 5.0]" if command == "basins" else "amplitude = [0.5, 1.0]"
    text = TITLE + f'[scene]\nparticles = 2\nduration = 12.0\n[sample]\ndesign = "grid"\n{swept}\n'
    if command == "windows":
        text += '[windows]\nconditions = ["ordered"]\n'
    (tmp_path / "x.toml").write_text(text)
    assert main([command, "x.toml"]) == 0  # warnings are errors here
    said, complained = capsys.readouterr()
    assert said.count("such orbits may be called unsettled") == 1
    assert not complained
    with xr.open_dataset(tmp_path / f"x_{command}.h5", engine="h5netcdf") as found:
        assert "such orbits may be called unsettled" in found.attrs["notes"]
