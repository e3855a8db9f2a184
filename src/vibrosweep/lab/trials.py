"""Recordings of virtual experiments, their files, and the means predicted for them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import xarray as xr

from vibrosweep.arrays import Array
from vibrosweep.engine.coupled import base_track
from vibrosweep.engine.landings import all_parameters, launch_times, record_landings
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.kernels._jit import Floats, jit, kernel
from vibrosweep.kernels.bases import constants, fly, lift_off, rebound, speed
from vibrosweep.kernels.impact import Batch, base_of, land, launch, launch_speed
from vibrosweep.kernels.record import (
    Record,
    Scale,
    empty_record,
    no_landings,
    write_landing,
    write_lift_off,
)
from vibrosweep.lab.experiment import (
    LEVEL,
    Experiment,
    Motion,
    Surface,
    film,
    heights,
    oscillating_surface,
    recoiling_surface,
)
from vibrosweep.lab.paths import Ball, path_of
from vibrosweep.lab.paths import Path as BallPath
from vibrosweep.lab.tracks import make_tracks
from vibrosweep.lab.variables import require_instance
from vibrosweep.model.parameters import (
    HIGH_BOUNCE,
    OF_RESTITUTION,
    PARAMETERS,
    SPRUNG,
    amount,
    dimensionless,
    launches,
)
from vibrosweep.model.restitution_laws import (
    LEAST_VISCOELASTIC,
    SPEED,
    VISCOELASTIC,
    restitution_at,
)
from vibrosweep.scene.scene import Scene
from vibrosweep.store.disk import check_output, make_directory, replacing

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Trial", "perform_trials", "predicted_means", "write_experiments"]

# -----------------------------------------------------------------------------
# Particles under a forcing with a fluctuating period.
#
# The lengths of the forcing periods vary independently, so that the phase of the forcing performs
# a random walk, the same for all particles of a repeat.  Within a period the phase grows
# uniformly.  This is not supported for a moving base, whose flights are computed for a steady
# oscillation.  Impacts are those of `vibrosweep.kernels.impact`; without imperfections the record
# is bitwise identical to that of the engine.

# Steps per period in the search for landings on integrated paths
STEPS_PER_PERIOD: Final = 200
# Number of fixed-point iterations; each multiplies the error by the relative change of a period,
# far below 1
INVERSIONS: Final = 30
# Largest number of landings of a particle in a recording: ten hours at 20 Hz
MOST_LANDINGS: Final = 2**20


def phase_walk(rng: np.random.Generator, jitter: float, periods: int) -> Floats:
    """Draw the deviations of the phase, in turns, at the beginning of each period.

    The first period begins at -1 mean periods; the shape is (period + 1,).  `jitter` is the
    standard deviation of the length of a period, relative to its mean.
    """
    return np.concatenate([[0.0], np.cumsum(jitter * rng.standard_normal(periods))])


@jit
def _deviation(n: float, x: float, walk: Floats) -> float:
    """Deviation of the phase, in turns, at the time n + x mean periods."""
    floor = np.floor(x)
    j = min(max(int(n + floor) + 1, 0), walk.size - 2)
    return float(walk[j] + (x - floor) * (walk[j + 1] - walk[j]))


@jit
def _phase(n: float, x: float, walk: Floats) -> tuple[float, float]:
    """Whole turns and reduced phase of the forcing at the time n + x mean periods."""
    turned = x + _deviation(n, x, walk)
    carry = np.rint(turned)
    return n + carry, turned - carry


@jit
def _instant(n: float, x: float, walk: Floats) -> tuple[float, float]:
    """Time at which the forcing has the phase n + x, as whole and remaining mean periods."""
    count, rest = n, x
    for _ in range(INVERSIONS):
        back = x - _deviation(count, rest, walk)
        carry = np.rint(back)
        count, rest = n + carry, back - carry
    return count, rest


@kernel
def _fill(batch: Batch, walk: Floats, frequency: float, unit: float, out: Record) -> bool:
    """Write the landings of each particle p of realization p; return whether all fit."""
    base, problem, launches = batch
    no_landings(out, 0, launches.whole.shape[1])
    for p in range(launches.whole.shape[1]):
        fixed = constants(base, problem, p)
        n, x = launch(launches, p, p, problem.phase[p])
        u = launch_speed(fixed, problem, p, x)
        scale = Scale(frequency, unit, 0.0, problem.phase[p])
        ended = False
        for k in range(out.rested.shape[1]):
            flight, v = fly(fixed, x, u)
            x, passed = land(x, flight)
            n += passed
            if not n - problem.end_count[p] <= problem.end_phase[p] - x:
                ended = True
                break
            turns, phase = _phase(n, x, walk)
            turns, phase, u, leaves = lift_off(fixed, turns, phase, rebound(fixed, phase, v))
            write_landing(out, p, k, scale, n, x, not leaves)
            if turns == np.inf:
                ended = True
                break
            if not leaves:
                n, x = _instant(turns, phase, walk)
            write_lift_off(out, p, k, scale, n, x, speed(fixed, x, u))
        if not ended:
            return False
    return True


def wandering_record(batch: Batch, walk: Floats, frequency: float, gravity: float) -> Record:
    """Record all landings of particles with individual parameters under phase noise.

    Arrays of the batch's problem have the shape (particle,), its launches (1, particle), arrays of
    the record (particle, impact).  Beyond the ends of the `walk`, a result of `phase_walk`, the
    phase continues as in its first or last period.  Raises a
    ParameterError if a particle lands more than `MOST_LANDINGS` times.
    """
    capacity = 1024
    while capacity <= MOST_LANDINGS:
        out = empty_record(batch.launches.whole.shape[1], capacity)
        if _fill(batch, walk, frequency, gravity / (2.0 * frequency), out):
            used = int(np.isfinite(out.landing_time).sum(axis=1).max(initial=1))
            return Record._make(np.ascontiguousarray(values[:, :used]) for values in out)
        capacity *= 2
    raise ParameterError(
        f"at {frequency:g} Hz a particle lands more than {MOST_LANDINGS} times in the time that is "
        f"filmed: check frequency, restitution, amplitude and contact_time"
    )


# -----------------------------------------------------------------------------
# Recordings of virtual experiments, their files, and the means predicted for them.
#
# Their true landings are known, and serve to test the rest of the laboratory.


class Trial(NamedTuple):
    """One recording.

    Attributes
    ----------
    tracks
        Measured tracks.
    record
        The true landings, arrays of shape (particle, impact).
    restitution, level
        Restitution of each particle, and height in m of the base below it.
    frequency, amplitude
        Values for this repeat, Hz and m s-1.
    """

    tracks: xr.Dataset
    record: Record
    restitution: Array
    level: Array
    frequency: float
    amplitude: float


def perform_trials(experiment: Experiment) -> list[Trial]:
    """Film all repeats of an experiment; the result is bitwise reproducible.

    Parameters
    ----------
    experiment
        The scene, its imperfections, and the camera.

    Returns
    -------
    list of Trial
        Tracks of each repeat, with the true landings and parameters.

    Examples
    --------
    >>> from vibrosweep.lab import Experiment, perform_trials
    >>> film = perform_trials(Experiment(particles=2, repeats=1, transient=5.0, duration=10.0))
    >>> film[0].tracks.height.dims
    ('frame', 'particle')
    """
    require_instance("experiment", experiment, Experiment)
    same, *repeats = np.random.SeedSequence(experiment.seed).spawn(experiment.repeats + 1)
    variation, rng = experiment.variation, np.random.default_rng(same)
    drawn = rng.standard_normal((2, experiment.scene.particles))
    restitution = experiment.parameters["restitution"] + variation.restitution_spread * drawn[0]
    least = LEAST_VISCOELASTIC if experiment.scene.restitution_law == VISCOELASTIC else 0.0
    restitution, level = np.clip(restitution, least, 1.0), variation.level_spread * drawn[1]
    return [_trial(experiment, restitution, level, seed, k) for k, seed in enumerate(repeats)]


def predicted_means(experiment: Experiment) -> dict[str, Array]:
    """Predict the mean height and period of the flights of each particle within a recording.

    The prediction neglects all imperfections.

    Parameters
    ----------
    experiment
        The scene, and the window that is recorded.

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
    require_instance("experiment", experiment, Experiment)
    scene, numbers = experiment.recorded, experiment.parameters
    every = np.full(scene.particles, numbers["restitution"])
    landed = _landings(scene, numbers, every, np.zeros(2))
    means = [motion.means(*experiment.window) for motion in _motions(scene, numbers, *landed)]
    return dict(zip(("height", "period"), np.array(means).T, strict=True))


