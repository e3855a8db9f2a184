"""The cost of a sweep, measured by computing a few of its realizations."""

from __future__ import annotations

import math
import time
import tracemalloc
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.engine.measure import measure_all
from vibrosweep.engine.workers import Workers
from vibrosweep.model.times import fraction_of, in_periods
from vibrosweep.runs.chunks import batch_size
from vibrosweep.scene.design import DESIGNS
from vibrosweep.scene.realizations import Realizations
from vibrosweep.scene.sweep import Sweep
from vibrosweep.store.parts import Columns
from vibrosweep.system import resident_memory

# The first sample: this many trajectories over this many periods, or impacts, take 1-2 ms
TRAJECTORIES: Final = 256
PERIODS: Final = 64.0
IMPACTS: Final = 1_000_000
REALIZATIONS: Final = 4  # at least, because realizations differ
STEP: Final = 4  # factor from one sample to the next
MEASURED_PARTICLES: Final = 4096
MEASURED_TRAJECTORIES: Final = 1 << 14  # enough for their arrays to dominate other allocations
SECONDS_TO_LOAD: Final = 2.0
GOLDEN: Final = 0.6180339887498949  # multiples of the golden ratio, modulo 1, spread evenly


@dataclass(frozen=True)
class Cost:
    """Average cost of the realizations of a sweep."""

    seconds: float  # mean per realization
    impacts: float  # mean per realization
    # Relative standard error of the mean number of impacts; NaN if the sample is too small
    error: float
    # Fraction of the duration and the impact budget that was computed; the rest is extrapolated
    share: float
    start: float  # seconds to load or compile the kernels
    loaded: float  # memory of the process in bytes once the kernels were loaded
    columns: Columns  # the measured variables; empty if the sample could not be computed

    @property
    def known(self) -> bool:
        """True if the sample could be computed."""
        return bool(self.columns)

    @property
    def compiled(self) -> bool:
        """True if kernels were compiled, which takes seconds, rather than loaded."""
        return self.start > SECONDS_TO_LOAD


class Part(NamedTuple):
    """Mean cost of a realization over a fraction of its duration and impact budget."""

    share: float
    seconds: float
    impacts: float


UNKNOWN: Final = Cost(math.nan, math.nan, math.nan, 0.0, 0.0, 0.0, {})


def explore(
    spec: Sweep, design: Realizations, workers: Workers, seconds: float, enough: float = 0.0
) -> Cost:
    """Estimate the cost of the realizations of a sweep, with as many threads as the run has.

    A few realizations are computed over a small fraction of their duration and impact budget, then
    over growing fractions; once these reach 1, more realizations are computed.  This takes about
    `seconds`, apart from loading or compiling kernels.  It ends earlier if the whole sweep takes
    less than `enough` seconds.
    """
    most = min(design.realizations, batch_size(spec))
    size = min(most, max(REALIZATIONS, -(-TRAJECTORIES // spec.scene.particles)))
    began = time.perf_counter()
    shares = list(_shares(spec, design))
    sampled = _sampled(spec, design, size)
    start = loaded = 0.0
    before = Part(0.0, 0.0, 0.0)
    while True:
        share = shares.pop(0)
        # twice: the first call may load or compile kernels, which depend on the duration
        first, _ = _timed(spec, sampled, size, share, workers)
        took, columns = _timed(spec, sampled, size, share, workers)
        start += max(first - took, 0.0)
        loaded = loaded or float(resident_memory())
        now = Part(share, took / size, float(columns["impact_count"].mean()))
        cost = _extrapolated(before, now, start, loaded, columns)
        before = now
        left = seconds - (time.perf_counter() - began - start)
        settled = share == 1.0 and (size == most or cost.seconds * design.realizations < enough)
        if settled or 2 * STEP * took > left:
            return cost
        if not shares:
            shares, before = [1.0], Part(0.0, 0.0, 0.0)
            size = min(most, STEP * size)
            sampled = _sampled(spec, design, size)


def memory_per_realization(spec: Sweep, design: Realizations, workers: Workers) -> float:
    """Return the bytes of memory per realization of a batch while it is computed."""
    particles = min(spec.scene.particles, MEASURED_PARTICLES)
    launch = spec.scene.launch
    launch = launch if isinstance(launch, str) else launch[:particles]
    few = replace(spec, scene=replace(spec.scene, particles=particles, launch=launch))
    size = max(REALIZATIONS, -(-MEASURED_TRAJECTORIES // particles))
    sizes, peaks = (size, STEP * size), []
    share = next(_shares(spec, design)) / STEP**2  # array sizes do not depend on the duration
    for size in sizes:
        factors = 1.0 - 1e-9 * np.arange(size)  # duplicates would be computed only once
        sampled = {name: values * factors for name, values in design.take(0, 1).items()}
        tracemalloc.start()
        try:
            with Workers(workers.threads) as fresh:  # workers without memory of earlier batches
                _timed(few, sampled, size, share, fresh)
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    return (peaks[1] - peaks[0]) / (sizes[1] - sizes[0]) * spec.scene.particles / particles


def _shares(spec: Sweep, design: Realizations) -> Iterator[float]:
    """Yield growing fractions of the duration and of the impact budget, up to 1."""
    fixed = np.array([spec.scene.inputs.get("frequency", 1.0)])
    frequency = design.take(0, 1).get("frequency", fixed)
    periods = float(in_periods(spec.scene.duration, frequency)[0])
    steps = 0
    while max(periods / PERIODS, spec.scene.measures.impact_budget / IMPACTS) > STEP**steps:
        steps += 1
    return (float(STEP) ** -k for k in range(steps, -1, -1))


def _extrapolated(before: Part, now: Part, start: float, loaded: float, columns: Columns) -> Cost:
    """Extrapolate the cost linearly from two fractions of the observation."""
    steps = (1.0 - now.share) / (now.share - before.share)
    counts = columns["impact_count"]
    deviation = float(np.std(counts)) / max(float(counts.mean()), 1.0)
    return Cost(
        seconds=now.seconds + steps * max(now.seconds - before.seconds, 0.0),
        impacts=now.impacts + steps * max(now.impacts - before.impacts, 0.0),
        error=deviation / np.sqrt(counts.size - 1) if counts.size > 1 else np.nan,
        share=now.share,
        start=start,
        loaded=loaded,
        columns=columns,
    )


def _timed(
    spec: Sweep, sampled: dict[str, Array], size: int, share: float, workers: Workers
) -> tuple[float, Columns]:
    """Compute realizations over a fraction of their duration; return seconds and results."""
    scene = spec.scene
    if share < 1.0:
        scene = replace(scene, duration=fraction_of(scene.duration, share)).with_measures(
            transient=fraction_of(scene.measures.transient, share),
            impact_budget=max(1, int(scene.measures.impact_budget * share)),
        )
    began = time.perf_counter()
    measured = measure_all(scene.parameters(sampled, size), scene, workers)
    took = time.perf_counter() - began
    return took, {**spec.scene.varied(sampled, size), **measured}


def _sampled(spec: Sweep, design: Realizations, size: int) -> dict[str, Array]:
    """Take realizations spread over the design: neighbours in a grid or a table are similar."""
    if size == design.realizations or spec.design.name in DESIGNS:
        return design.take(0, size)
    places = [int(design.realizations * (k * GOLDEN % 1.0)) for k in range(size)]
    rows = [design.take(place, place + 1) for place in places]
    return {name: np.concatenate([row[name] for row in rows]) for name in design.sampled}
