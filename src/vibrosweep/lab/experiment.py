"""Virtual experiments: particles, a base and a camera, all with imperfections.

Their landings are known, so that everything else in the laboratory can be tested on them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np
import xarray as xr

from vibrosweep.abilities import ANALYSES, refusal
from vibrosweep.arrays import Array
from vibrosweep.engine.coupled import base_track
from vibrosweep.engine.landings import all_parameters, launch_times, record_landings
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.impact import Batch, base_of
from vibrosweep.kernels.record import Record
from vibrosweep.lab.camera import Camera, Launch, Motion, film, heights
from vibrosweep.lab.surfaces import LEVEL, Surface, oscillating, recoiling
from vibrosweep.lab.tracks import make_tracks
from vibrosweep.lab.wander import phase_walk, wandering_record
from vibrosweep.model.mount import require_mount
from vibrosweep.model.parameters import (
    HIGH_BOUNCE,
    MOUNT,
    PARAMETERS,
    SPRUNG,
    dimensionless,
    launches,
)
from vibrosweep.model.scene_measures import Measures
from vibrosweep.scene.scene import bare_scene

__all__ = [
    "LABORATORY",
    "Experiment",
    "Trial",
    "Variation",
    "perform_trials",
    "predicted_means",
]


# Table 1 at 20 Hz, with the same dimensionless kick, 2 f A / g = 0.2446, and first flight.
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
        The same for the amplitude.
    restitution_spread
        Standard deviation of the restitution among the particles; they stay the same in all
        repeats.
    restitution_exponent
        Exponent p of the decrease of the restitution with the speed v of impact, as
        (2 f v / g)^-p; 1/4 for spheres that yield (Johnson 1985, Contact Mechanics, section 11.5).
    level_spread
        Standard deviation in m, among the particles, of the height of the base below them, as of
        a tilted base or view.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> vs.lab.Experiment(variation=vs.lab.Variation(frequency_jitter=0.01)).particles
    5
    """

    frequency_jitter: float = 0.0
    frequency_setting: float = 0.0
    amplitude_setting: float = 0.0
    restitution_spread: float = 0.0
    restitution_exponent: float = 0.0
    level_spread: float = 0.0


