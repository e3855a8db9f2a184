"""Extreme numbers: one message or a result, never a traceback or an endless computation."""

import numpy as np
import pandas as pd
import pytest

from vibrosweep.cli import main
from vibrosweep.errors import TrackError, VibrosweepError
from vibrosweep.lab.compare import compare_tracks
from vibrosweep.lab.experiment import LABORATORY, Experiment
from vibrosweep.lab.traces import make_trace
from vibrosweep.lab.tracks import make_tracks
from vibrosweep.lab.trials import perform_trials

HUGE = ("1e300", "1.7e308", "1e154", "1e30", "-1e300")
TINY = ("1e-300", "5e-324", "1e-154", "1e-30")
TIME = np.arange(960) / 240.0
OMEGA = 40.0 * np.pi


@pytest.fixture(scope="module")
def moving():
    """Tracks over a base that moves, at Gamma 0.4."""
    amplitude = 1.9 * 0.4 * LABORATORY["gravity"] / OMEGA
    scene = {**LABORATORY, "amplitude": amplitude, "phase": 0.7}
    plan = Experiment(**scene, base="moving", particles=3, repeats=1, transient=0.0, duration=4.0)
    return perform_trials(plan)[0].tracks


@pytest.fixture(scope="module")
def files(moving, tmp_path_factory):
    """The same tracks as a plain table and as one of trackpy."""
    folder = tmp_path_factory.mktemp("tracks")
    table = moving["height"].to_dataframe().reset_index()
    table[["time", "particle", "height"]].to_csv(folder / "plain.csv", index=False)
    table["y"] = -table["height"] / 1e-4
    table[["frame", "particle", "y"]].to_csv(folder / "pixels.csv", index=False)
    return folder


@pytest.mark.parametrize("option", ["frame-rate", "scale", "base", "gravity", "frequency"])
@pytest.mark.parametrize("name", ["plain.csv", "pixels.csv"])
@pytest.mark.parametrize("value", [*HUGE, *TINY])
def test_every_number_of_a_recording(option, name, value, files, capsys):
    given = {"frame-rate": "240", "scale": "1e-4"} if name == "pixels.csv" else {}
    given[option] = value
    options = [f"--{key}={number}" for key, number in given.items()]
    code = main(["lab", "impacts", str(files / name), *options])
    output = capsys.readouterr()
    assert code in (0, 2)
    assert output.err.count("\n") == (1 if code else 0)


@pytest.mark.parametrize("time", [TIME * 1e300, TIME * 1e-300, TIME * 1e7, TIME * 1e-12])
def test_times_that_no_camera_has(time):
    height = np.abs(np.sin(20.0 * TIME))
    with pytest.raises(TrackError, match="must be"):
        make_tracks(time, height[:, np.newaxis])
    with pytest.raises(TrackError, match="must be"):
        make_trace(time, height, "height")


@pytest.mark.parametrize("quantity", ["height", "acceleration"])
@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.full(TIME.size, 0.25), "does not change"),
        (np.zeros(TIME.size), "does not change"),
        (1e-300 * np.sin(OMEGA * TIME), "does not change"),
        (1e300 * np.sin(OMEGA * TIME), "must be at most"),
        (1e-3 * TIME, "no whole period"),
        (1e-3 * TIME**2, "no whole period"),
    ],
)
def test_a_trace_of_a_table_that_is_switched_off_or_drifts(quantity, values, message):
    with pytest.raises(TrackError, match=message):
        make_trace(TIME, values, quantity)


def test_the_command_refuses_a_trace_that_does_not_change(files, tmp_path, capsys):
    path = tmp_path / "base.csv"
    pd.DataFrame({"time": TIME, "height": 0.25}).to_csv(path, index=False)
    assert main(["lab", "impacts", str(files / "plain.csv"), "--base-trace", str(path)]) == 2
    assert "the height does not change: leave the trace out" in capsys.readouterr().err


@pytest.mark.parametrize("motion", ["detect", "level", "moving"])
@pytest.mark.parametrize(
    "known",
    [
        {"amplitude": 0.0},
        {"amplitude": 1e-300},
        {"amplitude": 1e30},
        {"frequency": 1e-30},
        {"frequency": 1e9},
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