def _landings(
    scene: Scene, numbers: Mapping[str, float], restitution: Array, walk: Array
) -> tuple[Record, Surface]:
    """Compute the landings of particles with given restitutions, and the surface of the base.

    `numbers` are the parameters of the scene in this recording.
    """
    frequency = numbers["frequency"]
    if scene.base == SPRUNG:
        alone = all_parameters({name: np.array([value]) for name, value in numbers.items()})
        with Workers(1) as workers:
            found = record_landings(alone, scene, workers)
            track = base_track(alone, scene, workers)
        record = Record._make(found[name][0] for name in Record._fields)
        return record, recoiling_surface(track, frequency, amount(scene.duration))
    names = (*PARAMETERS, *(name for name in OF_RESTITUTION if name in numbers))
    values = {name: np.full(restitution.size, numbers[name]) for name in names}
    values["restitution"] = restitution
    if scene.base != HIGH_BOUNCE:  # all particles share one base with the velocity A / (1 + e)
        values["amplitude"] *= (1.0 + restitution) / (1.0 + numbers["restitution"])
    parameters = all_parameters(values)
    begin = launches(scene.launch, scene.particles, parameters["frequency"][:1])
    problem = dimensionless(parameters, scene.duration)
    batch = Batch(base_of(*scene.mechanics), problem, begin)
    record = wandering_record(batch, walk, frequency, numbers["gravity"])
    return record, LEVEL if scene.base == HIGH_BOUNCE else oscillating_surface(
        numbers, scene.waveform
    )


