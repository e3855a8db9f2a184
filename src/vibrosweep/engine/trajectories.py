"""Run the kernels on a batch of dimensionless problems, and on duplicates only once.

A trajectory depends on its own problem only; results therefore depend neither on the number of
threads nor on how a sweep is cut into batches.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.engine.observable_values import kinds_of
from vibrosweep.engine.workers import TRAJECTORIES_PER_TASK, Workers
from vibrosweep.kernels import growth
from vibrosweep.kernels._jit import Floats
from vibrosweep.kernels.advance import Options, Share, advance, advance_uncached, memory_around
from vibrosweep.kernels.bases import Base, fitted
from vibrosweep.kernels.cycles import CYCLE, Cycles, empty_rests
from vibrosweep.kernels.distinct import first_of_each
from vibrosweep.kernels.impact import Batch, base_of
from vibrosweep.kernels.noise import noise_of
from vibrosweep.kernels.observer import Observer, observer_scratch
from vibrosweep.kernels.ordering import workspace
from vibrosweep.kernels.recorder import KINDS_RECORDED, Recorder, recorder_scratch
from vibrosweep.kernels.separation import Separations, empty_separations, find_order, separate
from vibrosweep.kernels.sequence import Orders, empty_orders, empty_turns
from vibrosweep.kernels.settle import Orbits, Search, empty_orbits, settle
from vibrosweep.kernels.statistics import KINDS, Kinds, Statistics, empty_sums
from vibrosweep.kernels.totals import combine, scratch
from vibrosweep.kernels.trust import Trust, empty_trust, trust
from vibrosweep.kernels.unwritten import require_written
from vibrosweep.model.measures import UNDETERMINED
from vibrosweep.model.parameters import Dimensionless, Launches, taken
from vibrosweep.model.status import Status
from vibrosweep.scene.scene import Scene

# Shorter orbits hardly ever repeat early enough for the detection of cycles to save time
PERIODS_TO_RECUR = 32.0


def base_in(scene: Scene, problem: Dimensionless) -> Base:
    """Return the base of a scene, with the noise of the problem, as kernels take it."""
    noise = noise_of(problem.noise, scene.noise_seed)
    return base_of(*scene.mechanics, noise)


@dataclass(frozen=True)
class Followed:
    """Results of a batch in forcing periods; None for what was not requested."""

    # Statistics of trajectories, ordered by realization, in memory that the workers reuse for the
    # next batch; only for measures per particle and observables
    trajectories: Statistics | None
    realizations: Statistics
    orbits: Orbits | None  # orbits on which the trajectories settle
    # separations, order: of realizations
    separations: Separations | None
    order: Orders | None
    bounds: Trust | None  # of trajectories


def follow(
    problem: Dimensionless, launch: Launches, tolerance: Array, scene: Scene, workers: Workers
) -> Followed:
    """Simulate all trajectories of a batch, and duplicate realizations only once.

    `tolerance` is the largest error of a trusted landing time in forcing periods, shape
    (realization,).
    """
    others = [tolerance] if scene.measures.trust else []
    search = scene.skip and problem.noise is None
    first = find_equal(problem, launch, *others) if search else None
    if first is None:
        return _follow(problem, launch, tolerance, scene, workers)
    chosen = np.flatnonzero(first == np.arange(first.size))
    place = np.empty_like(first)
    place[chosen] = np.arange(chosen.size)
    if launch.whole.shape[0] > 1:  # otherwise all realizations share their launches
        launch = Launches._make(values[chosen] for values in launch)
    found = _follow(taken(problem, chosen), launch, tolerance[chosen], scene, workers)
    return _repeated(found, place[first], scene)


def _follow(
    problem: Dimensionless, launch: Launches, tolerance: Array, scene: Scene, workers: Workers
) -> Followed:
    size, particles = tolerance.size, scene.particles
    measures, cycles = scene.measures, None
    wanted = measures.regimes or (scene.skip and _longest(problem, launch) > PERIODS_TO_RECUR)
    if wanted and problem.noise is None:  # random motion never recurs
        cycles = workers.cycles(size * particles)
    trajectories = statistics(problem, launch, scene, workers, cycles)
    realizations = empty_sums(size, trajectories.kinds)
    workers.run(
        lambda first, last: combine(first, last, particles, trajectories, realizations),
        size,
        max(1, 2 * TRAJECTORIES_PER_TASK // particles),
        realizations,
    )
    orbits = bounds = None
    batch = Batch(base_in(scene, problem), problem, launch)
    if measures.regimes:
        none = np.zeros((len(CYCLE), size * particles))
        found = none if cycles is None else cycles
        orbits = settled(batch, trajectories, found, scene, workers)
    in_time = _in_time(batch, scene, realizations, cycles, workers)
    if measures.trust:
        bounds = _error_bounds(batch, tolerance, scene, workers)
    kept = trajectories if measures.per_particle or measures.observables else None
    return Followed(kept, realizations, orbits, *in_time, bounds)


def statistics(
    problem: Dimensionless,
    launch: Launches,
    scene: Scene,
    workers: Workers,
    cycles: Cycles | None = None,
    observer: Observer | Recorder | None = None,
    more: Kinds = (),
) -> Statistics:
    """Return the statistics of every trajectory, ordered by realization, then by particle.

    The result is in memory that the workers reuse for the next batch.  If `cycles` is given, it is
    filled, and a trajectory is followed only until it recurs.  An `observer` is called at every
    landing, and requires that `cycles` is None.  `more` names further statistics.
    """
    total = problem.kick.size * scene.particles
    kernel, kinds = advance, (*KINDS, *kinds_of(scene), *more)
    block: Callable[[], Floats] = partial(scratch, kinds)
    if isinstance(observer, Recorder):
        kinds, block = KINDS_RECORDED, recorder_scratch
    elif observer is not None:
        kernel, kinds, block = advance_uncached, KINDS, observer_scratch
    found = workers.statistics(total, kinds)
    window = 1 if scene.windowed else None  # None selects machine code without a window
    base = fitted(base_in(scene, problem), problem)
    batch = Batch(base, problem, launch)
    all_cycles, jump = int(scene.measures.regimes), int(scene.skip)
    options = Options(scene.budget, PERIODS_TO_RECUR, all_cycles, jump, observer)

    def begin() -> Callable[[int, int], None]:
        memory = memory_around(block())
        rests = None if cycles is None else empty_rests(found.kinds)
        lanes = 0

        def task(first: int, last: int) -> None:
            nonlocal lanes
            share = Share(first, last, lanes)
            lanes = kernel(share, batch, options, window, memory, found, cycles, rests)

        return task

    workers.stream(begin, total, _longest(problem, launch))
    require_written(found, ("at_rest", "status"))  # written by the same function as the totals
    return found


def _longest(problem: Dimensionless, launch: Launches) -> float:
    """Return an upper bound of the duration of every trajectory, in forcing periods."""
    return float(np.max(problem.end_count) - np.min(launch.whole) + 2.0)


def settled(
    batch: Batch, found: Statistics, cycles: Cycles, scene: Scene, workers: Workers
) -> Orbits:
    """Return the orbit on which each trajectory settles, from its `statistics` and its cycle."""
    orbits = empty_orbits(found.status.size)
    search = Search(scene.budget, int(scene.measures.lyapunov))
    plain = found._replace(kinds=())  # the same machine code for any choice of statistics

    def task(first: int, last: int) -> None:
        settle(first, last, batch, plain, cycles, search, np.empty(growth.SIZE), orbits)

    workers.run(task, found.status.size, TRAJECTORIES_PER_TASK // 64, orbits)
    return orbits


def _in_time(
    batch: Batch,
    scene: Scene,
    realizations: Statistics,
    cycles: Cycles | None,
    workers: Workers,
) -> tuple[Separations | None, Orders | None]:
    """Measure separations and order, which need the landings of all particles in order of time."""
    size, particles = realizations.status.size, scene.particles
    complete = realizations.status == Status.COMPLETED
    known = cycles if cycles is not None and scene.skip else workers.cycles(0)

    def run(kernel: Any, memory: Callable[[], Any], found: Any) -> None:
        # shared by all tasks, because it is costly to allocate
        idle = [memory() for _ in range(min(size, workers.threads))]

        def task(first: int, last: int) -> None:
            work = idle.pop()
            kernel(first, last, batch, complete, scene.budget, work, known, found)
            idle.append(work)

        workers.run(task, size, max(1, TRAJECTORIES_PER_TASK // (32 * particles)), found)

    separations = order = None
    if scene.measures.separation:
        separations = empty_separations(size)
        if particles > 1:
            run(separate, lambda: workspace(particles), separations)
        else:  # a single particle has no separations
            separations.gap[:] = separations.same[:] = np.nan
            separations.shared[:] = np.where(complete, 0, UNDETERMINED)
    if scene.measures.ordering:
        order = empty_orders(size)
        run(find_order, lambda: (workspace(particles), empty_turns(particles)), order)
    return separations, order


def _error_bounds(batch: Batch, tolerance: Array, scene: Scene, workers: Workers) -> Trust:
    bounds = empty_trust(tolerance.size * scene.particles)

    def task(first: int, last: int) -> None:
        trust(first, last, batch, tolerance, scene.budget, bounds)

    workers.run(task, bounds.until.size, TRAJECTORIES_PER_TASK // 64, bounds)
    return bounds


def find_equal(
    problem: Dimensionless, launch: Launches, *others: Array
) -> NDArray[np.int64] | None:
    """Return the index of the first equal realization for each one; None if all are distinct.

    `others` are further arrays of shape (realization,) that have to agree.  The problem must be
    without noise.
    """
    known = [values for values in problem if isinstance(values, np.ndarray)]
    if any(map(_all_differ, known)):  # as in most designs that draw values
        return None
    columns = np.stack([*known, *others])
    first = np.empty(columns.shape[1], np.int64)
    return first if first_of_each(columns, launch, first) < first.size else None


def _all_differ(column: Array) -> bool:
    ordered = np.sort(column)  # np.unique would import the masked arrays
    return bool(np.all(ordered[1:] != ordered[:-1]))


def _repeated(found: Followed, source: NDArray[np.intp], scene: Scene) -> Followed:
    """Copy the results of distinct realizations to all their duplicates."""
    particles = source[:, np.newaxis] * scene.particles + np.arange(scene.particles)

    def copied(values: Any, places: NDArray[np.intp]) -> Any:
        if values is None:
            return None
        arrays = (v.take(places, -1) if isinstance(v, np.ndarray) else v for v in values)
        return type(values)(*arrays)

    return Followed(
        copied(found.trajectories, particles.ravel()),
        copied(found.realizations, source),
        copied(found.orbits, particles.ravel()),
        copied(found.separations, source),
        copied(found.order, source),
        copied(found.bounds, particles.ravel()),
    )
