"""A sweep from its spec to its file: what is finished is kept, memory does not grow."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from vibrosweep.errors import Interruption, OutputError, RunError, VibrosweepError
from vibrosweep.store.dataset import creating
from vibrosweep.store.disk import check_output, reporting
from vibrosweep.store.parts import Manifest, Parts, read_manifest, write_manifest
from vibrosweep.store.rundir import abandon, empty, holding
from vibrosweep.sweep.chunks import (
    Columns,
    Job,
    Runner,
    batch_size,
    compute_chunk,
    compute_rows,
    in_process,
)
from vibrosweep.sweep.design import Design, open_design
from vibrosweep.sweep.engine import Workers
from vibrosweep.sweep.estimate import estimate, has_room, record_bytes, require_disk
from vibrosweep.sweep.identity import differences, identity
from vibrosweep.sweep.observation import observation_of, parameters_of, record_observation
from vibrosweep.sweep.plan import Plan, bytes_per_realization, make_plan
from vibrosweep.sweep.progress import Advance, silent
from vibrosweep.sweep.result import Rows, declare, write_record
from vibrosweep.sweep.spec import SweepSpec
from vibrosweep.sweep.summary import Summary

__all__ = [
    "available_threads",
    "observation_of",
    "parameters_of",
    "record_observation",
    "run_sweep",
]


def available_threads() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_sweep(
    spec: SweepSpec,
    output: Path,
    *,
    threads: int,
    chunk: int | None = None,
    force: bool = False,
    advance: Advance = silent,
    runner: Runner | None = None,
    at_least: int = 1,
) -> Summary:
    """Compute a sweep and write it to `output`, which appears when it is complete.

    A sweep of more than one chunk keeps each finished chunk in a directory beside the output; if
    it was ended early, the same call computes what is missing.

    Parameters
    ----------
    spec
        What to compute.
    output
        Path of the file.
    threads
        Number of threads; the result does not depend on it.
    chunk
        Realizations in a chunk, by default some seconds of work; the result does not depend on it.
        A run that continues keeps the chunks that it began with.
    force
        Whether an existing output is replaced, and an unfinished run thrown away.
    advance
        Called with the number of realizations done and that of all.
    runner
        What computes the chunks; by default this process.
    at_least
        Number of chunks that are wanted, for a runner that computes several at a time.

    Raises
    ------
    RunError
        Another run makes this output, an unfinished run of another sweep stands in the way, or
        chunks failed.
    OutputError, TableError, ParameterError
        The file cannot be written, a table cannot be used, or the sweep does not fit into memory.
    """
    with holding(output) as directory:
        if force:
            with reporting(output):
                empty(directory)
        manifest = _continued(spec, output, directory)
        check_output(output, force=force or (manifest is not None and manifest.replaces))
        if manifest is None:
            with Workers(threads) as workers:
                plan = _planned(spec, output, workers, chunk, at_least)
                if plan.chunks == 1 and runner is None:
                    return _run_at_once(spec, plan.design, output, directory, workers, advance)
            design = plan.design
            manifest = Manifest(identity(spec), design.realizations, plan.chunk, replaces=force)
            write_manifest(directory, manifest)
        else:
            design = open_design(spec)
        run = _Run(output, design, Job(spec, manifest, Parts(directory, manifest.key)), threads)
        with run.kept():
            run.compute(runner or in_process(threads), advance)
            summary = run.consolidate()
        abandon(directory)
    return summary


def _continued(spec: SweepSpec, output: Path, directory: Path) -> Manifest | None:
    """Return the manifest of the unfinished run of this very sweep, None where there is none."""
    manifest = read_manifest(directory)
    if manifest is None:
        with reporting(output):
            empty(directory)
        return None
    changes = differences(manifest.identity, identity(spec))
    if changes:
        finished = len(Parts(directory, manifest.key).finished())
        raise RunError(
            f"{output}: an unfinished run of another sweep stands in {directory}, "
            f"{finished} of {manifest.chunks} chunks finished:\n  "
            + "\n  ".join(changes)
            + "\nfinish it with what it began with, write to another file with -o, or throw it "
            "away and start again with --force"
        )
    return manifest


def _planned(
    spec: SweepSpec,
    output: Path,
    workers: Workers,
    chunk: int | None,
    at_least: int,
) -> Plan:
    """Cut the sweep, and refuse it before it starts if its files or its record cannot fit."""
    plan = make_plan(spec, workers, chunk, at_least=at_least)
    record = record_bytes(spec, workers)
    # without compression, and with every part beside the result
    most = record + 2 * bytes_per_realization(spec, plan.design) * plan.design.realizations
    if not has_room(output, most):
        needs = estimate(spec, plan, workers)
        require_disk(output, needs.result + needs.parts)
    return plan


def _run_at_once(
    spec: SweepSpec,
    design: Design,
    output: Path,
    directory: Path,
    workers: Workers,
    advance: Advance,
) -> Summary:
    """Compute a sweep of one chunk straight into its file: there would be nothing to continue."""
    summary = Summary()
    with creating(output, directory) as file:
        declare(file, spec, design, workers.threads)
        rows = Rows(file, batch_size(spec))
        try:
            for columns in compute_rows(spec, design, 0, design.realizations, workers):
                rows.add(columns)
                summary.add(columns)
                advance(summary.realizations, design.realizations)
        except (VibrosweepError, MemoryError):
            raise
        except Exception as error:
            raise RunError(
                f"{output}: the computation failed twice after {summary.realizations} of "
                f"{design.realizations} realizations ({type(error).__name__}: {error}); nothing "
                f"was written"
            ) from error
        rows.flush()
        if spec.record is not None:
            write_record(file.group("record"), spec.record, spec.impact_budget, workers)
    return summary


@dataclass(frozen=True)
class _Run:
    """A run whose chunks are kept."""

    output: Path
    design: Design
    job: Job
    threads: int

    def compute(self, runner: Runner, advance: Advance) -> None:
        """Compute the chunks that are missing."""
        manifest, finished = self.job.manifest, self.job.parts.finished()
        missing = [index for index in range(manifest.chunks) if index not in finished]
        sizes = (stop - start for start, stop in map(manifest.bounds, missing))
        done = manifest.realizations - sum(sizes)
        advance(done, manifest.realizations)

        def tick(realizations: int) -> None:
            nonlocal done
            done += realizations
            advance(done, manifest.realizations)

        failed = runner(self.job, missing, tick)
        if failed:
            names = ", ".join(map(str, sorted(failed)[:10])) + (" ..." if len(failed) > 10 else "")
            raise RunError(
                f"{self.output}: {len(failed)} of {manifest.chunks} chunks failed twice (numbers "
                f"{names}; the first: {failed[min(failed)]})"
            )

    def consolidate(self) -> Summary:
        """Write all parts into one file, in their order."""
        spec, summary = self.job.spec, Summary()
        finished = self.job.parts.finished()
        with Workers(self.threads) as workers, creating(self.output, self.job.parts.directory) as f:
            declare(f, spec, self.design, self.threads)
            rows = Rows(f, batch_size(spec))
            for index in range(self.job.manifest.chunks):
                columns = self._part(index, finished.get(index), summary)
                rows.add(columns)
                summary.add(columns)
            rows.flush()
            if spec.record is not None:
                write_record(f.group("record"), spec.record, spec.impact_budget, workers)
        return summary

    def _part(self, index: int, path: Path | None, summary: Summary) -> Columns:
        """Read a part; one that is damaged is computed again."""
        columns = None if path is None else self.job.parts.read(index, path)
        if columns is not None:
            return columns
        if path is not None:
            path.unlink(missing_ok=True)
        summary.repaired += 1
        compute_chunk(self.job, index, self.threads)
        path = self.job.parts.finished()[index]
        columns = self.job.parts.read(index, path)
        if columns is None:
            raise OutputError(
                f"{path}: what was just written reads back differently: the disk is damaged; "
                f"choose another place with -o"
            )
        return columns

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Say of whatever ends the run early what was kept."""
        try:
            yield
        except KeyboardInterrupt as error:
            raise Interruption(f"interrupted; {self._remains()}") from error
        except (OutputError, RunError) as error:
            raise type(error)(f"{error}; {self._remains()}") from error

    def _remains(self) -> str:
        directory = self.job.parts.directory
        try:
            finished = len(self.job.parts.finished())
        except OSError:
            return f"what was finished has gone with {directory}"
        again = "without --force " if self.job.manifest.replaces else ""
        return (
            f"{finished} of {self.job.manifest.chunks} chunks are finished and kept in "
            f"{directory}: run the same command {again}again to continue"
        )
