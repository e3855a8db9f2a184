"""Methods compiled by numba and shared among threads: the kernel, the naive map, RK4."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

import numpy as np
from numba import njit

from methods.scenes import Point, Scene, table
from methods.sweeps import Sweep
from methods.timing import BUDGET, timed
from methods.truth import Orbit, worst
from study.rk4 import rk4
from vibrosweep.engine.landings import record_landings
from vibrosweep.engine.trajectories import statistics
from vibrosweep.engine.workers import TRAJECTORIES_PER_TASK, Workers
from vibrosweep.kernels import bases
from vibrosweep.kernels.impact import Batch, base_of, impact, launch, launch_speed
from vibrosweep.kernels.statistics import Statistics, empty_statistics
from vibrosweep.model.parameters import Dimensionless, Launches, dimensionless, launches
from vibrosweep.scene.scene import Scene as Watched

MARGIN = 1.0  # s past the end, so that a late landing is compared rather than missed
MOST_IMPACTS = 10_000_000
MOST_RECORDED = 8_000_000  # landings in memory

KERNEL = "kernel"
KERNEL_RECORD = "kernel, every landing"
KERNEL_STATE = "kernel, state"
NAIVE = "naive map"
RK4 = "RK4"


def _observation(scene: Scene, launch_times: np.ndarray) -> Watched:
    times = tuple(launch_times.tolist())
    watched = Watched(len(times), times, scene.duration, scene.rebound, base=scene.base)
    return watched.recorded(MOST_IMPACTS)


def _arrays(scene: Scene) -> dict[str, np.ndarray]:
    return {name: np.array([value]) for name, value in scene.parameters.items()}


def _problem(scene: Scene, launch_times: np.ndarray) -> tuple[Dimensionless, Launches]:
    arrays = _arrays(scene)
    lanes = launches(tuple(launch_times.tolist()), launch_times.size, arrays["frequency"])
    return dimensionless(arrays, scene.duration), lanes


def stream(scene: Scene, launch_times: np.ndarray, workers: Workers) -> Statistics:
    """Statistics of every trajectory by the streaming kernel."""
    observation = _observation(scene, launch_times)
    return statistics(*_problem(scene, launch_times), observation, workers)


def every_landing(scene: Scene, launch_times: np.ndarray, workers: Workers) -> dict:
    """Every landing, as `vibrosweep.simulate` computes them."""
    return record_landings(_arrays(scene), _observation(scene, launch_times), workers)


@njit(nogil=True, error_model="numpy")
def _phases(batch, counts, phases):
    """The orbit of a record before it is rounded to one time: whole periods and phase."""
    problem = batch.problem
    fixed = bases.constants(batch.base, problem, 0)
    for p in range(counts.shape[0]):
        n, x = launch(batch.launches, 0, p, problem.phase[0])
        u = launch_speed(fixed, problem, 0, x)
        for k in range(counts.shape[1]):
            hit = impact(fixed, n, x, u)
            counts[p, k], phases[p, k] = hit.n, hit.x
            n, x, u = hit.n_off, hit.x_off, hit.u


def kernel_phases(scene: Scene, impacts: int) -> tuple[np.ndarray, np.ndarray]:
    """Whole periods and phases of the sample's landings; shape (trajectory, impact)."""
    batch = Batch(base_of(scene.base, scene.rebound), *_problem(scene, scene.sample))
    counts, phases = np.empty((2, scene.proved, impacts))
    _phases(batch, counts, phases)
    return counts, phases


def _require_one_orbit(scene, orbits, workers, counts, phases) -> list[np.ndarray]:
    """Landing times of the sample, after checking that all ways of running the kernel agree."""
    found = every_landing(scene, scene.sample, workers)
    streamed = stream(scene, scene.sample, workers)
    times = found["landing_time"][0]
    fastest = streamed.total("height_max")
    unit = scene.parameters["gravity"] / (2.0 * scene.parameters["frequency"])
    fastest_rebound = np.nanmax(found["rebound_velocity"][0], axis=1)
    sizes = [orbit.size for orbit in orbits]
    same = (
        np.array_equal(streamed.landings, found["impact_count"][0])
        and (scene.base == "moving" or np.array_equal(fastest * unit, fastest_rebound))
        and sizes == streamed.landings.tolist()
        and all(np.array_equal((counts + phases)[i, :n], times[i, :n]) for i, n in enumerate(sizes))
    )
    if not same:
        raise RuntimeError(f"scene {scene.key}: the kernel's ways of running it disagree")
    return list(times)


