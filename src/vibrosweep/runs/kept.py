"""Resumable runs, which keep finished chunks and compute the missing ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from vibrosweep.engine.workers import Workers
from vibrosweep.errors import Interruption, OutputError, RunError, TakenOutputError
from vibrosweep.mistakes import FORCE, OUTPUT, Text
from vibrosweep.runs.chunks import Job, Runner, compute_chunk, in_process
from vibrosweep.runs.identity import differences
from vibrosweep.runs.progress import Advance
from vibrosweep.runs.result import write_result
from vibrosweep.runs.summary import Summary
from vibrosweep.scene.realizations import Realizations
from vibrosweep.store.disk import reporting
from vibrosweep.store.parts import Columns, Manifest, Parts, read_manifest
from vibrosweep.store.rundir import abandon, empty


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
            ", or throw it away and start again with ",
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
            f"{finished} of {manifest.chunks} chunks are finished and kept in "
            f"{self.directory}: run the same command ",
            again,
            "again to continue",
        )
