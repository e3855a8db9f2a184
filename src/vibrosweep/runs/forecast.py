"""Time, memory and disk space of a planned sweep, estimated from a computed sample."""

from __future__ import annotations

import math
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from vibrosweep.engine import landings
from vibrosweep.engine.landings import BYTES_PER_LANDING, Form
from vibrosweep.engine.workers import AHEAD, Workers
from vibrosweep.errors import OutputError, ParameterError, RunError
from vibrosweep.mistakes import CHUNK, OUTPUT, Word
from vibrosweep.model.ragged_arrays import IN_FILE
from vibrosweep.runs.chunks import batch_size, bytes_per_realization, rows_at_once
from vibrosweep.runs.pilot import interval, memory_per_realization
from vibrosweep.runs.plan import Plan
from vibrosweep.runs.result import declare, write_record, write_rows
from vibrosweep.scene.design import Axis
from vibrosweep.scene.sweep import Sweep
from vibrosweep.store.dataset import creating
from vibrosweep.store.disk import naming, target_of
from vibrosweep.store.parts import kinds
from vibrosweep.system import physical_memory

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


def estimate(spec: Sweep, plan: Plan, workers: Workers) -> Needs:
    """Estimate what a planned sweep needs.

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
    written, record = record_bytes(spec, workers)
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


def record_bytes(spec: Sweep, workers: Workers) -> tuple[int, int]:
    """Return the bytes of the record on disk, and of memory while it is made; 0 if there is none.

    Raises a ParameterError if it does not fit into memory.
    """
    if spec.record is None:
        return 0, 0
    form = Form(bool(spec.ragged))
    return landings.record_bytes(spec.record.parameters({}), spec.record, workers, form)


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
            ", or lower sample.realizations or what [measure] asks for",
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
    sampled = {name: Axis(values) for name, values in axes.items()}
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
        sample, _ = record_bytes(short, workers)  # as a run does
        with creating(path) as file:
            write_record(file.group(IN_FILE), short, workers)
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
