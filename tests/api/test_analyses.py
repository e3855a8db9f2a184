"""Analyses from Python."""

import inspect
import math
import re

import cloudpickle
import numpy as np
import pandas as pd
import pytest
import xarray as xr

import vibrosweep as vs
from tests.cases import each_of
from vibrosweep.analysis.basins import basins
from vibrosweep.analysis.bifurcation import bifurcation
from vibrosweep.analysis.separations import separation_against, separation_distribution
from vibrosweep.analysis.windows import find_windows
from vibrosweep.api import keyword_types
from vibrosweep.api.sweeps import as_sweep
from vibrosweep.cli import main
from vibrosweep.commands.describe import describe
from vibrosweep.errors import (
    DataError,
    ExistingOutputError,
    ParameterError,
    RunError,
    ShortObservationWarning,
    SpecError,
    TableError,
)
from vibrosweep.lab.experiment import LABORATORY, Experiment
from vibrosweep.lab.trials import perform_trials
from vibrosweep.model.measures import UNDETERMINED
from vibrosweep.proof.sampling import read_sample
from vibrosweep.runs.chunks import in_process
from vibrosweep.runs.driver import retry_failed, run_sweep
from vibrosweep.scene.keys import SECTIONS
from vibrosweep.scene.sweep import keyword_spec, parse_spec

# Analyses from Python give the same as those of a sweep file, with any number of threads.

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
            lambda spec, threads: bifurcation(spec, "flight_time", 5, 8, threads),
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


