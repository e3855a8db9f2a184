"""Methods compiled by numba and shared among threads: the kernel, the naive map, RK4."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from numba import njit

from methods.scenes import STEPS, Point, Scene, Sweep, table
from methods.timing import timed
from moving_loops import scalar_moving
from study.rk4 import rk4
from vibrosweep.engine.landings import record_landings
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import TRAJECTORIES_PER_TASK, Workers
from vibrosweep.kernels.statistics import empty_statistics
from vibrosweep.model.parameters import (
    PARAMETERS,
    STREAM,
    Dimensionless,
    Launches,
    dimensionless,
    launches,
)
from vibrosweep.proof.sampling import deviates_of
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


# The moving base as a scalar loop: the kernel's search for a landing, with the library's sine.

SCALAR = "scalar loop"


def _given(rows: np.ndarray, duration: float) -> tuple[Dimensionless, Launches]:
    """Rows of `table`, each a realization with one particle."""
    arrays = dict(zip(PARAMETERS, np.ascontiguousarray(rows.T), strict=False))
    start = [launches((t,), 1, arrays["frequency"][:1]) for t in rows[:, -1].tolist()]
    return dimensionless(arrays, duration), Launches(
        np.concatenate([each.whole for each in start]),
        np.concatenate([each.phase for each in start]),
    )


def _room(trajectories: int) -> tuple[np.ndarray, ...]:
    counts = (np.zeros(trajectories, np.int64) for _ in range(2))
    return (*counts, np.zeros(trajectories), np.zeros(trajectories))


def count_moving_landings(rows: np.ndarray, duration: float, reflect: None) -> np.ndarray:
    """Landings of the trajectories of a table; all times are in periods, which last 1 s here."""
    out = _room(len(rows))
    scalar_moving(0, len(rows), *_given(rows, duration), duration, None, out)
    return out[0]


def scalar(scene: Scene, sizes: list[int], threads: int) -> Iterator[Point]:
    """The kernel's search, one flight after the other."""
    sample = table(scene.cases)
    times = np.full((len(sample), max(sizes)), np.nan)
    end = scene.duration + MARGIN
    scalar_moving(0, len(sample), *_given(sample, end), end, times, _room(len(sample)))
    problem, start = _given(scene.table, scene.duration)
    out = _room(scene.lanes)
    task = min(TRAJECTORIES_PER_TASK, -(-scene.lanes // (4 * threads)))
    with Workers(threads) as workers:

        def run() -> None:
            workers.run(
                lambda a, b: scalar_moving(a, b, problem, start, scene.duration, None, out),
                scene.lanes,
                task,
            )

        run()
        _, seconds = timed(run, threads)
    impacts = int(out[0].sum())
    run_of = (threads, scene.lanes, impacts, seconds, list(times))
    yield Point(scene.key, SCALAR, "streaming", *run_of)


# The map under two tones, or with noise of the kick, as a scalar loop of plain numba.  Rests are
# left out: the scenes have none.  Random numbers are read from the stored stream.

ROOM = 20  # landings past the last one that is compared
COPIES = 200


@njit(nogil=True, error_model="numpy")
def _trajectories(rows, tones, push, deviates, duration, times, speeds):
    """Compute the landings of each row up to the end; return their number, -1 after a rest."""
    landings = 0
    for i in range(rows.shape[0]):
        e, amplitude, frequency, phi = rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3]
        gravity, v, contact, t = rows[i, 4], rows[i, 5], rows[i, 6], rows[i, 7]
        omega, rest, j = 2.0 * math.pi * frequency, 0.5 * gravity * contact, i % deviates.shape[0]
        for n in range(deviates.shape[1]):
            t += 2.0 * v / gravity
            if t > duration:
                break
            times[j, n] = t
            landings += 1
            angle, shape = omega * t + phi, 0.0
            for k in range(tones.shape[0]):
                shape += tones[k, 1] * math.sin(tones[k, 0] * angle + tones[k, 2])
            v = abs(e * v + amplitude * shape + (1.0 + e) * push * deviates[j, n])
            if v <= rest:
                return -1
            speeds[i] += v
    return landings


def shaken(scene: Scene, sizes: list[int], threads: int) -> Iterator[Point]:
    """A running time, the library's sine, random numbers from memory; one thread."""
    sample, push = table(scene.cases), scene.parameters.get("kick_noise", 0.0)
    tones = np.array(scene.waveform.tones or ((1, 1.0, 0.0),), dtype=np.float64)
    shape = (scene.proved, max(sizes) + ROOM)
    of = [deviates_of(0, 0.0, particle).of_impact for particle in range(scene.proved)]
    deviates = np.array([[drawn(n)[1] for n in range(shape[1])] for drawn in of])
    times, rows = np.full(shape, np.nan), np.tile(sample, (COPIES, 1))
    speeds = np.zeros(len(rows))
    _trajectories(sample, tones, push, deviates, scene.duration + MARGIN, times, speeds)

    def run() -> int:
        return _trajectories(rows, tones, push, deviates, scene.duration, np.empty(shape), speeds)

    landings, seconds = timed(run)
    if landings < 0:
        raise NotImplementedError(f"scene {scene.key}: a rest, which this loop leaves out")
    yield Point(scene.key, NAIVE, "streaming", 1, len(rows), landings, seconds, list(times))
