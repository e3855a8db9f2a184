"""Run a sweep from its spec to its result: in memory, or into a file, resumably.

A run of several chunks keeps those that are finished and computes the missing ones.  Incomplete
realizations of a finished result can be computed again, and more of them added.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vibrosweep.engine.landings import CountedLandings
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import (
    DataError,
    Interruption,
    OutputError,
    ParameterError,
    RunError,
    TakenOutputError,
    VibrosweepError,
    count,
)
from vibrosweep.mistakes import FORCE, IMPACT_BUDGET, OUTPUT, Text
from vibrosweep.runs.chunks import (
    Job,
    Runner,
    Stream,
    batch_size,
    bytes_per_realization,
    compute_chunk,
    compute_rows,
    differences,
    identity,
    in_process,
    no_rows,
)
from vibrosweep.runs.plan import (
    Plan,
    counted_record,
    estimate,
    free_bytes,
    make_plan,
    record_bytes,
    require_disk,
)
from vibrosweep.runs.result import (
    SETTLING,
    Summary,
    declare,
    identity_in,
    notes,
    summary_of,
    unsettled,
    write_result,
    write_rows,
)
from vibrosweep.scene.design import Realizations, begins_alike, open_design
from vibrosweep.scene.sweep import Sweep
from vibrosweep.store.arranged import read_rows
from vibrosweep.store.disk import check_output, reporting
from vibrosweep.store.parts import (
    Columns,
    Manifest,
    Parts,
    abandon,
    empty,
    holding,
    kinds,
    read_manifest,
    run_directory,
    write_manifest,
)
from vibrosweep.store.reading import SWEEP, kind_of, result_file
from vibrosweep.store.writing import Attributes, Writer
from vibrosweep.system import MOST_THREADS, physical_memory
from vibrosweep.waiting import Advance, silent

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["thread_count"]


def available_threads() -> int:
    """Return the number of processors available to this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def thread_count(threads: int | None) -> int:
    """Return the number of threads; None means all processors."""
    if threads is None:
        return available_threads()
    return count("threads", threads, most=MOST_THREADS)


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
    if the run is interrupted, the same call resumes it and computes the missing chunks.  A result
    of the same sweep with fewer realizations is continued, if its design begins alike.

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
        if not force and (rows := added(spec, output)):
            again = Again(spec, output, threads, chunk, runner, at_least)
            return again.compute(directory, ADDED, rows, advance)
        manifest = continued(output, directory, lambda: identity(spec), force=force)
        replaces = force or (manifest is not None and manifest.replaces)
        check_output(output, force=replaces)
        if manifest is None:
            with Workers(threads) as workers:
                plan, counted = _planned(spec, output, workers, chunk, at_least)
                design = plan.design
                if plan.chunks == 1 and runner is None:
                    pieces = _pieces(str(output), spec, design, workers, advance)
                    return write_result(
                        output, spec, design, pieces, workers, force=force, counted=counted
                    )
            columns = kinds(no_rows(spec, design))
            size = design.realizations, plan.chunk
            manifest = Manifest(identity(spec), *size, columns, force, spec.text)
            write_manifest(directory, manifest)
        else:
            design = open_design(spec)
        run = KeptRun(output, design, Job(spec, Parts(directory, manifest)), threads)
        return run.complete(runner, advance, run.columns(), force=replaces)


def _planned(
    spec: Sweep, output: Path, workers: Workers, chunk: int | None, at_least: int
) -> tuple[Plan, CountedLandings | None]:
    """Plan the chunks and count the record; raise an error if they would not fit."""
    plan = make_plan(spec, workers, chunk, at_least=at_least)
    counted = counted_record(spec, workers)
    record, _ = record_bytes(spec, counted)
    # uncompressed, with all parts next to the result
    most = record + 2 * bytes_per_realization(spec, plan.design) * plan.design.realizations
    if most > free_bytes(output):
        needs = estimate(spec, plan, workers, counted)
        require_disk(output, needs.result + needs.parts)
    return plan, counted


