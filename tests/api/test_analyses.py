"""Analyses from Python: the same as of a sweep file, whatever the number of threads."""

import pytest
import xarray as xr

import vibrosweep as vs
from vibrosweep.analysis.basins import basins_of_spec
from vibrosweep.analysis.bifurcation import bifurcation_of_spec
from vibrosweep.analysis.separations import separation_against, separation_distribution
from vibrosweep.analysis.windows import windows_of_spec
from vibrosweep.errors import DataError, ParameterError, SpecError, TableError
from vibrosweep.spec.sweep import parse_spec

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
            windows_of_spec,
        ),
        (
            vs.bifurcation,
            {"base_velocity": [0.3, 0.4], "samples": 5, "observable": "flight_time"},
            '[sample]\ndesign = "grid"\nbase_velocity = [0.3, 0.4]',
            lambda spec, threads: bifurcation_of_spec(spec, "flight_time", 5, threads),
        ),
        (
            vs.basins,
            {"launch_velocity": [4.0, 5.0], "launch": [0.0, 0.5]},
            '[scene]\nlaunch = [0.0, 0.5]\n[sample]\ndesign = "grid"\nlaunch_velocity = [4.0, 5.0]',
            basins_of_spec,
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
    ranges = {"restitution": (0.8, 0.98), "duration": 2.0}
    assert vs.sobol(ranges).equals(vs.sobol(**ranges))


def test_sobol_takes_what_is_fixed_and_measures_what_it_needs():
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
        (lambda: vs.windows(amplitude=(1.0, 2.0), realizations=2), SpecError, "a list of values"),
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
        (lambda: vs.separations(vs.sweep(), bins=0), ParameterError, "bins = 0: must be a whole"),
        (lambda: vs.separations(design="none.csv"), TableError, "table; check design$"),
        (lambda: vs.separations(vs.sweep()), DataError, "dt_min"),
        (lambda: vs.separations(vs.sweep(), particles=2), ParameterError, "particles: cannot"),
    ],
)
def test_mistakes_are_told_in_keywords(call, error, message):
    with pytest.raises(error, match=message):
        call()
