"""A virtual experiment: particles, a base and a camera, all with their imperfections.

It is the ground truth for everything else in the laboratory: its landings are known.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.engine.landings import all_parameters, launch_times
from vibrosweep.kernels.impact import Batch, base_of
from vibrosweep.kernels.record import Record
from vibrosweep.lab.camera import Camera, Motion, film, heights
from vibrosweep.lab.tracks import make_tracks
from vibrosweep.lab.wander import phase_walk, wandering_record
from vibrosweep.model.parameters import BASES, PARAMETERS, dimensionless, launches

__all__ = [
    "LABORATORY",
    "Experiment",
    "Trial",
    "Variation",
    "ideal_record",
    "perform_trials",
    "predicted_means",
]

Array = NDArray[np.float64]

# Table 1 at 20 Hz: the same dimensionless kick, 2 f A / g = 0.2446, and first flight.
LABORATORY: Final[Mapping[str, float]] = {
    "restitution": 0.9,
    "amplitude": 0.06,
    "frequency": 20.0,
    "phase": 0.0,
    "gravity": PARAMETERS["gravity"].default,
    "launch_velocity": 0.25,
    "contact_time": 2.5e-5,
}


@dataclass(frozen=True)
class Variation:
    """Imperfections of particles and base.

    Attributes
    ----------
    frequency_jitter
        Standard deviation of the length of each forcing period, relative to its mean.
    frequency_setting
        Standard deviation of the mean frequency from repeat to repeat, relative.
    amplitude_setting
        The same of the amplitude.
    restitution_spread
        Standard deviation of the restitution among the particles; they stay the same in all
        repeats.
    """

    frequency_jitter: float = 0.0
    frequency_setting: float = 0.0
    amplitude_setting: float = 0.0
    restitution_spread: float = 0.0


@dataclass(frozen=True)
class Experiment:
    """Repeats of one case.

    Attributes
    ----------
    scene
        Every parameter of `scene.PARAMETERS`.
    particles
        Number of particles.
    launch
        ``"staggered"`` or the launch times in s.
    repeats
        Number of recordings.
    transient, duration
        Time in s after which recording begins, and for which it lasts.
    camera, variation
        The imperfections.
    seed
        Of the random numbers.
    rebound
        ``"rest"`` or ``"reflect"``.
    """

    scene: Mapping[str, float] = field(default_factory=lambda: dict(LABORATORY))
    particles: int = 5
    launch: str | tuple[float, ...] = "staggered"
    repeats: int = 4
    transient: float = 20.0
    duration: float = 40.0
    camera: Camera = field(default_factory=Camera)
    variation: Variation = field(default_factory=Variation)
    seed: int = 0
    rebound: str = "rest"


class Trial(NamedTuple):
    """One recording.

    Attributes
    ----------
    tracks
        As a camera and its tracking give them.
    record
        The true landings, arrays of shape (particle, impact).
    restitution
        Of each particle.
    frequency, amplitude
        Hz and m s-1, as they were in this repeat.
    """

    tracks: xr.Dataset
    record: Record
    restitution: Array
    frequency: float
    amplitude: float


def perform_trials(experiment: Experiment) -> list[Trial]:
    """Record every repeat; the same experiment gives the same bits.

    Parameters
    ----------
    experiment
        The scene, its imperfections, and the camera that films it.

    Returns
    -------
    list of Trial
        For each repeat the tracks that the camera saw, and the landings and parameters behind them.
    """
    beads, *repeats = np.random.SeedSequence(experiment.seed).spawn(experiment.repeats + 1)
    variation = experiment.variation
    drawn = np.random.default_rng(beads).standard_normal(experiment.particles)
    restitution = experiment.scene["restitution"] + variation.restitution_spread * drawn
    return [
        _trial(experiment, np.clip(restitution, 0.0, 1.0), seed, f"trial {k + 1}")
        for k, seed in enumerate(repeats)
    ]


def ideal_record(experiment: Experiment) -> Record:
    """Landings as predicted: without any variation."""
    scene = experiment.scene
    return _landings(
        experiment,
        np.full(experiment.particles, scene["restitution"]),
        scene["frequency"],
        scene["amplitude"],
        np.zeros(2),
    )


def predicted_means(experiment: Experiment, record: Record) -> dict[str, Array]:
    """Mean height (m) and period (s) of each particle's flights that a recording holds whole."""
    begin, end = experiment.transient, experiment.transient + experiment.duration
    gravity = experiment.scene["gravity"]
    height, periods = np.full((2, experiment.particles), np.nan)
    for p in range(experiment.particles):
        motion = _motion(experiment, record, p, experiment.scene["frequency"])
        speed = motion.velocity[(motion.start >= begin) & (motion.end <= end)]
        if speed.size:
            height[p] = np.mean(speed**2) / (2.0 * gravity)
            periods[p] = 2.0 * np.mean(speed) / gravity
    return {"height": height, "period": periods}


def _landings(
    experiment: Experiment, restitution: Array, frequency: float, amplitude: float, walk: Array
) -> Record:
    end = experiment.transient + experiment.duration
    given = {name: np.full(restitution.size, value) for name, value in experiment.scene.items()}
    given |= {
        "restitution": restitution,
        "frequency": np.full(restitution.size, frequency),
        "amplitude": np.full(restitution.size, amplitude),
    }
    parameters = all_parameters(given)
    launch = launches(experiment.launch, experiment.particles, parameters["frequency"][:1])
    batch = Batch(base_of(BASES[0], experiment.rebound), dimensionless(parameters, end), launch)
    return wandering_record(batch, walk, frequency, experiment.scene["gravity"])


def _motion(experiment: Experiment, record: Record, particle: int, frequency: float) -> Motion:
    start = launch_times(experiment.launch, experiment.particles, frequency)[particle]
    scene = experiment.scene
    return Motion.of(record, particle, start, scene["launch_velocity"], scene["gravity"])


def _trial(
    experiment: Experiment, restitution: Array, seed: np.random.SeedSequence, name: str
) -> Trial:
    setting, walking, filming = (np.random.default_rng(s) for s in seed.spawn(3))
    scene, variation, camera = experiment.scene, experiment.variation, experiment.camera
    off = setting.standard_normal(2)
    frequency = scene["frequency"] * (1.0 + variation.frequency_setting * off[0])
    amplitude = scene["amplitude"] * (1.0 + variation.amplitude_setting * off[1])
    end = experiment.transient + experiment.duration
    periods = math.ceil(end * frequency) + 3
    walk = phase_walk(walking, variation.frequency_jitter, periods)
    record = _landings(experiment, restitution, frequency, amplitude, walk)
    frames = np.arange(round(experiment.duration * camera.frame_rate))
    time = experiment.transient + frames / camera.frame_rate
    motions = [_motion(experiment, record, p, frequency) for p in range(experiment.particles)]
    seen = film(heights(motions, time, camera.exposure), camera, filming)
    kept = np.isfinite(seen).any(axis=1)
    return Trial(
        make_tracks(time[kept], seen[kept], source=name), record, restitution, frequency, amplitude
    )
