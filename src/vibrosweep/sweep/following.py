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

from vibrosweep.kernels.advance import advance
from vibrosweep.kernels.combine import combine
from vibrosweep.kernels.cycles import Cycles, empty_rests
from vibrosweep.kernels.lanes import scratch
from vibrosweep.kernels.separation import Separations, empty_separations, separate, workspace
from vibrosweep.kernels.statistics import Statistics, empty_statistics
from vibrosweep.kernels.trust import Trust, empty_trust, trust
from vibrosweep.kernels.unforced import has_closed_form, unforced
from vibrosweep.kernels.unforced_gaps import separate_unforced
from vibrosweep.scene import Dimensionless, Launches
from vibrosweep.status import Status
from vibrosweep.sweep.observation import Observation
from vibrosweep.sweep.sharing import find_chains, find_equal, find_shared
from vibrosweep.sweep.workers import TRAJECTORIES_PER_TASK, Workers

__all__ = ["PERIODS_TO_SHARE", "Followed", "follow", "statistics"]

Array = NDArray[np.float64]
Fields = TypeVar("Fields", bound=tuple[Any, ...])

# Over fewer periods hardly an orbit repeats early enough for its recognition to pay.
PERIODS_TO_RECUR = 32.0
# Over fewer periods it costs as much to find the trajectories that are one as to follow them all.
PERIODS_TO_SHARE = 256.0


@dataclass(frozen=True)
class Followed:
    """What is known of a batch of trajectories, in forcing periods; None where not asked for.

    Attributes
    ----------
    each
        Of the trajectories, those of a realization side by side; in the workers' memory until its
        next use. Only for measures per particle and regimes.
    whole
        Of the realizations.
    cycles
        Of the trajectories, in the workers' memory. Only for regimes.
    separations
        Of the realizations.
    bounds
        Of the trajectories.
    """

    each: Statistics | None
    whole: Statistics
    cycles: Cycles | None
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
    separations = bounds = None
    if observation.separation:
        separations = _separations(problem, launch, observation, whole, cycles, workers)
    if observation.trust:
        bounds = _error_bounds(problem, launch, tolerance, observation, workers)
    of_particles = observation.per_particle or observation.regimes
    return Followed(
        each if of_particles else None,
        whole,
        cycles if observation.regimes else None,
        separations,
        bounds,
    )


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
    particles = observation.particles
    closed = np.empty(problem.kick.size, bool)
    forced = not observation.skip or bool(problem.kick.all())
    if forced or not has_closed_form(problem, observation.impact_budget, closed):
        return _advanced(problem, launch, observation, workers, cycles)
    if closed.all():
        each = workers.statistics(closed.size * particles)
        _unforced(problem, launch, workers, each)
    else:
        each = empty_statistics(closed.size * particles)
        some = empty_statistics(int(np.count_nonzero(closed)) * particles)
        _unforced(_taken(problem, closed), _launches_of(launch, closed), workers, some)
        others = _taken(problem, ~closed), _launches_of(launch, ~closed)
        rest = _advanced(*others, observation, workers, cycles)
        for target, *sources in zip(
            *(_rows(v, particles) for v in (each, some, rest)), strict=True
        ):
            target[closed], target[~closed] = sources
    if cycles is not None:
        _place_cycles(cycles, ~closed, particles)
    return each


def _unforced(problem: Dimensionless, launch: Launches, workers: Workers, each: Statistics) -> None:
    particles = launch.whole.shape[1]
    workers.each(
        lambda first, last: unforced(first, last, problem, launch, each),
        problem.kick.size,
        max(1, TRAJECTORIES_PER_TASK // particles),
    )


def _place_cycles(cycles: Cycles, which: NDArray[np.bool_], particles: int) -> None:
    """Move cycles that were written one after the other to the realizations that have them."""
    of_each = cycles.reshape(cycles.shape[0], -1, particles)
    of_each[:, which] = of_each[:, : np.count_nonzero(which)].copy()
    of_each[:, ~which] = 0.0


def _rows(fields: tuple[Any, ...], particles: int) -> list[NDArray[Any]]:
    """Fields of trajectories, a row for each realization."""
    return [values.reshape(-1, particles) for values in fields]


def _advanced(
    problem: Dimensionless,
    launch: Launches,
    observation: Observation,
    workers: Workers,
    cycles: Cycles | None,
) -> Statistics:
    total = problem.kick.size * observation.particles
    each = workers.statistics(total)
    window = observation.window  # goes through all launches
    shared = None
    if observation.skip and cycles is not None and _lasts(problem, launch, PERIODS_TO_SHARE):
        patience = 0.0 if observation.regimes else PERIODS_TO_RECUR
        shared = find_shared(problem, launch, window, patience)

    def begin() -> Callable[[int, int], None]:
        room = scratch()
        rests = None if cycles is None else empty_rests()
        lanes = 0

        def task(first: int, last: int) -> None:
            nonlocal lanes
            lanes = advance(
                first,
                last,
                lanes,
                problem,
                launch,
                observation.impact_budget,
                observation.reflect,
                window,
                room,
                each,
                cycles,
                rests,
                PERIODS_TO_RECUR,
                int(observation.regimes),
                int(observation.skip),
                shared,
            )

        return task

    workers.stream(begin, total if shared is None else shared.first.size)
    return each


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
    window = observation.window  # goes through all launches
    rooms = [workspace(particles) for _ in range(min(size, workers.threads))]  # costly to make
    closed = np.zeros(size, bool)
    if observation.skip and not problem.kick.all():
        has_closed_form(problem, observation.impact_budget, closed)
    complete &= ~closed

    scenes, after = np.arange(size), np.full(size, -1)
    if window is None and known.size > 0 and _lasts(problem, launch, PERIODS_TO_SHARE):
        chains = find_chains(problem, launch, window, 0.0)
        if chains is not None:
            scenes, after = chains

    def task(first: int, last: int) -> None:
        room = rooms.pop()
        separate(
            first,
            last,
            scenes,
            after,
            problem,
            launch,
            complete,
            observation.impact_budget,
            observation.reflect,
            window,
            room,
            known,
            found,
        )
        rooms.append(room)

    def task_unforced(first: int, last: int) -> None:
        room = rooms.pop()
        separate_unforced(first, last, problem, launch, closed, window, room, found)
        rooms.append(room)

    per_task = max(1, TRAJECTORIES_PER_TASK // (32 * particles))
    workers.each(task, scenes.size, per_task)
    if closed.any():
        workers.each(task_unforced, size, per_task)
    return found


def _error_bounds(
    problem: Dimensionless,
    launch: Launches,
    tolerance: Array,
    observation: Observation,
    workers: Workers,
) -> Trust:
    bounds = empty_trust(tolerance.size * observation.particles)

    def task(first: int, last: int) -> None:
        trust(
            first,
            last,
            problem,
            launch,
            tolerance,
            observation.impact_budget,
            observation.reflect,
            bounds,
        )

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
    cycles = found.cycles
    if cycles is not None:
        of_each = cycles.reshape(cycles.shape[0], -1, particles)
        cycles = of_each[:, source].reshape(cycles.shape[0], -1)
    return Followed(
        None if found.each is None else trajectories(found.each),
        realizations(found.whole),
        cycles,
        None if found.separations is None else realizations(found.separations),
        None if found.bounds is None else trajectories(found.bounds),
    )
