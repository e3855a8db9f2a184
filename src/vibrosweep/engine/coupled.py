"""Measure realizations whose particles are coupled by a base of finite mass."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.engine.in_units import (
    Measured,
    height_unit,
    impact_speeds,
    of_launches,
    of_particles,
    of_realizations,
    separations_in_units,
)
from vibrosweep.engine.observable_values import kinds_of, observable_values
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.coupled.counting import (
    CoupledStatistics,
    empty_coupled,
    more_numbers,
    work_for,
)
from vibrosweep.kernels.coupled.follow import (
    Coupled,
    PerRealization,
    empty_per_realization,
    follow,
    follow_uncached,
)
from vibrosweep.kernels.coupled.motion_record import MotionRecord, Track, empty_track, trace
from vibrosweep.kernels.coupled.settling import BLOCKS, carry, empty_joint, notes, settle_jointly
from vibrosweep.kernels.coupled.state import MODE, NOW, PARTICLE, system
from vibrosweep.kernels.falling import restitution_of
from vibrosweep.kernels.harmonics import shape_of
from vibrosweep.kernels.noise import noise_of
from vibrosweep.kernels.observer import Observer
from vibrosweep.kernels.record import Record, Scale, Units, empty_record
from vibrosweep.kernels.statistics import KINDS_COUPLED, Statistics
from vibrosweep.model.parameters import dimensionless, launches, mounts
from vibrosweep.model.restitution_laws import CONSTANT
from vibrosweep.model.shapes import PARABOLIC_NAME, SINE
from vibrosweep.model.status import Regime
from vibrosweep.model.times import Periods
from vibrosweep.scene.scene import Scene

LANDINGS_OF_AN_EXPONENT = 64  # fewer do not show how neighbours separate
LANDINGS_PER_TASK = 20_000  # so that threads share the work evenly


def measure_coupled(parameters: Mapping[str, Array], scene: Scene, workers: Workers) -> Measured:
    """Follow a batch of realizations on bases of finite mass and measure them.

    Parameters and result are those of `vibrosweep.engine.measure.measure`; the parameters of the
    mount are among them.
    """
    (each, sums, launched, _), whole, _ = _followed(parameters, scene, workers, 0)
    frequency, particles = parameters["frequency"], scene.particles
    found = of_realizations(sums, parameters)
    heights = launched.reshape(-1, particles) * height_unit(parameters)[:, np.newaxis]
    highest = found["rebound_height_max"]
    found["flight_height_max"] = of_launches(scene, parameters, heights, highest)
    if scene.measures.impact_speed:
        found |= impact_speeds(sums, parameters, scene.restitution_law)
    if scene.measures.per_particle:
        found |= of_particles(each, parameters, particles)
    found |= observable_values(
        parameters,
        scene,
        each,
        lambda observer: _followed(parameters, scene, workers, 0, observer)[0].each,
    )
    found |= separations_in_units(whole.separations, frequency) | _order(whole, frequency)
    if scene.measures.joint:
        found |= _joint(parameters, scene, workers)
    return found


def _followed(
    parameters: Mapping[str, Array],
    scene: Scene,
    workers: Workers,
    capacity: int,
    observer: Observer | None = None,
) -> tuple[CoupledStatistics, PerRealization, MotionRecord]:
    """Statistics of particles and of realizations, and their separations and order.

    Also at most `capacity` landings of each particle, with the motion of the base; 0 for none.
    """
    particles, size = scene.particles, parameters["frequency"].size
    batch = _batch(parameters, scene)
    kinds = (*KINDS_COUPLED, *kinds_of(scene))
    statistics, whole = empty_coupled(size, particles, kinds, observer), empty_per_realization(size)
    kernel = follow if observer is None else follow_uncached
    idle = [work_for(particles) for _ in range(min(size, workers.threads))]
    # a launch of each particle; each landing is followed by no more than one lift-off of riders
    events = particles * (1 + 2 * capacity) + _corners(batch, scene) if capacity > 0 else 0
    track = empty_track(size, events)
    units = Units(parameters["frequency"], parameters["gravity"] / (2.0 * parameters["frequency"]))
    written = MotionRecord(empty_record(size * particles, capacity), track, units)

    def task(first: int, last: int) -> None:
        work, budget = idle.pop(), scene.budget
        while True:
            first = kernel(first, last, batch, budget, work, statistics, whole, written)
            if first == last:
                break
            work = more_numbers(work)
        idle.append(work)

    workers.each(task, size, _per_task(batch, particles), statistics, whole, written.record)
    return statistics, whole, written


def _corners(batch: Coupled, scene: Scene) -> int:
    """Largest number of corners that the drive passes until the end of the observation."""
    if scene.waveform.name != PARABOLIC_NAME:
        return 0
    return 2 * int(np.max(batch.problem.end_count) - np.min(batch.launches.whole)) + 4


def _per_task(batch: Coupled, particles: int) -> int:
    """Return how many realizations a thread takes at a time."""
    periods = float(np.max(batch.problem.end_count)) - float(np.min(batch.launches.whole)) + 1.0
    return max(1, int(LANDINGS_PER_TASK / (particles * max(periods, 1.0))))


def _batch(parameters: Mapping[str, Array], scene: Scene) -> Coupled:
    """Return the batch in dimensionless form."""
    problem = dimensionless(parameters, scene.duration, scene.measures.transient)
    launch = launches(scene.launch, scene.particles, parameters["frequency"])
    law, noise = restitution_of(scene.restitution_law), noise_of(problem.noise, scene.noise_seed)
    return Coupled(problem, mounts(parameters, law, shape_of(scene.waveform), noise), launch)


def _order(whole: PerRealization, frequency: Array) -> Measured:
    """Order of the landings."""
    names = ("order_1", "order_2", "order_3", "order_half", "order_third")
    return {
        **{name: whole.order[:, h].copy() for h, name in enumerate(names)},
        "gap_median": whole.gap_median / frequency,
        "gap_min": whole.gap_least / frequency,
        "order_changes": whole.changes,
        "undecided_count": whole.undecided,
    }


def _joint(parameters: Mapping[str, Array], scene: Scene, workers: Workers) -> Measured:
    """Variables of the orbits that joint states settle on."""
    batch, particles = _batch(parameters, scene), scene.particles
    size, problem = parameters["frequency"].size, batch.problem
    out = empty_joint(size)
    budget = min(scene.budget * particles, 2**62)

    def task(first: int, last: int) -> None:
        settle_jointly(first, last, batch, budget, notes(particles), out)

    workers.each(task, size, _per_task(batch, particles), out)
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

    A block scatters for two reasons: by the growth along it, which adds up, and by its ends, whose
    place between impacts and whose direction of the deviation shift growth from one block to the
    next. If the growth in each of n blocks has the variance s^2 and each end t^2, a block has the
    variance s^2 + 2 t^2 and the sum n s^2 + 2 t^2; the scatter of the blocks would count the ends n
    times. The ends do not enter slow waves, whose mean square is n s^2 / 2.
    """
    with np.errstate(invalid="ignore"):
        adds_up = 2.0 * (waves * waves).sum(axis=1) / waves.shape[1]
        ends = growth.var(axis=1) - adds_up / growth.shape[1]
        return np.asarray(np.sqrt(adds_up + np.maximum(ends, 0.0)))


