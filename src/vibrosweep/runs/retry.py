"""Retry the incomplete realizations of a finished result, and rewrite the result."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vibrosweep.engine.workers import Workers
from vibrosweep.errors import RunError
from vibrosweep.mistakes import FORCE, IMPACT_BUDGET
from vibrosweep.runs.chunks import Job, Runner, Stream, batch_size, no_rows
from vibrosweep.runs.identity import differences, identity
from vibrosweep.runs.kept import KeptRun, continued
from vibrosweep.runs.plan import make_plan
from vibrosweep.runs.progress import Advance, silent
from vibrosweep.runs.result import identity_in
from vibrosweep.runs.summary import SETTLING, Summary, summary_of, unsettled
from vibrosweep.scene.realizations import open_design
from vibrosweep.scene.sweep import Sweep
from vibrosweep.store.parts import Columns, Manifest, Parts, kinds, read_manifest, write_manifest
from vibrosweep.store.reading import result_file
from vibrosweep.store.rows import read_rows
from vibrosweep.store.rundir import abandon, holding

BUDGET = "measure.impact_budget"
AGAIN = "rows computed again"


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
        before, rows = _rows(spec, output)
        design = open_design(spec)
        now = {**identity(spec), AGAIN: _digest(rows)}
        if not force:
            _abandon_merged(directory, before, now)
        manifest = continued(output, directory, lambda: now, force=force)
        if manifest is None and rows:
            with Workers(threads) as workers:
                plan = make_plan(spec, workers, chunk, at_least=at_least, rows=rows)
            columns = kinds(no_rows(spec, design))
            manifest = Manifest(now, len(rows), plan.chunk, columns, force, spec.text)
            write_manifest(directory, manifest)
        if manifest is None:
            with result_file(output) as file:
                return summary_of(file), 0
        job = Job(spec, Parts(directory, manifest), rows)
        run = KeptRun(output, design, job, threads)
        summary = run.complete(runner, advance, _merged(run, np.asarray(rows)), force=True)
    return summary, len(rows)


def _rows(spec: Sweep, output: Path) -> tuple[dict[str, str], tuple[int, ...]]:
    """Return the identity of a result of this sweep, and the indices of realizations to retry.

    Index 0 is among them if the record lacks landings.
    """
    with result_file(output) as file:
        before = json.loads(identity_in(file))
        budget = int(before[BUDGET])
        names = [name for name in SETTLING if name in file.variables]
        failed = unsettled({name: read_rows(file, name, slice(None)) for name in names})
        if spec.record is not None:  # the record is written anew if any row is retried
            status = file.groups["record"].variables["status"][...]
            failed[:1] |= np.any(unsettled({"status": status}))
    now = identity(spec)
    changes = differences({**before, BUDGET: ""}, {**now, BUDGET: ""})
    if changes:
        raise RunError(
            f"{output}: is a result of another sweep or version:\n  "
            + "\n  ".join(changes)
            + "\nonly the impact budget may differ; compute the sweep anew with ",
            FORCE,
        )
    if spec.scene.measures.impact_budget < budget:
        raise RunError(
            f"{output}: was computed with an impact budget of {budget}, which "
            f"{spec.scene.measures.impact_budget} would not reach: raise it with ",
            IMPACT_BUDGET,
        )
    return before, tuple(np.flatnonzero(failed).tolist())


def _abandon_merged(directory: Path, before: Mapping[str, str], now: Mapping[str, str]) -> None:
    """Abandon a run that was killed after its rows had been written into the result."""
    manifest = read_manifest(directory)
    if manifest is not None and manifest.identity.get(AGAIN) != now[AGAIN]:
        made = {key: value for key, value in manifest.identity.items() if key != AGAIN}
        if made == before:
            abandon(directory)


def _digest(rows: tuple[int, ...]) -> str:
    digest = hashlib.blake2b(np.asarray(rows, np.int64).tobytes(), digest_size=8).hexdigest()
    return f"{len(rows)} (digest {digest})"


def _merged(run: KeptRun, retried: NDArray[np.int64]) -> Iterator[Columns]:
    """Yield the rows of the old result in blocks, with the retried ones in their places."""
    spec, design, fresh = run.job.spec, run.design, Stream(run.columns())
    names, size = list(no_rows(spec, design)), batch_size(spec)
    with result_file(run.output) as file:
        for start in range(0, design.realizations, size):
            rows = slice(start, min(start + size, design.realizations))
            columns = {name: read_rows(file, name, rows) for name in names}
            first, last = np.searchsorted(retried, (rows.start, rows.stop))
            for name, values in fresh.take(int(last - first)).items():
                columns[name][retried[first:last] - start] = values
            yield columns
