"""A batch of realizations through the kernels: parameters in, measured variables out.

Threads call the compiled kernels, which release the interpreter, on ranges that are theirs alone;
results therefore do not depend on the number of threads, nor on how a sweep is cut into batches.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels.advance import Statistics, advance, empty_statistics
from vibrosweep.kernels.combine import combine
from vibrosweep.kernels.cycles import Cycles, empty_cycles
from vibrosweep.kernels.lanes import scratch
from vibrosweep.kernels.separation import separate, workspace
from vibrosweep.kernels.trust import empty_trust, trust
from vibrosweep.scene import Dimensionless, Launches, dimensionless, launches
from vibrosweep.status import Status
from vibrosweep.sweep.regimes import regimes
from vibrosweep.variables import UNDETERMINED

__all__ = ["Observation", "Workers", "measure", "statistics"]

Array = NDArray[np.float64]
Measured = dict[str, NDArray[Any]]

TRAJECTORIES_PER_TASK = 16384


@dataclass(frozen=True)
class Observation:
    """What is launched, how long it is watched and what is measured.

    Attributes
    ----------
    particles
        Number of particles per realization.
    launch
        ``"staggered"`` or the launch times of all particles in s.
    duration
        End of the observation in s.
    rebound
        ``"rest"`` or ``"reflect"``.
    transient
        Beginning of the window that measures cover, in s.
    separation
        Whether separations between particles are measured.
    per_particle
        Whether measures are kept for each particle.
    regimes
        Whether orbits that repeat exactly are recognised; they are then not followed any further.
    trust
        Whether an error bound is carried along each trajectory.
    tolerance
        Error of a landing time in s up to which it is trusted.
    impact_budget
        Impacts after which a particle is given up.
    """

    particles: int
    launch: str | tuple[float, ...]
    duration: float
    rebound: str
    transient: float
    separation: bool
    per_particle: bool
    regimes: bool
    trust: bool
    tolerance: float
    impact_budget: int

    @property
    def reflect(self) -> int | None:
        """The rebound law as the kernels take it."""
        return 1 if self.rebound == "reflect" else None

    @property
    def window(self) -> int | None:
        """1 where landings before the window are possible, else None: kernels compile that out."""
        starts_late = self.transient > 0.0
        early_launch = not isinstance(self.launch, str) and min(self.launch) < self.transient
        return 1 if starts_late or early_launch else None


class Workers:
    """A pool of threads for kernels; a context manager.

    Parameters
    ----------
    threads
        Number of threads, at least 1.
    """

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._pool = ThreadPoolExecutor(threads)
        self._room = empty_statistics(0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *exception: object) -> None:
        # a running kernel cannot be stopped: after an interruption nobody waits for it
        self._pool.shutdown(wait=kind is None, cancel_futures=True)

    def room(self, trajectories: int) -> Statistics:
        """Memory for statistics, the same at each call: fresh pages cost a third of a sweep."""
        if self._room.status.size < trajectories:
            self._room = empty_statistics(trajectories)
        return Statistics._make(values[:trajectories] for values in self._room)

    def each(self, task: Callable[[int, int], object], total: int, size: int) -> None:
        """Call ``task(first, last)`` for ranges of at most `size` that cover ``range(total)``."""
        size = max(1, min(size, -(-total // self.threads)))
        starts = range(0, total, size)
        for _ in self._pool.map(lambda first: task(first, min(first + size, total)), starts):
            pass


def statistics(
    problem: Dimensionless,
    launch: Launches,
    observation: Observation,
    workers: Workers,
    cycles: Cycles | None = None,
) -> Statistics:
    """Statistics of every trajectory, in the order of realizations and within them of particles.

    They stand in the workers' `Workers.room` until its next use.  Where `cycles` are given, they
    are written, and trajectories that recur are followed no further.
    """
    total = problem.kick.size * observation.particles
    each = workers.room(total)

    def task(first: int, last: int) -> None:
        advance(
            first,
            last,
            problem,
            launch,
            observation.impact_budget,
            observation.reflect,
            observation.window,
            scratch(),
            each,
            cycles,
        )

    workers.each(task, total, TRAJECTORIES_PER_TASK)
    return each


def measure(
    parameters: Mapping[str, Array], observation: Observation, workers: Workers
) -> Measured:
    """Advance a batch of realizations and measure them.

    Parameters
    ----------
    parameters
        Every parameter of `vibrosweep.scene.PARAMETERS`, each of shape (realization,).
    observation
        What is watched and measured.
    workers
        Threads to use.

    Returns
    -------
    dict
        Arrays of shape (realization,), and (realization, particle) for measures per particle,
        named as in `vibrosweep.variables`.

    Raises
    ------
    ParameterError
        Parameters leave the range in which periods can be counted exactly.
    """
    problem = dimensionless(parameters, observation.duration, observation.transient)
    launch = launches(observation.launch, observation.particles, parameters["frequency"])
    size, particles = problem.kick.size, observation.particles
    cycles = empty_cycles(size * particles) if observation.regimes else None
    each = statistics(problem, launch, observation, workers, cycles)
    whole = empty_statistics(size)
    workers.each(
        lambda first, last: combine(first, last, particles, each, whole),
        size,
        max(1, 8 * TRAJECTORIES_PER_TASK // particles),
    )
    measured = _physical(whole, parameters, problem)
    measured["at_rest_count"] = whole.at_rest
    with np.errstate(over="ignore"):
        launch_height = parameters["launch_velocity"] ** 2 / (2.0 * parameters["gravity"])
    launched = _launch_in_window(observation, parameters["frequency"])
    measured["flight_height_max"] = np.fmax(
        measured["rebound_height_max"], np.where(launched, launch_height, np.nan)
    )
    if observation.per_particle:
        measured |= _per_particle(each, parameters, problem, (size, particles))
    if cycles is not None:
        measured |= regimes(each, cycles, problem, parameters["frequency"])
    if observation.separation:
        complete = whole.status == Status.COMPLETED
        if cycles is not None:
            complete &= _within_budget(cycles, size, observation.impact_budget)
        measured |= _separations(problem, launch, observation, complete, parameters, workers)
    if observation.trust:
        measured |= _error_bounds(problem, launch, observation, parameters, workers)
    return measured


def _physical(
    found: Statistics, parameters: Mapping[str, Array], problem: Dimensionless
) -> Measured:
    """Statistics of flights in physical units; arrays of the shape of the parameters."""
    frequency = parameters["frequency"]
    # height of a flight that lasts one forcing period: g / (8 f^2)
    height = parameters["gravity"] / (8.0 * frequency * frequency)
    # where nothing lifts a resting particle, its last landing is followed by no flight
    lifts = problem.kick > problem.rest_flight
    flights = found.landings - np.where(lifts, 0, found.rests)
    some = flights > 0
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        # one NaN for all: that of 0 / 0 has a sign which depends on the length of the batch
        return {
            "impact_count": found.landings,
            "rest_count": found.rests,
            "rebound_height_mean": np.where(
                some, height * (found.flight_squares / flights), np.nan
            ),
            "rebound_height_max": np.where(
                some, height * (found.flight_max * found.flight_max), np.nan
            ),
            "flight_time_mean": np.where(some, found.flight_sum / flights / frequency, np.nan),
            "status": found.status,
        }


def _per_particle(
    each: Statistics,
    parameters: Mapping[str, Array],
    problem: Dimensionless,
    shape: tuple[int, int],
) -> Measured:
    repeated = {name: np.repeat(parameters[name], shape[1]) for name in ("frequency", "gravity")}
    lanes = problem._replace(
        kick=np.repeat(problem.kick, shape[1]), rest_flight=np.repeat(problem.rest_flight, shape[1])
    )
    measured = _physical(each, repeated, lanes)
    measured["at_rest"] = each.at_rest.astype(np.int8)
    # a copy: `each` is written over by the next batch
    return {f"particle_{name}": values.reshape(shape).copy() for name, values in measured.items()}


def _launch_in_window(observation: Observation, frequency: Array) -> NDArray[np.bool_]:
    """Whether any particle of a realization is launched inside the window; shape (realization,)."""
    begin, end = observation.transient, observation.duration
    if isinstance(observation.launch, str):
        per_second = observation.particles * frequency
        first = np.maximum(np.ceil(per_second * begin), 0.0)
        return np.asarray((first < observation.particles) & (first <= per_second * end))
    inside = any(begin <= time <= end for time in observation.launch)
    return np.full(frequency.shape, inside)


def _within_budget(cycles: Cycles, size: int, budget: int) -> NDArray[np.bool_]:
    """Whether all landings of a realization can be followed; shape (realization,).

    Those of a cycle are counted to the end without being followed, however many they are.
    """
    periods = np.where(cycles.impacts > 0, -cycles.begin, 0.0)
    landings = periods / np.maximum(cycles.periods, 1) * cycles.impacts
    return np.asarray((landings <= budget).reshape(size, -1).all(axis=1))


def _separations(
    problem: Dimensionless,
    launch: Launches,
    observation: Observation,
    complete: NDArray[np.bool_],
    parameters: Mapping[str, Array],
    workers: Workers,
) -> Measured:
    size = problem.kick.size
    gap, same = np.empty(size), np.empty(size)
    shared = np.empty(size, np.int8)

    def task(first: int, last: int) -> None:
        work = workspace(observation.particles)
        separate(
            first,
            last,
            problem,
            launch,
            complete,
            observation.reflect,
            observation.window,
            work,
            gap,
            same,
            shared,
        )

    workers.each(task, size, max(1, TRAJECTORIES_PER_TASK // (16 * observation.particles)))
    return {
        "dt_min": gap / parameters["frequency"],
        "dt_min_same_index": same / parameters["frequency"],
        "base_shared": shared,
        "collision_free": np.where(shared == UNDETERMINED, shared, 1 - shared).astype(np.int8),
    }


def _error_bounds(
    problem: Dimensionless,
    launch: Launches,
    observation: Observation,
    parameters: Mapping[str, Array],
    workers: Workers,
) -> Measured:
    frequency, particles = parameters["frequency"], observation.particles
    bounds = empty_trust(frequency.size * particles)

    def task(first: int, last: int) -> None:
        trust(
            first,
            last,
            problem,
            launch,
            observation.tolerance * frequency,
            observation.impact_budget,
            observation.reflect,
            bounds,
        )

    workers.each(task, bounds.until.size, TRAJECTORIES_PER_TASK // 16)
    until = bounds.until.reshape(-1, particles) / frequency[:, np.newaxis]
    velocity = parameters["gravity"] / (2.0 * frequency)
    return {
        "trusted_until": np.where(until == np.inf, observation.duration, until),
        "landing_time_error": bounds.landing_error.reshape(-1, particles).max(axis=1) / frequency,
        "rebound_velocity_error": bounds.flight_error.reshape(-1, particles).max(axis=1) * velocity,
    }
