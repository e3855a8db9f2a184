"""Measure realizations whose particles a base of finite mass couples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.engine.measure import (
    Measured,
    height_unit,
    kinds_of,
    observable_values,
    order_in_units,
    separations_in_units,
    statistics_in_units,
    units_of,
)
from vibrosweep.engine.workers import Workers
from vibrosweep.kernels.coupled.joint_orbits import BLOCKS, empty_joint, notes, settle_jointly
from vibrosweep.kernels.coupled.realizations import (
    Coupled,
    CoupledStatistics,
    EventStates,
    MotionRecord,
    PerRealization,
    advance_coupled,
    advance_coupled_uncached,
    empty_coupled,
    empty_per_realization,
    empty_track,
    more_numbers,
    trace,
    work_for,
)
from vibrosweep.kernels.noise import noise_of
from vibrosweep.kernels.record import Scale, empty_record
from vibrosweep.kernels.restitution import restitution_of
from vibrosweep.kernels.statistics import KINDS_COUPLED, Observer
from vibrosweep.kernels.waveforms import shape_of
from vibrosweep.model.measures import LANDINGS_OF_AN_EXPONENT, Regime
from vibrosweep.model.parameters import dimensionless, launches, mounts
from vibrosweep.model.shapes import PARABOLIC_NAME
from vibrosweep.scene.scene import Scene

__all__ = ["BaseTrack", "base_track"]

LANDINGS_PER_TASK = 20_000  # so that threads share the work evenly


def measure_coupled(parameters: Mapping[str, Array], scene: Scene, workers: Workers) -> Measured:
    """Follow a batch of realizations on bases of finite mass and measure them.

    Parameters, which include those of the mount, and result are those of
    `vibrosweep.engine.measure.measure`.
    """
    statistics, listed, _ = followed(parameters, scene, workers, 0)
    sums, each, frequency = statistics.realizations, statistics.particles, parameters["frequency"]
    heights = statistics.launch_height.reshape(-1, scene.particles)
    heights = heights * height_unit(parameters)[:, np.newaxis]
    found = statistics_in_units(scene, parameters, sums, each, heights)
    found |= observable_values(
        parameters,
        scene,
        each,
        lambda observer: followed(parameters, scene, workers, 0, observer)[0].particles,
    )
    found |= separations_in_units(listed.separations, frequency)
    found |= order_in_units(listed.order, frequency) | {"undecided_count": listed.undecided}
    if scene.measures.joint:
        found |= _joint(parameters, scene, workers)
    return found


def followed(
    parameters: Mapping[str, Array],
    scene: Scene,
    workers: Workers,
    capacity: int,
    observer: Observer | None = None,
) -> tuple[CoupledStatistics, PerRealization, MotionRecord]:
    """Follow a batch; return its statistics, separations with the order, and record.

    The record holds at most `capacity` landings of each particle, with the motion of the base.
    """
    particles, size = scene.particles, parameters["frequency"].size
    batch = _batch(parameters, scene)
    kinds = (*KINDS_COUPLED, *kinds_of(scene))
    statistics = empty_coupled(size, particles, kinds, observer)
    listed = empty_per_realization(size)
    kernel = advance_coupled if observer is None else advance_coupled_uncached
    idle = [work_for(particles) for _ in range(min(size, workers.threads))]
    # each particle is launched once, and each landing is followed by at most one lift-off
    events = particles * (1 + 2 * capacity) + _corners(batch, scene) if capacity > 0 else 0
    track = empty_track(size, events)
    record = MotionRecord(empty_record(size * particles, capacity), track, units_of(parameters))

    def task(first: int, last: int) -> None:
        work, budget = idle.pop(), scene.budget
        while True:
            first = kernel(first, last, batch, budget, work, statistics, listed, record)
            if first == last:
                break
            work = more_numbers(work)
        idle.append(work)

    workers.run(task, size, _per_task(batch, particles), statistics, listed, record.record)
    return statistics, listed, record


def _corners(batch: Coupled, scene: Scene) -> int:
    """Return how many corners of the drive's velocity a realization passes at most."""
    if scene.waveform.name != PARABOLIC_NAME:
        return 0
    return 2 * int(np.max(batch.problem.end_count) - np.min(batch.launches.whole)) + 4


def _per_task(batch: Coupled, particles: int) -> int:
    """Return the number of realizations that a thread takes at a time."""
    periods = float(np.max(batch.problem.end_count)) - float(np.min(batch.launches.whole)) + 1.0
    return max(1, int(LANDINGS_PER_TASK / (particles * max(periods, 1.0))))


