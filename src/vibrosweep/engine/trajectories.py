"""A batch of dimensionless problems through the kernels, without doing anything twice.

Threads call the compiled kernels on ranges that are theirs alone; results therefore do not depend
on the number of threads, nor on how a sweep is cut into batches.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from vibrosweep.engine.duplicates import find_equal
from vibrosweep.engine.observation import Observation
from vibrosweep.engine.workers import TRAJECTORIES_PER_TASK, Workers
from vibrosweep.kernels.advance import Options, advance
from vibrosweep.kernels.combine import combine
from vibrosweep.kernels.cycles import Cycles, empty_rests
from vibrosweep.kernels.impact import Batch, base_of
from vibrosweep.kernels.lanes import scratch
from vibrosweep.kernels.orbits import Orbits, empty_orbits, settle
from vibrosweep.kernels.separation import Separations, empty_separations, separate, workspace
from vibrosweep.kernels.statistics import Statistics, empty_statistics
from vibrosweep.kernels.trust import Trust, empty_trust, trust
from vibrosweep.model.parameters import Dimensionless, Launches
from vibrosweep.model.status import Status

__all__ = ["PERIODS_TO_RECUR", "Followed", "follow", "settled", "statistics"]

Array = NDArray[np.float64]
Fields = TypeVar("Fields", bound=tuple[Any, ...])

# Over fewer periods hardly an orbit repeats early enough for its recognition to pay.
PERIODS_TO_RECUR = 32.0


@dataclass(frozen=True)
class Followed:
    """What is known of a batch of trajectories, in forcing periods; None where not asked for.

    Attributes
    ----------
    each
        Of the trajectories, those of a realization side by side; in the workers' memory until its
        next use. Only for measures per particle.
    whole
        Of the realizations.
    orbits
        What the trajectories settle on.
    separations
        Of the realizations.
    bounds
        Of the trajectories.
    """

    each: Statistics | None
    whole: Statistics
    orbits: Orbits | None
    separations: Separations | None
    bounds: Trust | None


def follow(
    problem: Dimensionless,
    launch: Launches,
    tolerance: Array,
    observation: Observation,
    workers: Workers,
) -> Followed:
    """Follow all trajectories of a batch; realizations that are one problem only once.

    Parameters
    ----------
    problem, launch
        The batch.
    tolerance
        Error of a landing instant up to which it is trusted, in forcing periods; shape
        (realization,).
    observation
        What is measured.
    workers
        Threads to use.
    """
    others = [tolerance] if observation.trust else []
    first = find_equal(problem, launch, *others) if observation.skip else None
    if first is None:
        return _follow(problem, launch, tolerance, observation, workers)
    chosen = np.flatnonzero(first == np.arange(first.size))
    place = np.empty_like(first)
    place[chosen] = np.arange(chosen.size)
    found = _follow(
        _taken(problem, chosen),
        _launches_of(launch, chosen),
        tolerance[chosen],
        observation,
        workers,
    )
    return _repeated(found, place[first], observation)


def _follow(
    problem: Dimensionless,
    launch: Launches,
    tolerance: Array,
    observation: Observation,
    workers: Workers,
) -> Followed:
    size, particles = tolerance.size, observation.particles
    cycles = None
    if observation.regimes or (observation.skip and _lasts(problem, launch, PERIODS_TO_RECUR)):
        cycles = workers.cycles(size * particles)
    each = statistics(problem, launch, observation, workers, cycles)
    whole = empty_statistics(size)._replace(at_rest=np.empty(size, np.int64))
    workers.each(
        lambda first, last: combine(first, last, particles, each, whole),
        size,
        max(1, 2 * TRAJECTORIES_PER_TASK // particles),
    )
    orbits = separations = bounds = None
    if observation.regimes and cycles is not None:
        orbits = _orbits(problem, launch, each, cycles, observation, workers)
    if observation.separation:
        separations = _separations(problem, launch, observation, whole, cycles, workers)
    if observation.trust:
        bounds = _error_bounds(problem, launch, tolerance, observation, workers)
    return Followed(each if observation.per_particle else None, whole, orbits, separations, bounds)


def statistics(
    problem: Dimensionless,
    launch: Launches,
    observation: Observation,
    workers: Workers,
    cycles: Cycles | None = None,
) -> Statistics:
    """Statistics of every trajectory, in the order of realizations and within them of particles.

    They stand in the workers' memory until its next use.  Where `cycles` are given, they are
    written, and trajectories that recur are followed no further.
    """
    total = problem.kick.size * observation.particles
    each = workers.statistics(total)
    windowed = observation.windowed  # goes through all launches
    batch = Batch(base_of(observation.rebound), problem, launch)
    options = Options(
        observation.budget, PERIODS_TO_RECUR, int(observation.regimes), int(observation.skip)
    )

    def begin() -> Callable[[int, int], None]:
        room = scratch()
        rests = None if cycles is None else empty_rests()
        lanes = 0

        def task(first: int, last: int) -> None:
            nonlocal lanes
            span = (first, last, lanes)
            lanes = advance(span, batch, options, windowed, room, each, cycles, rests)

        return task

    workers.stream(begin, total)
    return each


def settled(
    problem: Dimensionless, launch: Launches, observation: Observation, workers: Workers
) -> Orbits:
    """What every trajectory settles on, in the order of realizations and within them of particles.

    Arguments as of `statistics`.
    """
    cycles = workers.cycles(problem.kick.size * observation.particles)
    each = statistics(problem, launch, observation, workers, cycles)
    return _orbits(problem, launch, each, cycles, observation, workers)


def _orbits(
    problem: Dimensionless,
    launch: Launches,
    each: Statistics,
    cycles: Cycles,
    observation: Observation,
    workers: Workers,
) -> Orbits:
    orbits = empty_orbits(each.status.size)

    batch = Batch(base_of(observation.rebound), problem, launch)
    exponents = int(observation.lyapunov)

    def task(first: int, last: int) -> None:
        settle(first, last, batch, each, cycles, observation.budget, exponents, orbits)

    workers.each(task, each.status.size, TRAJECTORIES_PER_TASK // 64)
    return orbits


def _lasts(problem: Dimensionless, launch: Launches, periods: float) -> bool:
    """Whether any trajectory may last for more than so many periods."""
    return bool(np.max(problem.end_count) - np.min(launch.whole) + 2.0 > periods)


def _separations(
    problem: Dimensionless,
    launch: Launches,
    observation: Observation,
    whole: Statistics,
    cycles: Cycles | None,
    workers: Workers,
) -> Separations:
    size, particles = problem.kick.size, observation.particles
    found = empty_separations(size)
    if particles == 1:  # nothing to be separated from
        found.shared[:] = np.where(whole.status == Status.COMPLETED, 0, found.shared)
        return found
    complete = whole.status == Status.COMPLETED
    known = cycles if cycles is not None and observation.skip else workers.cycles(0)
    windowed = observation.windowed  # goes through all launches
    batch = Batch(base_of(observation.rebound), problem, launch)
    rooms = [workspace(particles) for _ in range(min(size, workers.threads))]  # costly to make

    def task(first: int, last: int) -> None:
        room = rooms.pop()
        separate((first, last), batch, complete, observation.budget, windowed, room, known, found)
        rooms.append(room)

    per_task = max(1, TRAJECTORIES_PER_TASK // (32 * particles))
    workers.each(task, size, per_task)
    return found


def _error_bounds(
    problem: Dimensionless,
    launch: Launches,
    tolerance: Array,
    observation: Observation,
    workers: Workers,
) -> Trust:
    bounds = empty_trust(tolerance.size * observation.particles)

    batch = Batch(base_of(observation.rebound), problem, launch)

    def task(first: int, last: int) -> None:
        trust(first, last, batch, tolerance, observation.budget, bounds)

    workers.each(task, bounds.until.size, TRAJECTORIES_PER_TASK // 64)
    return bounds


def _taken(problem: Dimensionless, which: NDArray[Any]) -> Dimensionless:
    return Dimensionless._make(values[which] for values in problem)


def _launches_of(launch: Launches, which: NDArray[Any]) -> Launches:
    """Launches of some realizations, where they do not share them all."""
    if launch.whole.shape[0] == 1:
        return launch
    return Launches._make(values[which] for values in launch)


def _repeated(found: Followed, source: NDArray[np.intp], observation: Observation) -> Followed:
    """The results of realizations for all those that are the same problem."""

    def realizations(values: Fields) -> Fields:
        return type(values)(*(v[source] for v in values))

    def trajectories(values: Fields) -> Fields:
        return type(values)(*(v.reshape(-1, particles)[source].ravel() for v in values))

    particles = observation.particles
    return Followed(
        None if found.each is None else trajectories(found.each),
        realizations(found.whole),
        None if found.orbits is None else trajectories(found.orbits),
        None if found.separations is None else realizations(found.separations),
        None if found.bounds is None else trajectories(found.bounds),
    )