@dataclass(frozen=True)
class Experiment:
    """A case that is recorded several times.

    Attributes
    ----------
    scene
        Every parameter of `vibrosweep.PARAMETERS`, and ``mass_ratio``, ``mount_frequency`` and
        ``mount_damping`` where the base is sprung.
    particles
        Number of particles.
    launch
        ``"staggered"`` or the launch times in s.
    repeats
        Number of recordings.
    transient, duration
        Time in s at which the recording begins, and its length in s.
    camera, variation
        Their imperfections.
    seed
        Seed of the random numbers.
    rebound
        ``"rest"`` or ``"reflect"``.
    base
        ``"high-bounce"``, ``"moving"`` or ``"sprung"``.

    Raises
    ------
    ParameterError
        An imperfection cannot be computed over this base.

    Examples
    --------
    >>> from vibrosweep.lab import Experiment
    >>> Experiment(particles=2, transient=5.0, duration=5.0).launch
    'staggered'
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
    base: str = HIGH_BOUNCE

    def __post_init__(self) -> None:
        wrong = refusal(self.base, law=self.rebound)
        if wrong:
            raise ParameterError(wrong)
        require_mount(self.base, [name for name in MOUNT if name in self.scene])
        for name in ANALYSES.keys() & vars(self.variation).keys():
            wrong = refusal(self.base, analysis=name)
            if wrong and getattr(self.variation, name):
                raise ParameterError(f"variation.{name}: {wrong}")


class Trial(NamedTuple):
    """One recording.

    Attributes
    ----------
    tracks
        Tracks as the camera and its tracking measure them.
    record
        The true landings, arrays of shape (particle, impact).
    restitution, level
        Restitution of each particle, and height in m of the base below it.
    frequency, amplitude
        Values in this repeat, Hz and m s-1.
    """

    tracks: xr.Dataset
    record: Record
    restitution: Array
    level: Array
    frequency: float
    amplitude: float


class _Beads(NamedTuple):
    """Restitution of each particle, and height in m of the base below it."""

    restitution: Array
    level: Array


def perform_trials(experiment: Experiment) -> list[Trial]:
    """Film every repeat of an experiment; the same experiment gives the same bits.

    Parameters
    ----------
    experiment
        The scene, its imperfections, and the camera that films it.

    Returns
    -------
    list of Trial
        Tracks of each repeat, with the true landings and parameters.

    Examples
    --------
    >>> from vibrosweep.lab import Experiment, perform_trials
    >>> film = perform_trials(Experiment(particles=2, repeats=1, transient=5.0, duration=5.0))
    >>> film[0].tracks.height.dims
    ('frame', 'particle')
    """
    same, *repeats = np.random.SeedSequence(experiment.seed).spawn(experiment.repeats + 1)
    variation, rng = experiment.variation, np.random.default_rng(same)
    drawn = rng.standard_normal((2, experiment.particles))
    restitution = experiment.scene["restitution"] + variation.restitution_spread * drawn[0]
    beads = _Beads(np.clip(restitution, 0.0, 1.0), variation.level_spread * drawn[1])
    return [_trial(experiment, beads, seed, f"trial {k + 1}") for k, seed in enumerate(repeats)]


def predicted_means(experiment: Experiment) -> dict[str, Array]:
    """Mean height and period of the flights of each particle that lie within a recording.

    They are predicted without any imperfection; a base that recoils is not supported.

    Parameters
    ----------
    experiment
        The scene, and when it is recorded.

    Returns
    -------
    dict
        ``height`` (m) and ``period`` (s), each of shape (particle,).

    Examples
    --------
    >>> import vibrosweep as vs
    >>> predicted = vs.lab.predicted_means(vs.lab.Experiment(particles=2))
    >>> predicted["period"].shape
    (2,)
    """
    every = np.full(experiment.particles, experiment.scene["restitution"])
    record = _landings(replace(experiment, variation=Variation()), every, np.zeros(2))[0]
    begin, end = experiment.transient, experiment.transient + experiment.duration
    surface = LEVEL if experiment.base == HIGH_BOUNCE else oscillating(experiment.scene)
    means = [motion.means(begin, end) for motion in _motions(experiment, record, surface)]
    return dict(zip(("height", "period"), np.array(means).T, strict=True))


def _landings(experiment: Experiment, restitution: Array, walk: Array) -> tuple[Record, Surface]:
    """Landings of particles of given restitutions, and the base that they land on."""
    scene, base = experiment.scene, experiment.base
    end = experiment.transient + experiment.duration
    launch = experiment.launch
    if base == SPRUNG:
        alone = all_parameters({name: np.array([value]) for name, value in scene.items()})
        coupled = bare_scene(
            experiment.particles, launch, end, experiment.rebound, Measures.impact_budget, base
        )
        with Workers(1) as workers:
            found = record_landings(alone, coupled, workers)
            track = base_track(alone, coupled, workers)
        record = Record._make(found[name][0] for name in Record._fields)
        return record, recoiling(track, scene["frequency"], end)
    given = {name: np.full(restitution.size, scene[name]) for name in PARAMETERS}
    given["restitution"] = restitution
    if base != HIGH_BOUNCE:  # all share one base, whose velocity A / (1 + e) is that of the scene
        given["amplitude"] *= (1.0 + restitution) / (1.0 + scene["restitution"])
    parameters = all_parameters(given)
    begin = launches(launch, experiment.particles, parameters["frequency"][:1])
    batch = Batch(base_of(base, experiment.rebound), dimensionless(parameters, end), begin)
    softening = experiment.variation.restitution_exponent
    record = wandering_record(batch, walk, scene["frequency"], scene["gravity"], softening)
    return record, LEVEL if base == HIGH_BOUNCE else oscillating(scene)


def _motions(experiment: Experiment, record: Record, surface: Surface) -> list[Motion]:
    scene = experiment.scene
    start = launch_times(experiment.launch, experiment.particles, scene["frequency"])
    return [
        Motion.of(record, p, Launch(time, scene["launch_velocity"]), scene["gravity"], surface)
        for p, time in enumerate(start)
    ]


def _trial(experiment: Experiment, beads: _Beads, seed: np.random.SeedSequence, name: str) -> Trial:
    setting, walking, filming = (np.random.default_rng(s) for s in seed.spawn(3))
    variation, camera = experiment.variation, experiment.camera
    off = setting.standard_normal(2)
    scene = dict(experiment.scene)
    scene["frequency"] *= 1.0 + variation.frequency_setting * off[0]
    scene["amplitude"] *= 1.0 + variation.amplitude_setting * off[1]
    experiment = replace(experiment, scene=scene)
    end = experiment.transient + experiment.duration
    periods = math.ceil(end * scene["frequency"]) + 3
    walk = phase_walk(walking, variation.frequency_jitter, periods)
    record, surface = _landings(experiment, beads.restitution, walk)
    frames = np.arange(round(experiment.duration * camera.frame_rate))
    time = experiment.transient + frames / camera.frame_rate
    motions = _motions(experiment, record, surface)
    filmed = film(heights(motions, time, camera.exposure) + beads.level, camera, filming)
    kept = np.isfinite(filmed).any(axis=1)
    tracks = make_tracks(time[kept], filmed[kept], source=name)
    return Trial(
        tracks, record, beads.restitution, beads.level, scene["frequency"], scene["amplitude"]
    )