def _pieces(
    result: str, spec: Sweep, design: Realizations, workers: Workers, advance: Advance
) -> Iterator[Columns]:
    """Compute a sweep of one chunk, which cannot be resumed; `result` names what it is for."""
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
            f"{result}: the computation failed twice after {done} of {design.realizations} "
            f"realizations ({type(error).__name__}: {error}); nothing was written"
        ) from error


class InMemory(Writer):
    """A result in memory, written like a file and returned as a dataset."""

    def __init__(self) -> None:
        super().__init__()
        self._attributes: dict[str, Any] = {}

    def _create(
        self, name: str, shape: tuple[int, ...], dtype: Any, attributes: Attributes, blank: float
    ) -> NDArray[Any]:
        return np.full(shape, blank, dtype)

    def _fill(self, array: NDArray[Any], start: int, values: NDArray[Any]) -> None:
        array.reshape(-1, *values.shape[1:])[start : start + len(values)] = values

    def attributes(self, values: Attributes) -> None:
        """Set attributes of the result."""
        self._attributes.update(values)

    def dataset(self) -> xr.Dataset:
        """Return the dataset; a RunError if rows of a variable are missing."""
        import xarray as xr

        self._require_written("the result")
        coordinates = {name: self._arrays[name] for name in self._coordinates}
        others = {name: array for name, array in self._arrays.items() if name not in coordinates}
        return xr.Dataset(others, coordinates, self._attributes)


def sweep_in_memory(spec: Sweep, *, threads: int, advance: Advance = silent) -> xr.Dataset:
    """Compute a sweep without its record; the result does not depend on the number of threads.

    `advance` is called with the number of finished realizations and the total.  Raises a
    ParameterError if the result does not fit into memory, and a TableError or SpecError if the
    design cannot be opened.
    """
    design = open_design(spec)
    total = design.realizations
    needed, available = bytes_per_realization(spec, design) * total, physical_memory()
    if needed > available / 2:
        raise ParameterError(
            f"the results of {total} realizations take {needed / 2**30:.3g} GiB of this machine's "
            f"{available / 2**30:.3g} GiB: write them to a file with vibrosweep.run"
        )
    found = InMemory()
    declare(found, spec, design, threads)
    with Workers(threads) as workers:
        pieces = _pieces("the sweep", spec, design, workers, advance)
        write_rows(found, kinds(no_rows(spec, design)), pieces)
    return found.dataset()


def continued(
    output: Path, directory: Path, now: Callable[[], Mapping[str, str]], *, force: bool
) -> Manifest | None:
    """Return the manifest of an unfinished run of this sweep to resume, or None.

    Without a manifest, or with `force`, all files in the directory are removed.  `now` returns the
    identity of the sweep to run.  Raises a RunError if the directory holds an unfinished run of
    another sweep.
    """
    manifest = None if force else read_manifest(directory)
    if manifest is None:
        with reporting(output):
            empty(directory)
        return None
    changes = differences(manifest.identity, now())
    if changes:
        finished = len(Parts(directory, manifest).finished())
        raise RunError(
            f"{output}: {directory} holds an unfinished run of another sweep, "
            f"{finished} of {manifest.chunks} chunks finished:\n  "
            + "\n  ".join(changes)
            + "\nfinish it with the sweep that it began with, write to another file with ",
            OUTPUT,
            ", or discard it and start again with ",
            FORCE,
        )
    return manifest