@each_of(
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


@each_of("base", ["high-bounce", "moving"])
@each_of(("analysis", "keywords"), ORBITS)
def test_orbits_that_are_observed_too_briefly_are_warned_of_once_and_noted(
    analysis, keywords, base
):
    enough = vs.theory.recognition_periods(0.9, base=base)
    for given in ({"duration": 12.0}, {"duration_periods": 0.9 * enough}):
        with pytest.warns(ShortObservationWarning, match="unsettled") as caught:
            found = analysis(**keywords, **given, base=base, restitution=0.9)
        (warning,) = caught
        assert warning.filename == __file__
        assert found.attrs["notes"].endswith(f"observation: {warning.message}")
    found = analysis(**keywords, duration_periods=1.1 * enough, base=base, restitution=0.9)
    assert "observation" not in found.attrs["notes"]


@each_of("base", ["high-bounce", "moving"])
@each_of(("analysis", "keywords"), ORBITS)
def test_without_a_duration_orbits_are_observed_until_they_settle(analysis, keywords, base):
    found = analysis(**keywords, base=base, restitution=0.9, frequency=25.0)
    enough = vs.theory.recognition_periods(0.9, base=base)
    assert "observation" not in found.attrs["notes"]
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
    assert "observation" not in vs.sobol(**asks).attrs["notes"]


SHAKEN = {"frequency": 60.0, "base_acceleration": [0.5, 1.0]}
LINE = {"restitution": 0.5, "amplitude": [1.0, 2.0]}


@each_of(
    ("analysis", "keywords", "subjects"),
    [
        (vs.windows, SHAKEN, {"defaults", "base"}),  # locked orbits, which no particle looks for
        (vs.windows, SHAKEN | {"conditions": ["ordered"]}, {"defaults", "base", "launch"}),
        (vs.bifurcation, SHAKEN | {"samples": 2}, {"defaults", "base", "launch"}),
        (vs.basins, {"launch_velocity": [4.0], "frequency": 60.0}, {"defaults", "launch"}),
        (vs.orbits, {"base_acceleration": 0.8, "impacts": 1, "periods": 1}, {"defaults", "base"}),
        (vs.branches, LINE | {"impacts": 1, "periods": 1}, {"defaults"}),
        (vs.branches, LINE | {"base": "high-bounce"}, {"defaults"}),
    ],
)
def test_analyses_remark_on_the_scene_as_sweeps_do(analysis, keywords, subjects):
    found = analysis(**keywords).attrs["notes"]
    assert {one.partition(":")[0] for one in re.split(r"; (?=[a-z]+: )", found)} == subjects
    assert found.startswith("defaults: base high-bounce, ") == ("base" not in keywords)
    assert ("launch_velocity" in found.partition(";")[0]) == (
        "launch" in subjects and "launch_velocity" not in keywords
    )


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
    assert said.count("\ndefaults: base high-bounce, ") == 1
    assert not complained
    with xr.open_dataset(tmp_path / f"x_{command}.h5", engine="h5netcdf") as found:
        assert "such orbits may be called unsettled" in found.attrs["notes"]


# An editor completes the keys of a sweep file, in every function that takes them.

KEYS = {"title", *SECTIONS["scene"], *SECTIONS["sample"], *SECTIONS["measure"]}
EXPECTED = {
    "BatchKeywords": {*SECTIONS["scene"], "launch_time", "noise_stream", *SECTIONS["measure"]},
    "RealizationKeywords": KEYS,
    "SweepKeywords": KEYS | {*SECTIONS},
    "WindowKeywords": KEYS | {*SECTIONS} | {*SECTIONS["windows"]},
}
FUNCTIONS = {
    name: getattr(vs, name).__annotations__["keywords"].removeprefix("Unpack[").removesuffix("]")
    for name in vs.__all__
    if inspect.isfunction(getattr(vs, name)) and "keywords" in getattr(vs, name).__annotations__
}


@pytest.mark.parametrize("name", keyword_types.__all__)
def test_typed_keywords_are_the_keys_of_a_sweep_file(name):
    assert getattr(keyword_types, name).__optional_keys__ == EXPECTED[name]


def test_every_function_states_the_type_of_its_keywords():
    assert {"sweep", "simulate", "windows", "bifurcation", "basins", "sobol"} <= FUNCTIONS.keys()
    assert {*FUNCTIONS.values()} == {*keyword_types.__all__}


@each_of("name", FUNCTIONS)
def test_signatures_name_every_keyword_so_that_notebooks_complete_it(name):
    """IPython completes what a signature names; it does not look into types."""
    shown = inspect.signature(getattr(vs, name)).parameters
    keys = getattr(keyword_types, FUNCTIONS[name]).__optional_keys__
    assert {one for one, p in shown.items() if p.kind is p.KEYWORD_ONLY} >= keys
    assert "keywords" not in shown


# The laboratory by its public names: parameters from files of tracks and of the base.

FREQUENCY, ACCELERATION, RESTITUTION = LABORATORY["frequency"], 0.6, 0.9


def test_from_files_to_parameters(tmp_path):
    turn = 2.0 * math.pi * FREQUENCY
    peak = ACCELERATION * LABORATORY["gravity"]
    scene = {**LABORATORY, "amplitude": (1.0 + RESTITUTION) * peak / turn}
    film = perform_trials(
        Experiment(**scene, base="moving", particles=2, repeats=1, transient=0.0, duration=2.0)
    )[0]
    table = film.tracks["height"].to_dataframe().reset_index().dropna()
    table[["time", "particle", "height"]].to_csv(tmp_path / "tracks.csv", index=False)
    time = np.arange(0.0, 2.0, 1e-3)
    shaken = {"time": time, "acceleration": peak * np.cos(turn * time)}
    pd.DataFrame(shaken).to_csv(tmp_path / "base.csv", index=False)

    trace = vs.lab.read_trace(tmp_path / "base.csv")
    found = vs.lab.find_impacts(vs.lab.read_tracks(tmp_path / "tracks.csv"), trace=trace)
    one = vs.lab.estimate(found)
    assert abs(float(one["base_acceleration"]) / ACCELERATION - 1.0) < 1e-3
    own = one.sel(parameter="restitution")
    assert abs(float(own["estimate"]) - RESTITUTION) < 5.0 * float(own["error"]) < 0.05


# Observables from Python: in memory, in files, in chunks, and after an interruption.

BINS = 8
SWEEP = {
    "restitution": (0.8, 0.98),
    "amplitude": (0.2, 3.5),
    "realizations": 40,
    "particles": 3,
    "seed": 4,
}


def count(totals, landing):
    totals[int((landing.phase + 0.5) * BINS) % BINS] += 1.0


def count_more(totals, landing):
    totals[int((landing.phase + 0.5) * BINS) % BINS] += 2.0


def phases(function=count, **changes):
    given = {"along": "landing_phase", "values": (np.arange(BINS) + 0.5) / BINS - 0.5} | changes
    return vs.Observable("landings_at_phase", function, "landings by phase", **given)


@pytest.fixture(scope="module")
def in_memory():
    return vs.sweep(SWEEP, observables=[phases()])


def test_a_histogram_of_phases(in_memory):
    found = in_memory.landings_at_phase
    assert found.dims == ("realization", "landing_phase")
    assert found.attrs == {"long_name": "landings by phase", "units": "1"}
    np.testing.assert_array_equal(found.landing_phase, phases().values)
    np.testing.assert_array_equal(found.sum("landing_phase"), in_memory.impact_count)
    assert in_memory.attrs["source_of_landings_at_phase"].startswith("def count(")


def test_a_file_in_chunks_holds_the_same(in_memory, tmp_path):
    """Also after an interruption, if the run is continued with the same function."""
    path = tmp_path / "out.h5"

    def interrupted(job, indices, tick):
        in_process(1)(job, indices[:2], tick)
        raise KeyboardInterrupt

    spec = as_sweep(SWEEP, {}).with_observables([phases()])
    with pytest.raises(KeyboardInterrupt):
        run_sweep(spec, path, threads=1, chunk=10, runner=interrupted)
    with pytest.raises(RunError, match=r"landings_at_phase\.code: was"):
        vs.run(SWEEP, path, observables=[phases(count_more)])
    with vs.run(SWEEP, path, observables=[phases()]) as found:
        assert found.landings_at_phase.identical(
            in_memory.landings_at_phase.assign_coords(found.landings_at_phase.coords)
        )
    vs.run(SWEEP, path, observables=[phases()]).close()  # opened: it holds this sweep
    for others in ([phases(count_more)], [phases(initial=1.0)], []):
        with pytest.raises(ExistingOutputError, match="landings_at_phase"):
            vs.run(SWEEP, path, observables=others)


def test_a_retry_without_the_observable_is_refused(tmp_path):
    path = tmp_path / "out.h5"
    vs.run(SWEEP, path, observables=[phases()]).close()
    with pytest.raises(RunError, match=r"landings_at_phase\.code: "):
        retry_failed(keyword_spec(SWEEP), path, threads=1)


def test_an_observable_reaches_workers_of_a_cluster():
    """Functions of a script or a notebook are sent by value, with the numbers that they use."""

    def bins(number):
        def function(totals, landing):
            totals[int((landing.phase + 0.5) * number) % BINS] += math.fabs(1.0)

        return function

    spec = keyword_spec(SWEEP).with_observables([phases(bins(BINS))])
    sent = cloudpickle.loads(cloudpickle.dumps(spec))
    assert sent == spec
    assert sent.scene.measures.observables[0].code == spec.scene.measures.observables[0].code
    assert spec != keyword_spec(SWEEP).with_observables([phases(bins(BINS + 1))])


def test_an_observable_that_cannot_be_compiled_leaves_no_file(tmp_path):
    def function(totals, landing):
        totals[0] += landing.colour

    one = vs.Observable("seen", function, "no such quantity")
    with pytest.raises(ParameterError, match="numba cannot compile"):
        vs.run(SWEEP, tmp_path / "out.h5", chunk=10, observables=[one])
    assert not list(tmp_path.iterdir())


def test_names_that_are_taken_are_refused(tmp_path):
    with pytest.raises(ParameterError, match="name"):
        vs.sweep(SWEEP, observables=[phases(), phases()])
    table = tmp_path / "pairs.csv"
    table.write_text("restitution,amplitude,landing_phase\n0.9,1.2,3\n", encoding="utf-8")
    with pytest.raises(TableError, match="landing_phase"):
        vs.sweep(design=str(table), observables=[phases()])


def test_a_description_lists_an_observable_and_verification_does_not_compare_it(tmp_path):
    path = tmp_path / "out.h5"
    table = {"restitution": [0.8, 0.9], "amplitude": [1.0, 2.0], "ball": ["brass", "steel"]}
    vs.run({"design": table}, path, observables=[phases()]).close()
    told = [line.split(maxsplit=1) for line in describe(path)]
    assert ["landings_at_phase", "landings by phase (realization, landing_phase)"] in told
    assert ["ball", "(realization)"] in told
    assert "landings_at_phase" in read_sample(path, 2, 0)[0].others


ABSURD = [1, None, "x", 3.5, [], {}, 1j, b"x", float("nan"), 10**400]


@each_of("value", ABSURD)
def test_what_is_registered_has_its_type(value):
    for register in (
        lambda: vs.register_law(value),
        lambda: vs.register_kind(value),
        lambda: vs.register_kind(vs.ResultKind("absurd", "x", draw=value or 1)),
        lambda: vs.register_design(value, value),
        lambda: vs.register_design("absurd", value),
        lambda: vs.Observable(value, value, value),
        lambda: vs.Law(value, value, value, value),
    ):
        with pytest.raises(ParameterError):
            register()


@each_of("threads", [10**400, 10**20, 0, -1, 1.5, "2", True])
def test_a_number_of_threads_that_no_machine_has(threads):
    with pytest.raises(ParameterError, match=r"threads = .*at least 1 and at most 4096"):
        vs.sweep(amplitude=1.0, duration=5.0, threads=threads)


def test_an_observable_that_is_not_real():
    imaginary = vs.Observable(
        "absurd", lambda landing: 1j * landing.impact_speed, "x", landings="sum"
    )
    with pytest.raises(ParameterError, match="complex128; it must be a real number"):
        vs.sweep(amplitude=1.0, duration=5.0, observables=[imaginary])
