"""Absurd values of every option and argument of the laboratory: one clear message, no traceback."""

import contextlib
import inspect
from functools import partial

import numpy as np
import pandas as pd
import pytest

from vibrosweep import lab
from vibrosweep.cli import main
from vibrosweep.errors import ParameterError, TrackError, VibrosweepError
from vibrosweep.lab import FloorExperiment, Recording, film_drops, hear_drops
from vibrosweep.lab.compare import compare_tracks
from vibrosweep.lab.experiment import LABORATORY, Experiment
from vibrosweep.lab.traces import make_trace
from vibrosweep.lab.tracks import make_tracks
from vibrosweep.lab.trials import perform_trials

NUMBERS = ("nan", "inf", "-1", "0", "1e300", "", "abc")
OPTIONS = {
    "restitution": {
        **dict.fromkeys(("--drop-height", "--contact", "--gravity"), (*NUMBERS, "2:1", "nan:1")),
        **dict.fromkeys(("--mass", "--diameter", "--frame-rate", "--from", "--to"), NUMBERS),
        "--scale": NUMBERS,
        **dict.fromkeys(("--column", "--particle", "--sheet", "--axis"), ("", "abc")),
    },
    "impacts": {
        **dict.fromkeys(("--frequency", "--phase", "--frame-rate", "--scale", "--base"), NUMBERS),
        **dict.fromkeys(("--exposure", "--gravity", "--contact"), NUMBERS),
        **dict.fromkeys(("--column", "--particle", "--sheet", "--base-track"), ("", "abc")),
        "--base-trace": ("", "abc", "."),
    },
}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Times of impacts on a floor, a film of them, and empty files."""
    folder = tmp_path_factory.mktemp("absurd")
    setup = FloorExperiment(bounces=4, frame_rate=120.0)
    pd.DataFrame({"time (s)": hear_drops(setup)[0][0].time}).to_csv(
        folder / "times.csv", index=False
    )
    film = film_drops(setup)[0][0]
    table = pd.DataFrame({"time": film.time, "height": film.height})
    table.to_csv(folder / "film.csv", index=False)
    (folder / "empty.csv").write_text("")
    (folder / "noise.bin").write_bytes(bytes(range(256)) * 4)
    return folder


def run_command(capsys, *words):
    """Run a command, check its output, and return its exit code."""
    try:
        code = main([str(word) for word in words])
    except SystemExit as end:  # argparse
        code = end.code
    errors = capsys.readouterr().err
    assert code in (0, 2)
    assert "Traceback" not in errors
    if code == 2:
        assert errors.strip()
        # argparse's message names the option too
        assert "error:" in errors or errors.startswith("vibrosweep: ")
    return code


@pytest.mark.parametrize("part", OPTIONS)
def test_options_with_absurd_values_are_refused_in_one_message(part, files, capsys):
    for option, values in OPTIONS[part].items():
        for value in values:
            code = run_command(capsys, "lab", part, files / "times.csv", f"{option}={value}")
            if value in ("nan", "inf", "") and option not in ("--from", "--to"):
                assert code == 2, (part, option, value)


@pytest.mark.parametrize("part", ["restitution", "impacts", "compare"])
def test_empty_files_are_refused(part, files, capsys):
    for name in ("missing.csv", "empty.csv", "noise.bin", "."):
        assert run_command(capsys, "lab", part, files / name) == 2


def clicks(times):
    return Recording("clicks", "", np.asarray(times, float), None, None, True, True, 0.0, None)


ABSURD = (np.nan, np.inf, -np.inf, -1.0, 0.0, 1e300, 1e-300, (2.0, 1.0), (np.nan, 1.0), "abc", None)


def raises_only_own_errors(call):
    """Make a call that may only raise errors of this package with one-line messages."""
    with contextlib.suppress(VibrosweepError):
        try:
            call()
        except VibrosweepError as error:
            message = str(error)
            if not message or "\n" in message:
                raise RuntimeError(repr(message)) from error
            raise


def test_arguments_with_absurd_values_are_refused_in_one_message():
    drops = hear_drops(FloorExperiment(bounces=4))[0]
    ones = np.cumsum(0.05 + 0.01 * np.sin(np.arange(20.0)))
    for value in ABSURD:
        for name in ("contact", "mass", "diameter", "gravity", "drop_height", "begin", "end"):
            given = {name: value}
            if name in ("mass", "diameter"):
                given = {"mass": value, "diameter": value}
            raises_only_own_errors(lambda given=given: lab.restitution(drops, **given))
        for name in ("contact", "gravity", "frequency"):
            given = {"frequency": 20.0, name: value}
            raises_only_own_errors(lambda given=given: lab.times_on_shaker([clicks(ones)], **given))
    for times in ([], [1.0], [np.nan] * 5, [0.0] * 9, [1e300, -1e300, 0.0], [0.0, np.inf, 1.0]):
        raises_only_own_errors(lambda times=times: lab.restitution([clicks(times)]))
        raises_only_own_errors(
            lambda times=times: lab.times_on_shaker([clicks(times)], frequency=20.0)
        )
    raises_only_own_errors(lambda: lab.restitution([]))


TRACKS = {
    "find_impacts": ("gravity", "base", "exposure", "method", "motion", "frequency", "trace"),
    "compare_tracks": (
        *("method", "base", "exposure", "motion", "rebound", "restitution_law", "draws", "seed"),
        *("threads", "restitution", "amplitude", "frequency", "phase", "gravity", "contact_time"),
        "restitution_speed",
    ),
    "estimate": ("frequency", "frequency_range"),
}


@pytest.mark.parametrize("name", TRACKS)
def test_functions_of_tracks_refuse_absurd_arguments(name, locked, found):
    about = found if name == "estimate" else locked.tracks
    given = {"restitution": 0.9, "amplitude": 0.06, "frequency": 20.0, "draws": 2}
    given = given if name == "compare_tracks" else {}
    for argument in TRACKS[name]:
        for value in ABSURD:
            call = partial(getattr(lab, name), about, **{**given, argument: value})
            raises_only_own_errors(call)


def test_a_virtual_film_refuses_absurd_setups():
    """Experiments are only created; filming them is tested elsewhere."""
    for name in inspect.signature(lab.Experiment).parameters:
        for value in ABSURD:
            raises_only_own_errors(partial(lab.Experiment, **{name: value}))


@pytest.mark.parametrize("kind", [lab.Camera, lab.Variation])
def test_cameras_and_variations_refuse_absurd_values(kind):
    """On creation: each argument has the same range as its key in a file."""
    for name in inspect.signature(kind).parameters:
        endless = () if name == "terminal_speed" else (np.inf, 1e300)  # no drag
        for value in (np.nan, *endless, -1.0, (0.1, 0.2), "abc", None):
            with pytest.raises(ParameterError, match=rf"^{name} = .*: must be "):
                kind(**{name: value})


def test_virtual_drops_refuse_absurd_setups():
    for name in inspect.signature(FloorExperiment).parameters:
        for value in ABSURD:

            def call(name=name, value=value):
                setup = FloorExperiment(**{name: value})
                hear_drops(setup)
                film_drops(setup)

            raises_only_own_errors(call)


WRONG = ("x", 5, None, [5], {}, lab.Camera())


@pytest.mark.parametrize(
    "function", ["find_impacts", "perform_trials", "predicted_means", "film_drops", "hear_drops"]
)
def test_what_is_of_another_kind_is_refused(function):
    for value in WRONG:
        with pytest.raises(VibrosweepError, match=r"must be (an?|what) "):
            getattr(lab, function)(value)


@pytest.mark.parametrize("record", [film_drops, hear_drops])
def test_virtual_drops_take_whole_numbers(record):
    for given in ({"drops": "x"}, {"drops": 0}, {"drops": 1.5}, {"seed": "x"}, {"seed": -1}):
        with pytest.raises(ParameterError, match=f"{next(iter(given))} = .*must be a whole number"):
            record(FloorExperiment(), **given)


def test_messages_name_options_as_they_are_typed(files, capsys):
    for words, option in (
        (("compare", "film.csv", "--draws", "1"), "--draws 1: "),
        (("restitution", "times.csv", "--drop-height", "2:1"), "--drop-height [2.0, 1.0]: "),
        (("restitution", "film.csv", "--frame-rate", "-1"), "--frame-rate -1.0: "),
        (("impacts", "film.csv", "--base-track="), '--base-track "": '),
        (("impacts", "film.csv", "--frequency", "-2"), "--frequency -2.0: "),
    ):
        part, file, *rest = words
        assert main(["lab", part, str(files / file), *rest]) == 2
        assert option in capsys.readouterr().err


# --- Extreme numbers: one message or a result, never an endless computation ---

TIME = np.arange(960) / 240.0
OMEGA = 40.0 * np.pi


@pytest.fixture(scope="module")
def moving():
    """Tracks over a base that moves, at Gamma 0.4."""
    amplitude = 1.9 * 0.4 * LABORATORY["gravity"] / OMEGA
    scene = {**LABORATORY, "amplitude": amplitude, "phase": 0.7}
    plan = Experiment(**scene, base="moving", particles=1, repeats=1, transient=0.0, duration=2.0)
    return perform_trials(plan)[0].tracks


@pytest.fixture(scope="module")
def films(moving, tmp_path_factory):
    """The same tracks as a plain table and as one of trackpy."""
    folder = tmp_path_factory.mktemp("tracks")
    table = moving["height"].to_dataframe().reset_index()
    table[["time", "particle", "height"]].to_csv(folder / "plain.csv", index=False)
    table["y"] = -table["height"] / 1e-4
    table[["frame", "particle", "y"]].to_csv(folder / "pixels.csv", index=False)
    return folder


@pytest.mark.parametrize("name", ["plain.csv", "pixels.csv"])
def test_every_number_of_a_recording(name, films, capsys):
    for option in ("frame-rate", "scale", "base", "gravity", "frequency"):
        for value in ("1.7e308", "-1e300", "1e30", "1e-30", "5e-324"):
            given = {"frame-rate": "240", "scale": "1e-4"} if name == "pixels.csv" else {}
            given[option] = value
            words = [f"--{key}={number}" for key, number in given.items()]
            run_command(capsys, "lab", "impacts", films / name, "--base-motion=level", *words)


@pytest.mark.parametrize("time", [TIME * 1e300, TIME * 1e-300, TIME * 1e7, TIME * 1e-12])
def test_times_that_no_camera_has(time):
    height = np.abs(np.sin(20.0 * TIME))
    with pytest.raises(TrackError, match="must be"):
        make_tracks(time, height[:, np.newaxis])
    with pytest.raises(TrackError, match="must be"):
        make_trace(time, height, "height")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.full(TIME.size, 0.25), "does not change"),
        (1e-300 * np.sin(OMEGA * TIME), "does not change"),
        (1e300 * np.sin(OMEGA * TIME), "must be at most"),
        (1e-3 * TIME, "no whole period"),
        (1e-3 * TIME**2, "no whole period"),
    ],
)
def test_a_trace_of_a_table_that_is_switched_off_or_drifts(values, message):
    with pytest.raises(TrackError, match=message):
        make_trace(TIME, values, "acceleration")


def test_the_command_refuses_a_trace_that_does_not_change(films, tmp_path, capsys):
    path = tmp_path / "base.csv"
    pd.DataFrame({"time": TIME, "height": 0.25}).to_csv(path, index=False)
    assert main(["lab", "impacts", str(films / "plain.csv"), "--base-trace", str(path)]) == 2
    assert "the height does not change: leave the trace out" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("motion", "known"),
    [
        ("detect", {"amplitude": 0.0}),
        ("moving", {"amplitude": 1e30}),
        ("level", {"amplitude": 1e-300}),
        ("level", {"frequency": 1e-30}),
        ("detect", {"frequency": 1e9}),
    ],
)
def test_predictions_with_impossible_parameters(motion, known, moving):
    """Such as those of a table that is switched off, over which bouncing ends."""
    given = {"restitution": 0.9, "amplitude": 0.05, "frequency": 20.0, **known}
    try:
        table = compare_tracks(moving, motion=motion, draws=2, threads=1, **given)
    except VibrosweepError:  # refused with one message
        return
    assert (table["measured"] > 0.0).all()