@dataclass(frozen=True)
class Neighbours:
    """A state of all particles and their base, and the motion of its neighbours since."""

    # height, speed: of each particle above the base and relative to it, in g / (2 f^2), g / (2 f)
    height: Array
    speed: Array
    phase: float  # of the forcing, in turns
    deviation: tuple[float, float]  # of the base from its forced oscillation: height and velocity
    # Derivative by the state at first, whose entries are heights and velocities of the particles,
    # height and velocity of the base; shape (2 * particle + 2,) twice
    matrix: Array
    landings: int  # on the way


def carry_on(
    parameters: Mapping[str, Array],
    begin: Neighbours,
    periods: float,
    restitution_law: str = CONSTANT,
) -> Neighbours:
    """Carry a state in which all particles fly on for some forcing periods: the Floquet map.

    Its matrix is multiplied from the left.  The parameters are those of `measure_coupled`, of one
    realization.  Raises a ParameterError where a landing could not be found.
    """
    problem = dimensionless(parameters, Periods(periods))
    state, matrix = system(begin.height.size), np.array(begin.matrix, order="F")
    state.mode[:] = MODE.FLYING
    state.particle[PARTICLE.HEIGHT], state.particle[PARTICLE.SPEED] = begin.height, begin.speed
    state.particle[PARTICLE.SCALE] = np.abs(begin.speed)
    state.now[NOW.X] = begin.phase
    state.now[NOW.D], state.now[NOW.B] = begin.deviation
    rode = np.zeros_like(state.mode)
    law = restitution_of(restitution_law)
    landings = carry(
        state, problem, mounts(parameters, law, shape_of(SINE)), 0, periods, rode, matrix
    )
    if landings < 0:
        raise ParameterError("the next landing could not be found: the parameters are too extreme")
    return Neighbours(
        state.particle[PARTICLE.HEIGHT].copy(),
        state.particle[PARTICLE.SPEED].copy(),
        float(state.now[NOW.X]),
        (float(state.now[NOW.D]), float(state.now[NOW.B])),
        matrix,
        landings,
    )


@dataclass(frozen=True)
class BaseTrack:
    """Motion of the base of one realization, exactly, from event to event."""

    parameters: dict[str, Array]  # in physical units, of shape (1,)
    batch: Coupled  # the same, dimensionless
    track: Track  # after every launch, landing and lift-off

    def at(self, times: Array) -> tuple[Array, Array]:
        """Return the height (m) and velocity (m s-1) of the base at increasing times (s).

        NaN before the first launch.
        """
        frequency = float(self.parameters["frequency"][0])
        velocity = float(self.parameters["gravity"][0]) / (2.0 * frequency)
        problem = self.batch.problem
        scale = Scale(frequency, velocity, 0.0, float(problem.phase[0]))
        out = np.full((2, times.size), np.nan)
        known = times >= self.track.time[0, 0]
        found = np.empty((2, int(np.count_nonzero(known))))
        instants, mounts = np.ascontiguousarray(times[known]), self.batch.mounts
        trace(problem, mounts, scale, 0, self.track, instants, found)
        out[:, known] = found
        return out[0] * velocity / frequency, out[1] * velocity


def count_coupled(parameters: Mapping[str, Array], scene: Scene, workers: Workers) -> Statistics:
    """Statistics of every particle, ordered by realization; arguments as of `measure_coupled`."""
    return _followed(parameters, scene, workers, 0)[0].each


def record_coupled(
    parameters: Mapping[str, Array], scene: Scene, workers: Workers, capacity: int
) -> Record:
    """Every landing until the end of the observation, at most `capacity` of each particle."""
    return _followed(parameters, scene, workers, capacity)[2].record


def base_track(parameters: Mapping[str, Array], scene: Scene, workers: Workers) -> BaseTrack:
    """Motion of a base while particles land on it; arguments as of `measure_coupled`."""
    capacity = int(count_coupled(parameters, scene, workers).landings.max())
    written = _followed(parameters, scene, workers, max(capacity, 1))[2]
    return BaseTrack(dict(parameters), _batch(parameters, scene), written.track)
