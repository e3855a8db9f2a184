"""Coefficient of restitution and motion of the base from films and impact times of bouncing balls.

An `Experiment` describes a virtual experiment, whose landings are known; `perform_trials` films it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from vibrosweep.waiting import lazily

if TYPE_CHECKING:
    from vibrosweep.lab.compare import (
        QUANTITIES,
        READINGS,
        comparable,
        compare_tracks,
        prediction_errors,
    )
    from vibrosweep.lab.drops import restitution
    from vibrosweep.lab.estimation import estimate
    from vibrosweep.lab.experiment import Camera, Experiment, Variation
    from vibrosweep.lab.impacts import agreement, find_impacts, quantities
    from vibrosweep.lab.recordings import Recording, read_recordings, read_tracks, tracks_from_frame
    from vibrosweep.lab.shaken_times import times_on_shaker
    from vibrosweep.lab.traces import read_trace
    from vibrosweep.lab.tracks import make_tracks
    from vibrosweep.lab.trials import perform_trials, predicted_means
    from vibrosweep.lab.virtual_drops import FloorExperiment, film_drops, hear_drops

__all__ = [
    "QUANTITIES",
    "READINGS",
    "Camera",
    "Experiment",
    "FloorExperiment",
    "Recording",
    "Variation",
    "agreement",
    "comparable",
    "compare_tracks",
    "estimate",
    "film_drops",
    "find_impacts",
    "hear_drops",
    "make_tracks",
    "perform_trials",
    "predicted_means",
    "prediction_errors",
    "quantities",
    "read_recordings",
    "read_trace",
    "read_tracks",
    "restitution",
    "times_on_shaker",
    "tracks_from_frame",
]

_HOMES: Final = {
    "Camera": "vibrosweep.lab.experiment",
    "compare_tracks": "vibrosweep.lab.compare",
    **dict.fromkeys(
        ("QUANTITIES", "READINGS", "comparable", "prediction_errors"),
        "vibrosweep.lab.compare",
    ),
    "estimate": "vibrosweep.lab.estimation",
    **dict.fromkeys(("Experiment", "Variation"), "vibrosweep.lab.experiment"),
    **dict.fromkeys(("perform_trials", "predicted_means"), "vibrosweep.lab.trials"),
    "restitution": "vibrosweep.lab.drops",
    **dict.fromkeys(
        ("FloorExperiment", "film_drops", "hear_drops"), "vibrosweep.lab.virtual_drops"
    ),
    "times_on_shaker": "vibrosweep.lab.shaken_times",
    "find_impacts": "vibrosweep.lab.impacts",
    **dict.fromkeys(("agreement", "quantities"), "vibrosweep.lab.impacts"),
    "Recording": "vibrosweep.lab.recordings",
    "read_recordings": "vibrosweep.lab.recordings",
    "read_trace": "vibrosweep.lab.traces",
    **dict.fromkeys(("read_tracks", "tracks_from_frame"), "vibrosweep.lab.recordings"),
    "make_tracks": "vibrosweep.lab.tracks",
}
__getattr__ = lazily(__name__, _HOMES)


def __dir__() -> list[str]:
    return sorted(__all__)
