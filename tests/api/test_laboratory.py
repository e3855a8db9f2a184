"""The laboratory by its public names: parameters from files of tracks and of the base."""

import math

import numpy as np
import pandas as pd

import vibrosweep as vs
from vibrosweep.lab.experiment import LABORATORY, Experiment
from vibrosweep.lab.trials import perform_trials

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
