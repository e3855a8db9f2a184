"""Methods compiled by numba and shared among threads: the kernel, the naive map, RK4."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from numba import njit

from methods.scenes import STEPS, Point, Scene, table
from methods.sweeps import Sweep
from methods.timing import timed
from study.rk4 import rk4
from vibrosweep.engine.landings import record_landings
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import TRAJECTORIES_PER_TASK, Workers
from vibrosweep.kernels.statistics import empty_statistics
from vibrosweep.model.parameters import STREAM
from vibrosweep.scene.scene import Scene as Watched

MARGIN = 1.0  # s past the end, so that a late landing is compared rather than missed
MOST_IMPACTS = 10_000_000
MOST_RECORDED = 8_000_000  # landings in memory

KERNEL = "kernel"
KERNEL_RECORD = "kernel, every landing"
NAIVE = "naive map"
RK4 = "RK4"


def _watched(scene: Scene, launch_times: np.ndarray) -> Watched:
    times = tuple(launch_times.tolist())
    shape = {"base": scene.base, "waveform": scene.waveform, "skip": False}
    watched = Watched(len(times), times, scene.duration, scene.rebound, **shape)
    return watched.recorded(MOST_IMPACTS)


def arrays(scene: Scene, realizations: int = 1) -> dict[str, np.ndarray]:
    """Parameters of realizations, all different because equal ones are computed only once."""
    found = {name: np.full(realizations, value) for name, value in scene.parameters.items()}
    found["amplitude"] *= 1.0 + 1e-9 * np.arange(realizations)
    return found | ({STREAM: np.zeros(realizations)} if "kick_noise" in found else {})


def streaming(scene: Scene, workers: Workers) -> Callable[[], int]:
    """A run of the streaming kernel over the whole batch, which returns the number of landings."""
    given, watched = arrays(scene, scene.realizations), _watched(scene, scene.batch)
    return lambda: int(measure(given, watched, workers)["impact_count"].sum())


def kernel(scene: Scene, sizes: list[int], threads: int) -> Iterator[Point]:
    """The package: statistics, and every landing recorded."""
    with Workers(threads) as workers:
        found = record_landings(arrays(scene), _watched(scene, scene.sample), workers)
        times, run = list(found["landing_time"][0]), streaming(scene, workers)
        run()
        impacts, seconds = timed(run, threads)
        lanes = scene.realizations * scene.lanes
        yield Point(
            scene.key, KERNEL, "streaming, skip = false", threads, lanes, impacts, seconds, times
        )
        few = _watched(scene, scene.batch[:: -(-impacts // MOST_RECORDED)])
        given = arrays(scene, scene.realizations)
        found, seconds = timed(lambda: record_landings(given, few, workers), threads)
        kept = found["impact_count"]
        run_of = (threads, kept.size, int(kept.sum()), seconds, times)
        yield Point(scene.key, KERNEL_RECORD, "all recorded", *run_of)


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
        for k, value in enumerate((float(landings), float(rests), total, squares, largest)):
            out.totals[k, i] = value


def count_landings(rows: np.ndarray, duration: float, reflect: int | None) -> np.ndarray:
    """Landings of the trajectories of a table, by the naive map."""
    out = empty_statistics(len(rows))
    naive_trajectories(0, len(rows), rows, duration, reflect, None, out)
    return out.landings


def naive(scene: Scene | Sweep, sizes: list[int], threads: int) -> Iterator[Point]:
    """The map with a running double t and sin(omega t + phi)."""
    sample = table(scene.cases)
    times = np.full((len(sample), max(sizes)), np.nan)
    end = scene.duration + MARGIN
    seen = empty_statistics(len(sample))
    naive_trajectories(0, len(sample), sample, end, scene.reflect, times, seen)
    rows, out = scene.table, empty_statistics(scene.lanes)
    with Workers(threads) as workers:

        def run() -> None:
            workers.run(
                lambda a, b: naive_trajectories(
                    a, b, rows, scene.duration, scene.reflect, None, out
                ),
                scene.lanes,
                min(TRAJECTORIES_PER_TASK, -(-scene.lanes // (4 * threads))),
            )

        run()
        _, seconds = timed(run, threads)
    impacts = int(out.landings.sum())
    run_of = (threads, scene.lanes, impacts, seconds, list(times))
    yield Point(scene.key, NAIVE, "streaming", *run_of)


def fixed_step(scene: Scene, sizes: list[int], threads: int) -> Iterator[Point]:
    """The study's scheme, at every step of the scene; coarse steps first."""

    def run(step: float, launch_times: np.ndarray, duration: float, capacity: int):
        return rk4(
            **scene.parameters, launch_time=launch_times, duration=duration, step=step,
            rebound=scene.rebound, capacity=capacity, threads=threads,
        )  # fmt: skip

    run(STEPS[0], scene.sample, 1.0, 1)
    for step in STEPS:
        found, seconds = timed(
            lambda step=step: run(step, scene.sample, scene.duration + MARGIN, max(sizes)), threads
        )
        times = list(found.landing_time)
        run_of = (threads, scene.proved, sum(sizes), seconds, times)
        yield Point(scene.key, RK4, f"step {step:.0e} s", *run_of)