@dataclass
class KeptRun:
    """A run that keeps its finished chunks and can be resumed."""

    output: Path  # the result file
    design: Realizations  # the realizations to compute
    job: Job  # data from which a process computes the chunks
    threads: int  # number of threads in this process
    kept: int = 0  # realizations that an interrupted run has computed
    repaired: int = 0  # damaged parts that were computed again

    @property
    def directory(self) -> Path:
        """The run directory."""
        return self.job.parts.directory

    def complete(
        self, runner: Runner | None, advance: Advance, pieces: Iterable[Columns], *, force: bool
    ) -> Summary:
        """Compute the missing chunks, write the result from `pieces` and discard the chunks."""
        with self._kept():
            self._compute(runner or in_process(self.threads), advance)
            with Workers(self.threads) as workers:
                summary = write_result(
                    self.output, self.job.spec, self.design, pieces, workers, force=force
                )
        abandon(self.directory)
        summary.kept, summary.repaired = self.kept, self.repaired
        return summary

    def _compute(self, runner: Runner, advance: Advance) -> None:
        """Compute all missing chunks; then raise a RunError if any failed."""
        manifest, finished = self.job.parts.manifest, self.job.parts.finished()
        missing = [index for index in range(manifest.chunks) if index not in finished]
        sizes = (stop - start for start, stop in map(manifest.bounds, missing))
        self.kept = done = manifest.realizations - sum(sizes)
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

    def columns(self) -> Iterator[Columns]:
        """Yield the columns of each chunk, in order; damaged parts are computed again."""
        finished = self.job.parts.finished()
        for index in range(self.job.parts.manifest.chunks):
            yield self._part(index, finished.get(index))

    def _part(self, index: int, path: Path | None) -> Columns:
        """Read a part; compute it again if it is damaged or missing."""
        columns = None if path is None else self.job.parts.read(index, path)
        if columns is not None:
            return columns
        if path is not None:
            path.unlink(missing_ok=True)
        self.repaired += 1
        compute_chunk(self.job, index, self.threads)
        path = self.job.parts.finished()[index]
        columns = self.job.parts.read(index, path)
        if columns is None:
            raise OutputError(
                f"{path}: what was just written reads back differently: the disk is damaged; "
                f"choose another place with ",
                OUTPUT,
            )
        return columns

    @contextmanager
    def _kept(self) -> Iterator[None]:
        """Add the number of kept chunks, and how to resume, to an error that ends the run."""
        try:
            yield
        except KeyboardInterrupt as error:
            raise Interruption("interrupted; ", self._remains()) from error
        except TakenOutputError:  # the result is complete, under another name
            abandon(self.directory)
            raise
        except (OutputError, RunError) as error:
            raise type(error)(*error.parts, "; ", self._remains()) from error

    def _remains(self) -> Text:
        """Say how many chunks are kept, and how to resume."""
        manifest = self.job.parts.manifest
        try:
            finished = len(self.job.parts.finished())
        except OSError:
            return f"the finished chunks were removed with {self.directory}"
        again: Text = ("without ", FORCE, " ") if manifest.replaces else ""
        return (
            f"{finished} of {manifest.chunks} chunks are finished and saved in "
            f"{self.directory}: run the same command ",
            again,
            "again to continue",
        )


def is_of(spec: Sweep, path: Path) -> bool:
    """Return whether a file is the finished result of exactly this sweep and version."""
    return _changes(spec, path) == []


def kept_text(output: Path) -> str:
    """Return the text of the sweep file in an output or its unfinished run; "" if there is none."""
    directory = run_directory(output)
    manifest = read_manifest(directory) if directory.exists() else None
    if manifest is not None:
        return manifest.text
    try:
        with result_file(output) as file:
            return str(file.attrs.get("sweep_file", ""))
    except DataError:
        return ""


def cleared(spec: Sweep, output: Path) -> bool:
    """Remove the parts that a killed run left beside the finished result of this sweep.

    Returns True if there were any.  An unfinished run of another sweep is kept, and so is a retry.
    """
    if not run_directory(output).exists():
        return False
    try:
        with holding(output) as directory:
            manifest = read_manifest(directory)
            if manifest is not None and differences(_without(manifest, ADDED), identity(spec)):
                return False
            abandon(directory)
    except (OutputError, RunError):  # nothing can be written here, or another run is at work
        return False
    return True


def origin(spec: Sweep, path: Path) -> str:
    """Describe an existing file and how it differs from the result of this sweep."""
    changes = _changes(spec, path)
    if changes is None:
        return "it is not the result of a sweep, or it is damaged"
    if isinstance(changes, str):
        return changes
    if not changes:
        return "it is the finished result of exactly this sweep"
    reason = ""
    if len(changes) == 1 and changes[0].startswith(f"{REALIZATIONS}: "):
        reason = 'only more realizations of design = "uniform" or "sobol" continue a result\n'
        if spec.design.name == "latin":
            reason = (
                "a Latin hypercube of another number of realizations has other points, so that it "
                'cannot be continued: take design = "sobol" or "uniform"\n'
            )
    listed = "\n  ".join(changes)
    return f"it is the result of another sweep or version:\n  {listed}\n{reason}"


