"""Write tracks and true landings of virtual experiments; files appear when they are complete."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from vibrosweep.lab.experiment import Experiment
from vibrosweep.lab.trials import perform_trials
from vibrosweep.store.disk import check_output, make_directory, replacing

if TYPE_CHECKING:
    import pandas as pd


def write_experiments(
    experiments: Iterable[Experiment], directory: Path, name: str, *, force: bool
) -> list[Path]:
    """Perform virtual experiments and write tracks and true landings of each repeat as CSV.

    The directory is made if it does not exist.  File names consist of `name`, the number of
    particles and that of the trial. Returns for each trial the file of the tracks (time, particle,
    height) and that of the true landings.  Raises an OutputError if a file exists and `force` is
    false, or if it cannot be written.
    """
    make_directory(directory)
    experiments = list(experiments)
    paths = [
        directory / f"{name}_{experiment.scene.particles:03d}_trial{k + 1}{end}"
        for experiment in experiments
        for k in range(experiment.repeats)
        for end in (".csv", "_truth.csv")
    ]
    for path in paths:
        check_output(path, force=force)
    trials = chain.from_iterable(map(perform_trials, experiments))
    for trial, tracks, truth in zip(trials, paths[::2], paths[1::2], strict=True):
        _write_table(_track_table(trial.tracks), tracks)
        _write_table(_truth_table(trial.record._asdict()), truth)
    return paths


def _write_table(table: pd.DataFrame, path: Path) -> None:
    with replacing(path) as disk:
        disk.write(table.to_csv(index=False, float_format="%.10g").encode())


def _track_table(tracks: xr.Dataset) -> pd.DataFrame:
    by_particle = tracks["height"].transpose("particle", "frame").to_dataframe().reset_index()
    return by_particle[["time", "particle", "height"]]


def _truth_table(record: dict[str, np.ndarray]) -> pd.DataFrame:
    import pandas as pd

    landed = np.isfinite(record["landing_time"])
    particle, impact = np.nonzero(landed)
    columns = {name: values[landed] for name, values in record.items()}
    return pd.DataFrame({"particle": particle, "impact": impact, **columns})
