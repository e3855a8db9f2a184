"""Run a sweep from its spec to its result file, resumable and in bounded memory."""

from __future__ import annotations

import os
from collections.abc import Iterator
from numbers import Integral
from pathlib import Path

import numpy as np

from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError, RunError, VibrosweepError
from vibrosweep.mistakes import Value
from vibrosweep.runs.chunks import Job, Runner, bytes_per_realization, compute_rows, no_rows
from vibrosweep.runs.forecast import estimate, free_bytes, record_bytes, require_disk
from vibrosweep.runs.identity import identity
from vibrosweep.runs.kept import KeptRun, continued
from vibrosweep.runs.plan import Plan, make_plan
from vibrosweep.runs.progress import Advance, silent
from vibrosweep.runs.result import write_result
from vibrosweep.runs.summary import Summary
from vibrosweep.scene.realizations import Realizations, open_design
from vibrosweep.scene.sweep import Sweep
from vibrosweep.store.disk import check_output
from vibrosweep.store.parts import Columns, Manifest, Parts, kinds, write_manifest
from vibrosweep.store.rundir import holding
from vibrosweep.system import MOST_THREADS


def available_threads() -> int:
    """Return the number of processors available to this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def thread_count(threads: int | None) -> int:
    """Return the number of threads; None means all processors."""
    if threads is None:
        return available_threads()
    return count("threads", threads, most=MOST_THREADS)


def count(name: str, value: object, least: int = 1, most: int | None = None) -> int:
    """Return a whole number as a Python int, because numpy integers can overflow.

    Raises a ParameterError unless it is an int or a numpy integer, from `least` to `most`.
    """
    if (
        not isinstance(value, Integral)
        or isinstance(value, bool)
        or int(value) < least
        or (most is not None and int(value) > most)
    ):
        upper = "" if most is None else f" and at most {most}"
        given = Value(value)
        raise ParameterError(
            f"{name} = ", given, f": must be a whole number, at least {least}{upper}"
        )
    return int(value)


def require_switch(name: str, value: object) -> None:
    """Raise a ParameterError unless a value is True, False or None (the default)."""
    if not (value is None or isinstance(value, bool | np.bool_)):
        raise ParameterError(f"{name} = {value!r}: must be True or False")


def run_sweep(
    spec: Sweep,
    output: Path,
    *,
    threads: int,
    chunk: int | None = None,
    force: bool = False,
    advance: Advance = silent,
    runner: Runner | None = None,
    at_least: int = 1,
) -> Summary:
    """Compute a sweep and write it to `output`, which appears only when complete.

    A sweep of more than one chunk saves each finished chunk in a run directory next to the output;
    if the run is interrupted, the same call resumes it and computes the missing chunks.

    Parameters
    ----------
    spec
        The sweep.
    output
        Path of the file.
    threads
        Number of threads; the result does not depend on it.
    chunk
        Realizations in a chunk, by default some seconds of work; the result does not depend on it.
        A resumed run keeps its original chunks.
    force
        True to replace an existing output and to discard an unfinished run.
    advance
        Called with the number of finished realizations and the total.
    runner
        Computes the chunks; by default in this process.
    at_least
        Smallest number of chunks, for a runner that computes several at once.

    Raises
    ------
    RunError
        Another run is writing this output, the run directory holds an unfinished run of another
        sweep, or chunks failed.
    OutputError, TableError, ParameterError
        The file cannot be written, a table cannot be used, or the sweep does not fit into memory.
    """
    with holding(output) as directory:
        manifest = continued(output, directory, lambda: identity(spec), force=force)
        replaces = force or (manifest is not None and manifest.replaces)
        check_output(output, force=replaces)
        if manifest is None:
            with Workers(threads) as workers:
                plan = _planned(spec, output, workers, chunk, at_least)
                design = plan.design
                if plan.chunks == 1 and runner is None:
                    pieces = _pieces(output, spec, design, workers, advance)
                    return write_result(output, spec, design, pieces, workers, force=force)
            columns = kinds(no_rows(spec, design))
            size = design.realizations, plan.chunk
            manifest = Manifest(identity(spec), *size, columns, force, spec.text)
            write_manifest(directory, manifest)
        else:
            design = open_design(spec)
        run = KeptRun(output, design, Job(spec, Parts(directory, manifest)), threads)
        return run.complete(runner, advance, run.columns(), force=replaces)


def _planned(spec: Sweep, output: Path, workers: Workers, chunk: int | None, at_least: int) -> Plan:
    """Plan the chunks; raise an error if the files or the record would not fit."""
    plan = make_plan(spec, workers, chunk, at_least=at_least)
    record, _ = record_bytes(spec, workers)
    # uncompressed, with all parts next to the result
    most = record + 2 * bytes_per_realization(spec, plan.design) * plan.design.realizations
    if most > free_bytes(output):
        needs = estimate(spec, plan, workers)
        require_disk(output, needs.result + needs.parts)
    return plan


def _pieces(
    output: Path, spec: Sweep, design: Realizations, workers: Workers, advance: Advance
) -> Iterator[Columns]:
    """Compute a sweep of one chunk, which is written directly and cannot be resumed."""
    done = 0
    advance(done, design.realizations)
    try:
        for columns in compute_rows(spec, design, 0, design.realizations, workers):
            yield columns
            done += len(columns["status"])
            advance(done, design.realizations)
    except (VibrosweepError, MemoryError):
        raise
    except Exception as error:
        raise RunError(
            f"{output}: the computation failed twice after {done} of {design.realizations} "
            f"realizations ({type(error).__name__}: {error}); nothing was written"
        ) from error
