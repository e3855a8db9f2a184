"""A sweep by this package, and by plain numpy over all trajectories at once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from methods.compiled import MARGIN, MOST_IMPACTS
from methods.scenes import Point, Sweep, table
from methods.timing import timed
from vibrosweep.engine.landings import record_landings
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import Workers
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.scene.scene import Scene

STATISTICS = "vibrosweep, statistics"
NOTHING_SKIPPED = "vibrosweep, nothing skipped"
RECORD = "vibrosweep, every landing"
NUMPY = "numpy"

TRUSTED = 1e-3  # s; an orbit that is known less well is lost
BLOCK = 4096  # trajectories at once: their state and temporaries stay in the cache


def _observation(sweep: Sweep) -> Scene:
    return Scene(sweep.particles, "staggered", sweep.duration, sweep.rebound).recorded(MOST_IMPACTS)


def _some(sweep: Sweep, realizations: np.ndarray) -> dict[str, np.ndarray]:
    return {name: values[realizations] for name, values in sweep.arrays.items()}


def package(sweep: Sweep, sizes: list[int], threads: int) -> Iterator[Point]:
    """Statistics, the same without skipping anything, and every landing, by the package's calls."""
    realization, particle = np.divmod(sweep.chosen, sweep.particles)
    keep = _observation(sweep)
    with Workers(threads) as workers:
        found = record_landings(_some(sweep, realization), keep, workers)
        times = list(found["landing_time"][np.arange(realization.size), particle])
        counts = found["impact_count"].sum(axis=1)
        watch = keep.with_measures(transient=0.0, trust=True, tolerance=TRUSTED)
        until = measure(sweep.arrays, watch, workers)["trusted_until"]
        lost = int(np.count_nonzero(until < sweep.duration))
        note = f"{lost} of {sweep.lanes} orbits not trusted to {TRUSTED:g} s"
        for name, skip in ((STATISTICS, True), (NOTHING_SKIPPED, False)):
            watch = replace(keep.with_measures(transient=0.0), skip=skip)
            measure(sweep.arrays, watch, workers)
            measured, seconds = timed(
                lambda watch=watch: measure(sweep.arrays, watch, workers), threads
            )
            impacts = int(measured["impact_count"].sum())
            if not np.array_equal(measured["impact_count"][realization], counts):
                raise RuntimeError(f"{name}: its landings are not those that are recorded")
            yield Point(sweep.key, name, "", threads, sweep.lanes, impacts, seconds, times, note)
        few = np.arange(0, sweep.realizations, -(-impacts // 4_000_000))
        found, seconds = timed(lambda: record_landings(_some(sweep, few), keep, workers), threads)
    kept = int(found["impact_count"].sum())
    lanes = few.size * sweep.particles
    yield Point(sweep.key, RECORD, "", threads, lanes, kept, seconds, times, note)


def _numpy_block(rows: np.ndarray, duration: float, times: np.ndarray | None = None) -> int:
    """Statistics of a block of trajectories by the `rest` law; returns the number of landings.

    Trajectories that have ended leave the arrays, so that no work is done on them.
    """
    p = dict(zip(PARAMETERS, rows.T.copy(), strict=False))
    t, v, lane = rows[:, -1].copy(), p["launch_velocity"], np.arange(len(rows))
    total, largest = np.zeros(len(rows)), np.zeros(len(rows))
    landings = impact = 0
    while True:
        t = t + 2.0 * v / p["gravity"]
        here = t <= duration
        if not here.all():
            p = {name: values[here] for name, values in p.items()}
            t, v, lane = t[here], v[here], lane[here]
        if t.size == 0:
            return landings
        if times is not None:
            times[lane, impact] = t
        landings, impact = landings + t.size, impact + 1
        omega = 2.0 * np.pi * p["frequency"]
        angle = omega * t + p["phase"]
        v = p["restitution"] * v + p["amplitude"] * np.sin(angle)
        rest = 0.5 * p["gravity"] * p["contact_time"]
        rests = np.flatnonzero(v <= rest)
        if rests.size:
            wait = np.arcsin(rest[rests] / p["amplitude"][rests]) - angle[rests]
            t[rests] += np.mod(wait, 2.0 * np.pi) / omega[rests]
            v[rests] = rest[rests]
        total[lane] += v
        largest[lane] = np.maximum(largest[lane], v)


def vectorised(sweep: Sweep, sizes: list[int], threads: int) -> Iterator[Point]:
    """The map with a running time, one numpy operation after the other over a block."""
    sample = table(sweep.cases)
    times = np.full((len(sample), 2 * max(sizes) + 100), np.nan)
    _numpy_block(sample, sweep.duration + MARGIN, times)
    starts = range(0, sweep.lanes, BLOCK)
    landings, seconds = timed(
        lambda: sum(_numpy_block(sweep.table[i : i + BLOCK], sweep.duration) for i in starts)
    )
    yield Point(sweep.key, NUMPY, "", 1, sweep.lanes, landings, seconds, list(times))
