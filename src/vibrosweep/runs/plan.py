"""The plan of a sweep: its chunks, and its time, memory and disk space.

They are estimated by computing a few of its realizations, and by writing a sample of them.
"""

from __future__ import annotations

import math
import shutil
import tempfile
import time
import tracemalloc
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.engine import landings
from vibrosweep.engine.landings import BYTES_PER_LANDING, CountedLandings, Form, count_landings
from vibrosweep.engine.measure import measure_all
from vibrosweep.engine.workers import AHEAD, Workers
from vibrosweep.errors import OutputError, ParameterError, RunError, VibrosweepError
from vibrosweep.mistakes import CHUNK, OUTPUT, Word
from vibrosweep.model.forcing import only_parameters
from vibrosweep.model.measures import IN_FILE
from vibrosweep.model.parameters import fraction_of
from vibrosweep.runs.chunks import batch_size, bytes_per_realization, periods_of, rows_at_once
from vibrosweep.runs.result import declare, write_record, write_rows
from vibrosweep.scene.design import DESIGNS, GridAxis, Realizations, chosen, open_design
from vibrosweep.scene.sweep import Sweep
from vibrosweep.store.disk import naming, target_of
from vibrosweep.store.parts import Columns, kinds
from vibrosweep.store.writing import creating
from vibrosweep.system import physical_memory, resident_memory

# A killed run loses at most the chunk that it was computing; a shorter sweep is one chunk
SECONDS_PER_CHUNK: Final = 10.0
# A chunk is held in memory until it is written, which limits it when realizations are quick
BYTES_PER_CHUNK: Final = 1 << 26
CHUNKS_IF_UNKNOWN: Final = 100
# Measured with all measures and 20 particles; similar for more particles, 680 for one
BYTES_PER_TRAJECTORY: Final = 370
# Time that a run may spend on planning, unless the sweep is obviously short
SECONDS_TO_PLAN: Final = 0.5


@dataclass(frozen=True)
class Plan:
    """The chunks of a sweep and their cost."""

    design: Realizations
    chunk: int  # realizations in a chunk
    cost: Cost  # mean cost of a realization
    opening: float  # seconds to open the design

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.design.realizations // self.chunk)