def _motions(
    scene: Scene, numbers: Mapping[str, float], record: Record, surface: Surface
) -> list[Motion]:
    start = launch_times(scene.launch, scene.particles, numbers["frequency"])
    velocity, gravity = numbers["launch_velocity"], numbers["gravity"]
    return [
        Motion.from_record(record, p, time, velocity, gravity, surface)
        for p, time in enumerate(start)
    ]


def _paths(
    experiment: Experiment,
    numbers: Mapping[str, float],
    restitution: Array,
    rng: np.random.Generator,
) -> tuple[list[BallPath], Record]:
    """Integrate the paths of all particles, with contacts that last, scatter and drag."""
    scene, variation = experiment.recorded, experiment.variation
    surface = oscillating_surface(numbers, scene.waveform)
    law, reference = scene.restitution_law, numbers.get(SPEED, 1.0)

    def bounces(e: float) -> Callable[[float], float]:
        def draw(speed: float) -> float:
            nominal = float(restitution_at(np.asarray(speed), e, law, reference))
            return float(np.clip(nominal + variation.scatter * rng.standard_normal(), 1e-3, 1.0))

        return draw

    found = [
        path_of(
            Ball(
                bounces(float(e)),
                numbers["gravity"],
                variation.terminal_speed**-2,
                variation.contact,
                variation.contact_time,
                numbers["contact_time"],
            ),
            surface,
            float(start),
            numbers["launch_velocity"],
            experiment.window[1],
            1.0 / (STEPS_PER_PERIOD * numbers["frequency"]),
        )
        for e, start in zip(
            restitution,
            launch_times(scene.launch, scene.particles, numbers["frequency"]),
            strict=True,
        )
    ]
    paths, records = zip(*found, strict=True)
    most = max(record.rested.shape[1] for record in records)
    record = empty_record(len(records), most)
    no_landings(record, 0, len(records))
    for p, own in enumerate(records):
        for name, values in own._asdict().items():
            getattr(record, name)[p, : values.size] = values[0]
    return list(paths), record


def _trial(
    experiment: Experiment, restitution: Array, level: Array, seed: np.random.SeedSequence, k: int
) -> Trial:
    setting, walking, filming, scattering = (np.random.default_rng(s) for s in seed.spawn(4))
    scene, variation, camera = experiment.recorded, experiment.variation, experiment.camera
    off = setting.standard_normal(2)
    numbers = experiment.parameters
    numbers["frequency"] *= 1.0 + variation.frequency_setting * off[0]
    numbers["amplitude"] *= 1.0 + variation.amplitude_setting * off[1]
    begin, end = experiment.window
    periods = math.ceil(end * numbers["frequency"]) + 3
    walk = phase_walk(walking, variation.frequency_jitter, periods)
    motions: Sequence[Motion | BallPath]
    if variation.integrated:
        motions, record = _paths(experiment, numbers, restitution, scattering)
    else:
        record, surface = _landings(scene, numbers, restitution, walk)
        motions = _motions(scene, numbers, record, surface)
    time = begin + np.arange(round((end - begin) * camera.frame_rate)) / camera.frame_rate
    filmed = film(heights(motions, time, camera.exposure) + level, camera, filming)
    visible = np.isfinite(filmed).any(axis=1)
    if camera.rounding:
        time = np.round(time / camera.rounding) * camera.rounding
        visible &= np.append(True, np.diff(time) > 0.0)
    tracks = make_tracks(time[visible], filmed[visible], source=f"trial {k + 1}")
    return Trial(tracks, record, restitution, level, numbers["frequency"], numbers["amplitude"])


def write_experiments(
    experiments: Iterable[Experiment], directory: Path, name: str, *, force: bool
) -> list[Path]:
    """Perform virtual experiments and write tracks and true landings of each repeat as CSV.

    The directory is created if it does not exist.  File names consist of `name`, the number of
    particles and the number of the trial.  Returns for each trial the file of the tracks (time,
    particle, height) and that of the true landings.  Raises an OutputError if a file exists and
    `force` is false, or if it cannot be written.
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
        table = trial.tracks["height"].transpose("particle", "frame").to_dataframe().reset_index()
        _write_table(table[["time", "particle", "height"]], tracks)
        _write_table(_truth_table(trial.record._asdict()), truth)
    return paths


def _write_table(table: pd.DataFrame, path: Path) -> None:
    with replacing(path) as disk:
        disk.write(table.to_csv(index=False, float_format="%.10g").encode())


def _truth_table(record: dict[str, Array]) -> pd.DataFrame:
    import pandas as pd

    landed = np.isfinite(record["landing_time"])
    particle, impact = np.nonzero(landed)
    columns = {name: values[landed] for name, values in record.items()}
    return pd.DataFrame({"particle": particle, "impact": impact, **columns})