def kernel(scene: Scene, orbits: list[Orbit], threads: int) -> Iterator[Point]:
    """The package: streaming on one and on all threads, and with every landing kept."""
    longest = max(orbit.size for orbit in orbits)
    counts, phases = kernel_phases(scene, longest)
    with Workers(threads) as workers, Workers(1) as alone:
        times = _require_one_orbit(scene, orbits, workers, counts, phases)
        error, _ = worst(orbits, times)
        batch = scene.batch
        problem, lanes = _problem(scene, batch)
        observation = _observation(scene, batch)
        impacts = int(stream(scene, batch, workers).landings.sum())
        for crew in (alone, workers):
            _, seconds = timed(lambda crew=crew: statistics(problem, lanes, observation, crew))
            run = ("streaming", crew.threads, batch.size, impacts, seconds)
            yield Point(scene.key, KERNEL, *run, error, "error of the same orbits as recorded")
        state = _state_error(orbits, counts, phases)
        yield Point(scene.key, KERNEL_STATE, *run, state, "before rounding to one double")
        few = batch[:: -(-impacts // MOST_RECORDED)]
        found, seconds = timed(lambda: every_landing(scene, few, workers))
        kept = int(found["impact_count"].sum())
        yield Point(
            scene.key, KERNEL_RECORD, "all recorded", threads, few.size, kept, seconds, error
        )


def _state_error(orbits: list[Orbit], counts: np.ndarray, phases: np.ndarray) -> float:
    return max(
        float(orbit.errors(count[: orbit.size], phase[: orbit.size]).max())
        for orbit, count, phase in zip(orbits, counts, phases, strict=True)
    )


@njit(nogil=True, error_model="numpy")
def naive_trajectories(first, last, table, duration, reflect, times, out):
    """One trajectory after the other: a running time, and the library's sine of omega t."""
    for i in range(first, last):
        e, amplitude, frequency, phi = table[i, 0], table[i, 1], table[i, 2], table[i, 3]
        gravity, v, contact, t = table[i, 4], table[i, 5], table[i, 6], table[i, 7]
        omega, rest = 2.0 * math.pi * frequency, 0.5 * gravity * contact
        landings, rests, total, squares, largest = 0, 0, 0.0, 0.0, 0.0
        while True:
            flight = 2.0 * v / gravity
            t += flight
            if t > duration:
                break
            if times is not None:
                if landings == times.shape[1]:
                    break
                times[i, landings] = t
            landings += 1
            w = e * v + amplitude * math.sin(omega * t + phi)
            if reflect is not None:
                w = abs(w)
            if w > rest:
                v = w
            else:
                rests += 1
                turns = frequency * t + phi / (2.0 * math.pi)
                wait = math.asin(rest / amplitude) / (2.0 * math.pi) - (turns - math.floor(turns))
                t += (wait if wait >= 0.0 else wait + 1.0) / frequency
                v = rest
            total += v
            squares += v * v
            largest = max(largest, v)
        for k, value in enumerate((landings, rests, total, squares, largest)):
            out.totals[k, i] = value


def count_landings(rows: np.ndarray, duration: float, reflect: int | None) -> np.ndarray:
    """Landings of the trajectories of a table, by the naive map."""
    out = empty_statistics(len(rows))
    naive_trajectories(0, len(rows), rows, duration, reflect, None, out)
    return out.landings


def naive(scene: Scene | Sweep, orbits: list[Orbit], threads: int) -> Iterator[Point]:
    """The same map with a running double t and sin(omega t + phi)."""
    sample = table(scene.cases)
    times = np.full((len(sample), max(orbit.size for orbit in orbits)), np.nan)
    end = scene.duration + MARGIN
    seen = empty_statistics(len(sample))
    naive_trajectories(0, len(sample), sample, end, scene.reflect, times, seen)
    error, note = worst(orbits, list(times))
    rows, out = scene.table, empty_statistics(scene.lanes)
    with Workers(threads) as workers:

        def run() -> None:
            workers.each(
                lambda a, b: naive_trajectories(
                    a, b, rows, scene.duration, scene.reflect, None, out
                ),
                scene.lanes,
                min(TRAJECTORIES_PER_TASK, -(-scene.lanes // (4 * threads))),
            )

        run()
        _, seconds = timed(run)
    impacts = int(out.landings.sum())
    yield Point(scene.key, NAIVE, "streaming", threads, scene.lanes, impacts, seconds, error, note)


def fixed_step(scene: Scene, orbits: list[Orbit], threads: int) -> Iterator[Point]:
    """The study's scheme, at every step of the scene; coarse steps first."""
    longest = max(orbit.size for orbit in orbits)

    def run(step: float, launch_times: np.ndarray, duration: float, capacity: int):
        return rk4(
            **scene.parameters, launch_time=launch_times, duration=duration, step=step,
            rebound=scene.rebound, capacity=capacity, threads=threads,
        )  # fmt: skip

    run(scene.steps[0], scene.sample, 1.0, 1)
    for step in scene.steps:
        began = time.perf_counter()
        found = run(step, scene.sample, scene.duration + MARGIN, longest)
        seconds = time.perf_counter() - began
        error, note = worst(orbits, list(found.landing_time))
        batch = scene.sample
        if seconds < BUDGET:
            wanted = int(scene.proved * BUDGET / (4.0 * seconds))
            batch = scene.batch[: max(scene.proved, min(scene.lanes, wanted))]
            _, seconds = timed(lambda step=step, batch=batch: run(step, batch, scene.duration, 1))
        with Workers(threads) as workers:
            impacts = int(stream(scene, batch, workers).landings.sum())
        yield Point(
            scene.key, RK4, f"{step:.0e} s", threads, batch.size, impacts, seconds, error, note,
            step=step,
        )  # fmt: skip