def added(spec: Sweep, path: Path) -> tuple[int, ...]:
    """Return the indices of the realizations by which this sweep continues a finished result.

    Empty unless the result is of the same sweep and version with fewer realizations, which are the
    first ones of this sweep.
    """
    if not begins_alike(spec.design.name):
        return ()
    try:
        with result_file(path) as file:
            before = json.loads(identity_in(file)) if kind_of(path, file.attrs) is SWEEP else {}
    except DataError:
        return ()
    if differences({**before, REALIZATIONS: ""}, {**identity(spec), REALIZATIONS: ""}):
        return ()
    return tuple(range(int(before[REALIZATIONS]), int(spec.design.realizations or 0)))


def _changes(spec: Sweep, path: Path) -> list[str] | str | None:
    """Return the differences from a file's sweep, or a sentence on its kind; None if foreign."""
    try:
        with result_file(path) as file:
            kind, text = kind_of(path, file.attrs), file.attrs.get("sweep_file")
            before = json.loads(identity_in(file)) if kind is SWEEP else {}
    except DataError:
        return None
    if kind is SWEEP:
        return differences(before, identity(spec))
    same = "this very" if text == spec.text else "another"
    return f"it is a result of {kind.command} from {same} sweep file"


BUDGET = "measure.impact_budget"
REALIZATIONS = "sample.realizations"
AGAIN, ADDED = "rows computed again", "rows added"  # in the identity of a run


@dataclass(frozen=True)
class Again:
    """Computation of some realizations of a finished result: incomplete ones, or more of them."""

    spec: Sweep
    output: Path  # the result, which the new one replaces when it is complete
    threads: int
    chunk: int | None
    runner: Runner | None
    at_least: int

    def compute(
        self,
        directory: Path,
        why: str,
        rows: tuple[int, ...],
        advance: Advance,
        *,
        force: bool = False,
    ) -> Summary:
        """Compute the rows, resuming an unfinished run with the same ones, and join the results.

        `why` is the key of the rows in the identity of the run, `AGAIN` or `ADDED`.
        """
        spec, output = self.spec, self.output
        with result_file(output) as file:
            before = json.loads(identity_in(file))
        now = {**identity(spec), why: _digest(rows)}
        if not force:
            _abandon_merged(directory, before, now)
        manifest = continued(output, directory, lambda: now, force=force)
        if manifest is None and rows:
            with Workers(self.threads) as workers:
                plan = make_plan(spec, workers, self.chunk, at_least=self.at_least, rows=rows)
            columns = kinds(no_rows(spec, plan.design))
            manifest = Manifest(now, len(rows), plan.chunk, columns, force, spec.text)
            write_manifest(directory, manifest)
        if manifest is None:
            with result_file(output) as file:
                summary = summary_of(file)
                recorded = file.groups["record"].attrs if spec.record is not None else {}
                note = {"record": recorded["notes"]} if "notes" in recorded else {}
            summary.notes = {**notes(spec, open_design(spec)), **note}
            return summary
        job = Job(spec, Parts(directory, manifest), rows)
        run = KeptRun(output, open_design(spec), job, self.threads)
        summary = run.complete(self.runner, advance, _merged(run, np.asarray(rows)), force=True)
        summary.kept += rows[0] if why == ADDED else 0
        return summary


