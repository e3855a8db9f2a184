"""Coefficient of restitution and motion of the base from films and impact times of bouncing balls.

An `Experiment` describes a virtual experiment, whose landings are known; `perform_trials` films it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from vibrosweep.waiting import lazily

if TYPE_CHECKING:
    from vibrosweep.lab.compare import QUANTITIES as QUANTITIES
    from vibrosweep.lab.compare import READINGS as READINGS
    from vibrosweep.lab.compare import comparable as comparable
    from vibrosweep.lab.compare import compare_tracks as compare_tracks
    from vibrosweep.lab.compare import prediction_errors as prediction_errors
    from vibrosweep.lab.drops import restitution as restitution
    from vibrosweep.lab.estimation import estimate as estimate
    from vibrosweep.lab.experiment import Camera as Camera
    from vibrosweep.lab.experiment import Experiment as Experiment
    from vibrosweep.lab.experiment import Variation as Variation
    from vibrosweep.lab.impacts import agreement as agreement
    from vibrosweep.lab.impacts import find_impacts as find_impacts
    from vibrosweep.lab.impacts import quantities as quantities
    from vibrosweep.lab.recordings import Recording as Recording
    from vibrosweep.lab.recordings import read_recordings as read_recordings
    from vibrosweep.lab.recordings import read_tracks as read_tracks
    from vibrosweep.lab.recordings import tracks_from_frame as tracks_from_frame
    from vibrosweep.lab.shaken_times import times_on_shaker as times_on_shaker
    from vibrosweep.lab.traces import base_motion as base_motion
    from vibrosweep.lab.traces import read_trace as read_trace
    from vibrosweep.lab.tracks import make_tracks as make_tracks
    from vibrosweep.lab.trials import perform_trials as perform_trials
    from vibrosweep.lab.trials import predicted_means as predicted_means
    from vibrosweep.lab.virtual_drops import FloorExperiment as FloorExperiment
    from vibrosweep.lab.virtual_drops import film_drops as film_drops
    from vibrosweep.lab.virtual_drops import hear_drops as hear_drops

# Modules that define the public names
_HOMES: Final = {
    name: f"vibrosweep.lab.{home}"
    for home, names in {
        "compare": "QUANTITIES READINGS comparable compare_tracks prediction_errors",
        "drops": "restitution",
        "estimation": "estimate",
        "experiment": "Camera Experiment Variation",
        "impacts": "agreement find_impacts quantities",
        "recordings": "Recording read_recordings read_tracks tracks_from_frame",
        "shaken_times": "times_on_shaker",
        "traces": "base_motion read_trace",
        "tracks": "make_tracks",
        "trials": "perform_trials predicted_means",
        "virtual_drops": "FloorExperiment film_drops hear_drops",
    }.items()
    for name in names.split()
}
__all__ = [*_HOMES]
__getattr__ = lazily(__name__, _HOMES)


def __dir__() -> list[str]:
    return sorted(__all__)