def _batch(parameters: Mapping[str, Array], scene: Scene) -> Coupled:
    """Return the batch in dimensionless form."""
    problem = dimensionless(parameters, scene.duration, scene.measures.transient)
    launch = launches(scene.launch, scene.particles, parameters["frequency"])
    law, noise = restitution_of(scene.restitution_law), noise_of(problem.noise, scene.noise_seed)
    return Coupled(problem, mounts(parameters, law, shape_of(scene.waveform), noise), launch)


def _joint(parameters: Mapping[str, Array], scene: Scene, workers: Workers) -> Measured:
    """Return the variables of the orbits on which joint states settle."""
    batch, particles = _batch(parameters, scene), scene.particles
    size, problem = parameters["frequency"].size, batch.problem
    out = empty_joint(size)
    budget = min(scene.budget * particles, 2**62)

    def task(first: int, last: int) -> None:
        settle_jointly(first, last, batch, budget, notes(particles), out)

    workers.run(task, size, _per_task(batch, particles), out)
    periods = (problem.end_count - problem.begin_count) + (problem.end_phase - problem.begin_phase)
    blocks = out.growth * (BLOCKS / periods[:, np.newaxis])  # per forcing period
    with np.errstate(invalid="ignore"):
        exponent = blocks.sum(axis=1) / BLOCKS
        error = np.where(
            np.isfinite(exponent), standard_error(out.growth, out.waves) / periods, np.nan
        )
        spreads = (exponent > 3.0 * error) & (out.landings >= LANDINGS_OF_AN_EXPONENT)
    recurs = out.impacts > 0
    regime = np.select(
        [out.at_rest == 1, recurs & (out.rests > 0), recurs, spreads],
        [Regime.AT_REST, Regime.RESTING, Regime.LOCKED, Regime.APERIODIC],
        Regime.UNSETTLED,
    )
    return {
        "joint_regime": regime.astype(np.int8),
        "joint_cycle_impacts": out.impacts,
        "joint_cycle_periods": out.periods,
        "joint_cycle_rests": out.rests,
        "joint_recurrent_from": out.since / parameters["frequency"],
        "joint_exponent": exponent,
        "joint_exponent_error": error,
    }


def standard_error(growth: Array, waves: Array) -> Array:
    """Return the standard error of the sum of each row of blocks of equal time.

    The growth in a block varies for two reasons.  Growth along the block varies from block to block
    with a variance s^2, which adds up.  At each end of a block, the time since the last impact and
    the direction of the deviation shift growth, with a variance t^2, from one block to the next.  A
    block then has the variance s^2 + 2 t^2 and the sum of n blocks n s^2 + 2 t^2, so that n times
    the variance of the blocks would count the ends n times.  The ends do not enter slow
    oscillations along the row, whose mean square is n s^2 / 2.
    """
    with np.errstate(invalid="ignore"):
        adds_up = 2.0 * (waves * waves).sum(axis=1) / waves.shape[1]
        ends = growth.var(axis=1) - adds_up / growth.shape[1]
        return np.asarray(np.sqrt(adds_up + np.maximum(ends, 0.0)))


@dataclass(frozen=True)
class BaseTrack:
    """Exact motion of the base of one realization, from event to event."""

    parameters: dict[str, Array]  # in physical units, of shape (1,)
    batch: Coupled  # the same in dimensionless form
    track: EventStates  # state after every launch, landing and lift-off
    landings: NDArray[np.int64]  # of each particle

    def at(self, times: Array) -> tuple[Array, Array]:
        """Return the height (m) and velocity (m s-1) of the base at increasing times (s).

        NaN before the first launch.
        """
        frequency, velocity = (float(values[0]) for values in units_of(self.parameters))
        problem = self.batch.problem
        scale = Scale(frequency, velocity, 0.0, float(problem.phase[0]))
        out = np.full((2, times.size), np.nan)
        known = times >= self.track.time[0, 0]
        found = np.empty((2, int(np.count_nonzero(known))))
        instants, mounts = np.ascontiguousarray(times[known]), self.batch.mounts
        trace(problem, mounts, scale, 0, self.track, instants, found)
        out[:, known] = found
        return out[0] * velocity / frequency, out[1] * velocity


def base_track(parameters: Mapping[str, Array], scene: Scene, workers: Workers) -> BaseTrack:
    """Return the motion of the base of one realization; arguments as for `measure_coupled`."""
    landings = followed(parameters, scene, workers, 0)[0].particles.landings
    record = followed(parameters, scene, workers, max(int(landings.max()), 1))[2]
    return BaseTrack(dict(parameters), _batch(parameters, scene), record.track, landings)