def retry_failed(
    spec: Sweep,
    output: Path,
    *,
    threads: int,
    impact_budget: int | None = None,
    chunk: int | None = None,
    force: bool = False,
    advance: Advance = silent,
    runner: Runner | None = None,
    at_least: int = 1,
) -> tuple[Summary, int]:
    """Compute the incomplete realizations of a result again.

    The new result equals that of the sweep with the new impact budget.  It replaces the old one
    when it is complete; finished chunks are kept as in `run_sweep`.

    Parameters
    ----------
    spec
        The sweep file of the result; only its impact budget may have changed.
    output
        The result.
    threads
        Number of threads; the result does not depend on it.
    impact_budget
        Largest number of impacts of a particle, by default that of `spec`.
    chunk
        Realizations in a chunk, by default some seconds of work.
    force
        True to discard an unfinished run.
    advance
        Called with the number of finished realizations and the number of those to retry.
    runner, at_least
        See `run_sweep`.

    Returns
    -------
    Summary, int
        The new result, and the number of realizations that were computed again.

    Raises
    ------
    DataError
        There is no such result.
    RunError
        The result is not finished, or is of another sweep or version; the new budget is lower; or
        another run is in the way.
    """
    if impact_budget:
        spec = spec.with_measures(impact_budget=impact_budget)
    with holding(output) as directory:
        if not output.exists() and read_manifest(directory) is not None:
            raise RunError(f"{output}: is not finished; finish the run before any of it is retried")
        rows = _rows(spec, output)
        again = Again(spec, output, threads, chunk, runner, at_least)
        return again.compute(directory, AGAIN, rows, advance, force=force), len(rows)


def _rows(spec: Sweep, output: Path) -> tuple[int, ...]:
    """Return the indices of realizations of a result of this sweep to retry.

    Index 0 is among them if the record lacks landings.
    """
    with result_file(output) as file:
        before = json.loads(identity_in(file))
        budget = int(before[BUDGET])
        names = [name for name in SETTLING if name in file.variables]
        failed = unsettled({name: read_rows(file, name, slice(None)) for name in names})
        if spec.record is not None:  # the record is rewritten if any row is retried
            status = file.groups["record"].variables["status"][...]
            failed[:1] |= np.any(unsettled({"status": status}))
    now = identity(spec)
    changes = differences({**before, BUDGET: ""}, {**now, BUDGET: ""})
    if changes:
        raise RunError(
            f"{output}: is a result of another sweep or version:\n  "
            + "\n  ".join(changes)
            + "\nonly the impact budget may differ; recompute the sweep with ",
            FORCE,
        )
    if spec.scene.measures.impact_budget < budget:
        raise RunError(
            f"{output}: was computed with an impact budget of {budget}, which "
            f"{spec.scene.measures.impact_budget} would not reach: raise it with ",
            IMPACT_BUDGET,
        )
    return tuple(np.flatnonzero(failed).tolist())


def _abandon_merged(directory: Path, before: Mapping[str, str], now: Mapping[str, str]) -> None:
    """Abandon a run that was killed after its rows had been written into the result."""
    manifest = read_manifest(directory)
    if manifest is None or not differences(manifest.identity, now):
        return
    if _without(manifest, AGAIN, ADDED) == before:
        abandon(directory)


def _without(manifest: Manifest, *keys: str) -> dict[str, str]:
    """Return the identity of a run without some keys."""
    return {key: value for key, value in manifest.identity.items() if key not in keys}


def _digest(rows: tuple[int, ...]) -> str:
    digest = hashlib.blake2b(np.asarray(rows, np.int64).tobytes(), digest_size=8).hexdigest()
    return f"{len(rows)} (digest {digest})"


def _merged(run: KeptRun, retried: NDArray[np.int64]) -> Iterator[Columns]:
    """Yield the rows of the old result in blocks, with the retried ones in their places.

    New ones follow.
    """
    spec, fresh = run.job.spec, Stream(run.columns())
    names, size = list(no_rows(spec, run.design)), batch_size(spec)
    with result_file(run.output) as file:
        total = len(file.variables["status"])
        for start in range(0, total, size):
            rows = slice(start, min(start + size, total))
            columns = {name: read_rows(file, name, rows) for name in names}
            first, last = np.searchsorted(retried, (rows.start, rows.stop))
            for name, values in fresh.take(int(last - first)).items():
                columns[name][retried[first:last] - start] = values
            yield columns
    yield from fresh.blocks(size)