def make_plan(
    spec: Sweep,
    workers: Workers,
    chunk: int | None = None,
    *,
    rows: Sequence[int] = (),
    at_least: int = 1,
    seconds: float = SECONDS_TO_PLAN,
    enough: float = SECONDS_PER_CHUNK / 4,
) -> Plan:
    """Cut a sweep into chunks of some seconds of work, or of `chunk` realizations.

    `rows` are the indices of the realizations to compute, or all of them if empty.  `at_least` is
    the smallest number of chunks, unless there are fewer realizations; `seconds` and `enough` are
    those of `explore`.  Raises a ParameterError if a chunk does not fit into memory, and a
    TableError or SpecError if the design cannot be opened.
    """
    began = time.perf_counter()
    design = open_design(spec)
    design = chosen(design, rows) if rows else design
    opening = time.perf_counter() - began
    _require_memory(spec, design, min(chunk or 1, design.realizations))
    try:
        cost = explore(spec, design, workers, seconds, enough)
    except VibrosweepError:
        raise
    except Exception:  # a failure here will occur again in its chunk and be reported there
        cost = UNKNOWN
    size = design.realizations
    if chunk is not None:
        size = chunk
    elif not cost.known:
        size = min(batch_size(spec), -(-design.realizations // CHUNKS_IF_UNKNOWN))
    elif cost.seconds * size > SECONDS_PER_CHUNK or at_least > 1:
        size = min(
            int(SECONDS_PER_CHUNK / cost.seconds),
            BYTES_PER_CHUNK // bytes_per_realization(spec, design),
            design.realizations // at_least,
        )
        size -= size % batch_size(spec) if size > batch_size(spec) else 0
    return Plan(design, max(1, min(size, design.realizations)), cost, opening)


def refined(spec: Sweep, plan: Plan, workers: Workers, seconds: float) -> Plan:
    """Estimate the cost of a plan again, in this time, and leave its chunks as they are."""
    if not plan.cost.known:
        return plan
    cost = explore(spec, plan.design, workers, seconds)
    return replace(plan, cost=replace(cost, start=plan.cost.start, loaded=plan.cost.loaded))


def _require_memory(spec: Sweep, design: Realizations, chunk: int) -> None:
    """Raise a ParameterError if a chunk needs more than half of the memory."""
    batch = min(batch_size(spec), chunk)
    needed = BYTES_PER_TRAJECTORY * batch * spec.scene.particles
    needed += 2 * chunk * bytes_per_realization(spec, design)
    available = physical_memory()
    if needed > available / 2:
        raise ParameterError(
            f"a chunk of {chunk} realizations of {spec.scene.particles} particles needs about "
            f"{needed / 2**30:.3g} GiB of this machine's {available / 2**30:.3g} GiB: lower ",
            CHUNK,
            " where it was given, or take fewer particles",
        )


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
        sampled = {name: values.repeat(size) for name, values in design.take(0, 1).items()}
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
    quantities = spec.scene.timed(sampled, size)
    measured = measure_all(only_parameters(quantities), scene, workers)
    took = time.perf_counter() - began
    return took, {**{n: quantities[n] for n in spec.scene.varying(sampled)}, **measured}


def _sampled(spec: Sweep, design: Realizations, size: int) -> dict[str, Array]:
    """Take realizations spread over the design: neighbours in a grid or a table are similar."""
    if size == design.realizations or spec.design.name in DESIGNS:
        return design.take(0, size)
    places = [int(design.realizations * (k * GOLDEN % 1.0)) for k in range(size)]
    rows = [design.take(place, place + 1) for place in places]
    return {name: np.concatenate([row[name] for row in rows]) for name in design.sampled}


SAMPLE_ROWS: Final = 1 << 15
SAMPLE_BYTES: Final = 1 << 25


@dataclass(frozen=True)
class Needs:
    """Resources that a run needs."""

    # Wall time from reading the design to the end of writing, without compiling kernels
    seconds: float
    impacts: float  # number of impacts of all particles
    # fewest, most: limits that hold it with a probability of 95 %; NaN if one realization is known
    fewest: float
    most: float
    memory: float  # peak memory of the whole process in bytes
    result: float  # bytes of the result file
    parts: float  # bytes of the parts next to it while it is written


def estimate(
    spec: Sweep, plan: Plan, workers: Workers, counted: CountedLandings | None = None
) -> Needs:
    """Estimate what a planned sweep needs; `counted` is its `counted_record` where it is known.

    Raises a ParameterError if the record of landings does not fit into memory, and a RunError if
    the sample could not be computed.
    """
    if not plan.cost.known:
        raise RunError(
            "the first realizations cannot be computed, so that the cost of the others is unknown; "
            "vibrosweep run computes those that can be computed and reports the others"
        )
    design, cost = plan.design, plan.cost
    low, high = interval(cost.impacts, design.realizations)
    written, record = record_bytes(spec, counted or counted_record(spec, workers))
    size, seconds = _written(spec, plan, workers.threads)
    if spec.record is not None:
        more, longer = _record_file(spec, written, workers)
        size, seconds = size + more, seconds + longer
    per_realization = bytes_per_realization(spec, design)
    in_parts = plan.chunks > 1
    loading = 0.0 if cost.compiled else cost.start
    rows, threads = min(plan.chunk, design.realizations), workers.threads
    batch, apart = rows_at_once(spec, design, rows, threads)
    # results that wait to be written while the next ones are computed
    waiting = 0 if batch == design.realizations else batch
    if apart:
        # of pieces, and of the block that is joined from them
        waiting = AHEAD * threads * batch + 2 * min(batch_size(spec), rows)
        batch *= threads
    computing = batch * memory_per_realization(spec, design, workers)
    computing += per_realization * (2 * plan.chunk if in_parts else waiting)
    # parts are joined to a block; the first and the last one, held whole, reach beyond it
    joined = 2 * (min(batch_size(spec), design.realizations) + plan.chunk)
    writing = per_realization * joined if in_parts else 0
    return Needs(
        seconds=plan.opening + loading + cost.seconds * design.realizations + seconds,
        impacts=float(cost.impacts.mean()) * design.realizations,
        fewest=max(low - cost.drift, 0.0) * design.realizations,
        most=(high + cost.drift) * design.realizations,
        memory=cost.loaded + max(computing, writing, record),
        result=size,
        parts=per_realization * design.realizations if in_parts else 0,
    )


def counted_record(spec: Sweep, workers: Workers) -> CountedLandings | None:
    """Count the landings of the record; None if there is none.

    Raises a ParameterError if it does not fit into memory.
    """
    if spec.record is None:
        return None
    form = Form(bool(spec.ragged))
    return count_landings(spec.record.parameters({}), spec.record, workers, form)


def record_bytes(spec: Sweep, counted: CountedLandings | None) -> tuple[int, int]:
    """Return the bytes of the record on disk, and of memory while it is made; 0 if there is none.

    `counted` is its `counted_record`.
    """
    if spec.record is None or counted is None:
        return 0, 0
    return landings.record_bytes(counted, spec.record, Form(bool(spec.ragged)))


def free_bytes(output: Path) -> int:
    """Return the number of free bytes on the disk of an output."""
    return shutil.disk_usage(target_of(output).parent).free


def require_disk(output: Path, needed: float) -> None:
    """Raise an OutputError if the files of a run do not fit on the disk of its output."""
    free = free_bytes(output)
    if needed > free:
        raise OutputError(
            f"{output}: the sweep needs {needed / 2**30:.3g} GiB of disk, but "
            f"{target_of(output).parent} has {free / 2**30:.3g} GiB free: make room, choose "
            f"another place with ",
            OUTPUT,
            ", or lower sample.realizations or switch off measures in [measure]",
        )


def _written(spec: Sweep, plan: Plan, threads: int) -> tuple[float, float]:
    """Extrapolate bytes of the file without its record, and seconds to write it, from two files."""
    design = plan.design
    most = max(2, min(SAMPLE_ROWS, SAMPLE_BYTES // bytes_per_realization(spec, design)))
    rows, size, seconds = _sample_file(spec, plan, min(design.realizations, most), threads)
    if rows == design.realizations:
        return size, seconds
    half_rows, half_size, half_seconds = _sample_file(spec, plan, rows // 2, threads)
    steps = (design.realizations - rows) / (rows - half_rows)
    return size + steps * (size - half_size), seconds + steps * max(seconds - half_seconds, 0.0)


@contextmanager
def _scratch() -> Iterator[Path]:
    """Make a directory for a sample file; an error of writing names what places it elsewhere."""
    with naming(Word("TMPDIR=", "TMPDIR=")), tempfile.TemporaryDirectory() as directory:
        yield Path(directory)


def _sample_file(spec: Sweep, plan: Plan, most: int, threads: int) -> tuple[int, int, float]:
    """Write rows drawn from the computed sample into a file; return rows, bytes and seconds."""
    columns = plan.cost.columns
    spec, rows = _shortened(spec, most)
    drawn = np.random.default_rng(0).integers(columns["status"].size, size=rows)
    with _scratch() as directory:
        path = directory / "sample.h5"
        began = time.perf_counter()
        with creating(path) as file:
            declare(file, spec, replace(plan.design, realizations=rows), threads)
            sample = {name: values[drawn] for name, values in columns.items()}
            write_rows(file, kinds(columns), [sample], batch_size(spec))
        return rows, path.stat().st_size, time.perf_counter() - began


def _shortened(spec: Sweep, most: int) -> tuple[Sweep, int]:
    """Shorten the axes of a grid to at most `most` rows; return the sweep and its rows."""
    axes = spec.design.axes
    if not axes:
        return spec, most
    left = most
    for name in reversed(axes):
        axes[name] = axes[name][: max(1, left)]
        left //= len(axes[name])
    sampled = {name: GridAxis(values) for name, values in axes.items()}
    design = replace(spec.design, sampled=sampled)
    return replace(spec, design=design), math.prod(map(len, axes.values()))


def _record_file(spec: Sweep, size: int, workers: Workers) -> tuple[float, float]:
    """Return the bytes that the record adds to the file, and seconds to compute and write it.

    They are extrapolated from a record with fewer landings of each particle.
    """
    assert spec.record is not None
    most = 1 + SAMPLE_BYTES // (BYTES_PER_LANDING * spec.record.particles)
    short = spec.with_measures(impact_budget=min(spec.record.measures.impact_budget, most))
    with _scratch() as directory:
        path = directory / "record.h5"
        began = time.perf_counter()
        counted = counted_record(short, workers)  # as a run does
        sample, _ = record_bytes(short, counted)
        with creating(path) as file:
            write_record(file.group(IN_FILE), short, workers, counted)
        took = time.perf_counter() - began
        growth = max(size / max(sample, 1), 1.0)
        return path.stat().st_size * growth, took * growth


def require_memory(needed: float) -> None:
    """Raise a ParameterError if a run does not fit into memory."""
    available = physical_memory()
    if needed > available:
        raise ParameterError(
            f"the sweep needs {needed / 2**30:.3g} GiB of memory, but this machine has "
            f"{available / 2**30:.3g} GiB: lower ",
            CHUNK,
            " where it was given, take fewer particles, or shorten the record",
        )
