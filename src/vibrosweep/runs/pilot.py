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
from vibrosweep.model.times import fraction_of
from vibrosweep.runs.chunks import batch_size, periods_of
from vibrosweep.scene.design import DESIGNS
from vibrosweep.scene.realizations import Realizations
from vibrosweep.scene.sweep import Sweep
from vibrosweep.store.parts import Columns
from vibrosweep.system import resident_memory

# The first sample: this many trajectories over this many periods, or impacts, take 1-2 ms
TRAJECTORIES: Final = 256
PERIODS: Final = 64.0
IMPACTS: Final = 1_000_000
FEW: Final = 4  # realizations at least
# Of a sweep that is not obviously short: a few realizations may hold most of all impacts
REALIZATIONS: Final = 64
STEP: Final = 4  # factor from one share to the next
GROWTH: Final = 16  # largest factor from one sample to the next
RESAMPLES: Final = 1000
CONFIDENCE: Final = 0.95
MEASURED_PARTICLES: Final = 4096
MEASURED_TRAJECTORIES: Final = 1 << 14  # enough for their arrays to dominate other allocations
SECONDS_TO_LOAD: Final = 2.0
GOLDEN: Final = 0.6180339887498949  # multiples of the golden ratio, modulo 1, spread evenly


@dataclass(frozen=True)
class Cost:
    """Average cost of the realizations of a sweep."""

    seconds: float  # mean per realization
    impacts: Array  # number in each sampled realization
    # By how much the mean of these changed when the share was raised last; 0 if it is 1
    drift: float
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
    """Cost of the sampled realizations over a fraction of their duration and impact budget."""

    share: float
    seconds: float  # mean
    impacts: Array  # of each


UNKNOWN: Final = Cost(math.nan, np.empty(0), math.nan, 0.0, 0.0, 0.0, {})


def explore(
    spec: Sweep, design: Realizations, workers: Workers, seconds: float, enough: float = 0.0
) -> Cost:
    """Estimate the cost of the realizations of a sweep, with as many threads as the run has.

    A few realizations are computed over a small fraction of their duration and impact budget, then
    over growing fractions; once these reach 1, as many realizations as there is time for.  This
    takes about `seconds`, apart from loading or compiling kernels.  It ends earlier if the whole
    sweep takes less than `enough` seconds.
    """
    most = min(design.realizations, batch_size(spec))
    size = min(most, max(FEW, -(-TRAJECTORIES // spec.scene.particles)))
    least = min(most, max(REALIZATIONS, size))
    began = time.perf_counter()
    shares = list(_shares(spec, design))
    sampled = _sampled(spec, design, size)
    start = loaded = 0.0
    nothing = Part(0.0, 0.0, np.zeros(1))
    before, cost = nothing, UNKNOWN
    while True:
        share = shares.pop(0)
        # twice: the first call may load or compile kernels, which depend on the duration
        first, _ = _timed(spec, sampled, size, share, workers)
        took, columns = _timed(spec, sampled, size, share, workers)
        start += max(first - took, 0.0)
        loaded = loaded or float(resident_memory())
        now = Part(
            share, took / size, np.maximum(columns["impact_count"], 0.0)
        )  # not where refused
        cost = _extrapolated(before, now, cost, start, loaded, columns)
        before, before_share = now, before.share
        left = seconds - (time.perf_counter() - began - start)
        short = cost.seconds * design.realizations < enough
        # at the first share the fixed cost of a batch is taken for work
        more = size < least and not short and (before_share > 0.0 or share == 1.0)
        longer = max(2.0, min(GROWTH, 0.45 * left / took))
        if more:
            longer = least / size
        elif shares:
            longer = STEP
        settled = share == 1.0 and (size == most or short)
        if settled or 2.0 * longer * took > left:
            return cost
        if more or not shares:
            shares = list(_shares(spec, design)) if more else [1.0]
            before, size = nothing, min(most, math.ceil(longer * size))
            sampled = _sampled(spec, design, size)


def memory_per_realization(spec: Sweep, design: Realizations, workers: Workers) -> float:
    """Return the bytes of memory per realization of a batch while it is computed."""
    particles = min(spec.scene.particles, MEASURED_PARTICLES)
    launch = spec.scene.launch
    launch = launch if isinstance(launch, str) else launch[:particles]
    few = replace(spec, scene=replace(spec.scene, particles=particles, launch=launch))
    size = max(FEW, -(-MEASURED_TRAJECTORIES // particles))
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
    periods = periods_of(spec, design)
    steps = 0
    while max(periods / PERIODS, spec.scene.measures.impact_budget / IMPACTS) > STEP**steps:
        steps += 1
    return (float(STEP) ** -k for k in range(steps, -1, -1))


def interval(counts: Array, total: int) -> tuple[float, float]:
    """Return the 95 % confidence interval of a mean over `total`, of which `counts` are a sample.

    It is NaN for a sample of one.  Counts are skewed: few realizations hold many impacts, and a
    sample without these has a small mean and a small spread, too.  The interval is therefore that
    of the studentized bootstrap, which reaches further up than down.
    """
    size, mean = counts.size, float(counts.mean())
    if size == total:
        return mean, mean
    if size < 2:
        return math.nan, math.nan
    rng = np.random.default_rng(0)
    error = float(counts.std()) / math.sqrt(size - 1)
    ratios = np.empty(RESAMPLES)
    for k in range(RESAMPLES):
        drawn = counts[rng.integers(size, size=size)]
        spread = float(drawn.std()) / math.sqrt(size - 1)
        ratios[k] = (float(drawn.mean()) - mean) / spread if spread > 0.0 else 0.0
    error *= math.sqrt(1.0 - size / total)
    tail = (1.0 - CONFIDENCE) / 2.0
    low, high = np.quantile(ratios, [tail, 1.0 - tail]).tolist()
    return max(mean - high * error, 0.0), mean - low * error


def _extrapolated(
    before: Part, now: Part, last: Cost, start: float, loaded: float, columns: Columns
) -> Cost:
    """Extrapolate the cost linearly from two fractions of the observation."""
    steps = (1.0 - now.share) / (now.share - before.share)
    impacts = now.impacts + steps * np.maximum(now.impacts - before.impacts, 0.0)
    extrapolated = now.share < 1.0 and last.known
    return Cost(
        seconds=now.seconds + steps * max(now.seconds - before.seconds, 0.0),
        impacts=impacts,
        drift=abs(float(impacts.mean() - last.impacts.mean())) if extrapolated else 0.0,
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
