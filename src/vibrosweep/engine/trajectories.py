"""Run the kernels on a batch of dimensionless problems, duplicates only once.

Each thread calls the compiled kernels on ranges of its own; results therefore depend neither on the
number of threads nor on how a sweep is cut into batches.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.engine.duplicates import find_equal
from vibrosweep.engine.observable_values import kinds_of
from vibrosweep.engine.workers import TRAJECTORIES_PER_TASK, Workers
from vibrosweep.kernels import growth
from vibrosweep.kernels._jit import Floats
from vibrosweep.kernels.advance import Options, Share, advance, advance_uncached, memory_around
from vibrosweep.kernels.bases import Base, fitted
from vibrosweep.kernels.cycles import Cycles, empty_rests, no_cycles
from vibrosweep.kernels.impact import Batch, base_of
from vibrosweep.kernels.noise import noise_of
from vibrosweep.kernels.observer import Observer, observer_scratch
from vibrosweep.kernels.ordering import workspace
from vibrosweep.kernels.recorder import KINDS_RECORDED, Recorder, recorder_scratch
from vibrosweep.kernels.separation import Separations, empty_separations, separate
from vibrosweep.kernels.settle import Search, settle
from vibrosweep.kernels.settled import Orbits, empty_orbits
from vibrosweep.kernels.statistics import KINDS, Kinds, Statistics, empty_sums
from vibrosweep.kernels.totals import combine, scratch
from vibrosweep.kernels.trust import Trust, empty_trust, trust
from vibrosweep.kernels.unwritten import require_written
from vibrosweep.model.measures import UNDETERMINED
from vibrosweep.model.parameters import Dimensionless, Launches, taken
from vibrosweep.model.status import Status
from vibrosweep.scene.scene import Scene

# In fewer periods hardly any orbit repeats early enough for cycle detection to save time.
PERIODS_TO_RECUR = 32.0


def base_in(scene: Scene, problem: Dimensionless) -> Base:
    """Base of a scene, as kernels take it, with the noise of the problem."""
    noise = noise_of(problem.noise, scene.noise_seed)
    return base_of(*scene.mechanics, noise)


@dataclass(frozen=True)
class Followed:
    """Results of a batch of trajectories, in forcing periods; None for what was not requested."""

    # Statistics of trajectories, ordered by realization, in memory that the workers reuse for the
    # next batch.  Only for measures per particle.
    each: Statistics | None
    whole: Statistics  # of the realizations
    orbits: Orbits | None  # orbits that the trajectories settle on
    separations: Separations | None  # of the realizations
    bounds: Trust | None  # of the trajectories


def follow(
    problem: Dimensionless,
    launch: Launches,
    tolerance: Array,
    scene: Scene,
    workers: Workers,
) -> Followed:
    """Simulate all trajectories of a batch, duplicate realizations only once.

    `tolerance` is the largest error of a trusted landing time in forcing periods, shape
    (realization,).
    """
    others = [tolerance] if scene.measures.trust else []
    looked_for = scene.skip and problem.noise is None
    first = find_equal(problem, launch, *others) if looked_for else None
    if first is None:
        return _follow(problem, launch, tolerance, scene, workers)
    chosen = np.flatnonzero(first == np.arange(first.size))
    place = np.empty_like(first)
    place[chosen] = np.arange(chosen.size)
    found = _follow(
        taken(problem, chosen),
        _launches_of(launch, chosen),
        tolerance[chosen],
        scene,
        workers,
    )
    return _repeated(found, place[first], scene)


def _follow(
    problem: Dimensionless,
    launch: Launches,
    tolerance: Array,
    scene: Scene,
    workers: Workers,
) -> Followed:
    size, particles = tolerance.size, scene.particles
    measures, cycles = scene.measures, None
    looked_for = measures.regimes or (scene.skip and _lasts(problem, launch, PERIODS_TO_RECUR))
    if looked_for and problem.noise is None:  # random motion never recurs
        cycles = workers.cycles(size * particles)
    each = statistics(problem, launch, scene, workers, cycles)
    whole = empty_sums(size, each.kinds)
    workers.each(
        lambda first, last: combine(first, last, particles, each, whole),
        size,
        max(1, 2 * TRAJECTORIES_PER_TASK // particles),
        whole,
    )
    orbits = separations = bounds = None
    if measures.regimes:
        found = no_cycles(size * particles) if cycles is None else cycles
        orbits = _orbits(problem, launch, each, found, scene, workers)
    if measures.separation:
        separations = _separations(problem, launch, scene, whole, cycles, workers)
    if measures.trust:
        bounds = _error_bounds(problem, launch, tolerance, scene, workers)
    keeps = measures.per_particle or measures.observables
    return Followed(each if keeps else None, whole, orbits, separations, bounds)


def statistics(
    problem: Dimensionless,
    launch: Launches,
    scene: Scene,
    workers: Workers,
    cycles: Cycles | None = None,
    observer: Observer | Recorder | None = None,
    more: Kinds = (),
) -> Statistics:
    """Statistics of every trajectory, and `more`, ordered by realization, then by particle.

    The result is in memory that the workers reuse for the next batch.  If `cycles` is given, it is
    filled, and simulation of a trajectory stops where it recurs.  An `observer`, which sees every
    landing, takes no cycles.
    """
    total = problem.kick.size * scene.particles
    kernel, kinds = advance, (*KINDS, *kinds_of(scene), *more)
    block: Callable[[], Floats] = partial(scratch, kinds)
    if isinstance(observer, Recorder):
        kinds, block = KINDS_RECORDED, recorder_scratch
    elif observer is not None:
        kernel, kinds, block = advance_uncached, KINDS, observer_scratch
    each = workers.statistics(total, kinds)
    window = 1 if scene.windowed else None  # another code for each
    base = fitted(base_in(scene, problem), problem)
    batch = Batch(base, problem, launch)
    options = Options(
        scene.budget,
        PERIODS_TO_RECUR,
        int(scene.measures.regimes),
        int(scene.skip),
        observer,
    )

    def begin() -> Callable[[int, int], None]:
        memory = memory_around(block())
        rests = None if cycles is None else empty_rests(each.kinds)
        lanes = 0

        def task(first: int, last: int) -> None:
            nonlocal lanes
            share = Share(first, last, lanes)
            lanes = kernel(share, batch, options, window, memory, each, cycles, rests)

        return task

    workers.stream(begin, total)
    require_written(each, ("at_rest", "status"))  # totals are written with them
    return each


def settled(problem: Dimensionless, launch: Launches, scene: Scene, workers: Workers) -> Orbits:
    """Orbit that each trajectory settles on, ordered by realization, then by particle.

    Arguments are those of `statistics`.
    """
    cycles = workers.cycles(problem.kick.size * scene.particles)
    each = statistics(problem, launch, scene, workers, cycles)
    return _orbits(problem, launch, each, cycles, scene, workers)


def _orbits(
    problem: Dimensionless,
    launch: Launches,
    each: Statistics,
    cycles: Cycles,
    scene: Scene,
    workers: Workers,
) -> Orbits:
    orbits = empty_orbits(each.status.size)

    batch = Batch(base_in(scene, problem), problem, launch)
    search = Search(scene.budget, int(scene.measures.lyapunov))
    plain = each._replace(kinds=())  # one machine code, whatever statistics are chosen

    def task(first: int, last: int) -> None:
        settle(first, last, batch, plain, cycles, search, np.empty(growth.SIZE), orbits)

    workers.each(task, each.status.size, TRAJECTORIES_PER_TASK // 64, orbits)
    return orbits


def _lasts(problem: Dimensionless, launch: Launches, periods: float) -> bool:
    """Return whether any trajectory may last for more than this many periods."""
    return bool(np.max(problem.end_count) - np.min(launch.whole) + 2.0 > periods)


def _separations(
    problem: Dimensionless,
    launch: Launches,
    scene: Scene,
    whole: Statistics,
    cycles: Cycles | None,
    workers: Workers,
) -> Separations:
    size, particles = problem.kick.size, scene.particles
    found = empty_separations(size)
    if particles == 1:  # a single particle has no separations
        found.gap[:] = found.same[:] = np.nan
        found.shared[:] = np.where(whole.status == Status.COMPLETED, 0, UNDETERMINED)
        return found
    complete = whole.status == Status.COMPLETED
    known = cycles if cycles is not None and scene.skip else workers.cycles(0)
    batch = Batch(base_in(scene, problem), problem, launch)
    # costly to allocate
    workspaces = [workspace(particles) for _ in range(min(size, workers.threads))]

    def task(first: int, last: int) -> None:
        work = workspaces.pop()
        separate(first, last, batch, complete, scene.budget, work, known, found)
        workspaces.append(work)

    per_task = max(1, TRAJECTORIES_PER_TASK // (32 * particles))
    workers.each(task, size, per_task, found)
    return found


def _error_bounds(
    problem: Dimensionless,
    launch: Launches,
    tolerance: Array,
    scene: Scene,
    workers: Workers,
) -> Trust:
    bounds = empty_trust(tolerance.size * scene.particles)

    batch = Batch(base_in(scene, problem), problem, launch)

    def task(first: int, last: int) -> None:
        trust(first, last, batch, tolerance, scene.budget, bounds)

    workers.each(task, bounds.until.size, TRAJECTORIES_PER_TASK // 64, bounds)
    return bounds


def _launches_of(launch: Launches, which: NDArray[Any]) -> Launches:
    """Launches of some realizations; unchanged if all realizations share theirs."""
    if launch.whole.shape[0] == 1:
        return launch
    return Launches._make(values[which] for values in launch)


def _repeated(found: Followed, source: NDArray[np.intp], scene: Scene) -> Followed:
    """Copy the results of distinct realizations to all their duplicates."""

    def repeated(values: Any, places: NDArray[np.intp]) -> Any:
        if values is None:
            return None
        arrays = (v[..., places] if isinstance(v, np.ndarray) else v for v in values)
        return type(values)(*arrays)

    first = source[:, np.newaxis] * scene.particles
    each = (first + np.arange(scene.particles)).ravel()
    return Followed(
        repeated(found.each, each),
        repeated(found.whole, source),
        repeated(found.orbits, each),
        repeated(found.separations, source),
        repeated(found.bounds, each),
    )
