"""Chunks on the workers of a Dask cluster, each of which writes the parts that it computes.

Only numbers of chunks travel: what is finished stands in the run directory, on a file system that
all machines share.  So a worker that dies costs the chunks it was at, and after the death of the
scheduler or of this process the same call computes what is missing.
"""

from __future__ import annotations

import logging
import signal
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from vibrosweep.errors import RunError, VibrosweepError
from vibrosweep.runs.chunks import Job, Runner, Tick, compute_chunk

if TYPE_CHECKING:
    from distributed import Client, Future

__all__ = [
    "CHUNKS_PER_THREAD",
    "MissingDaskError",
    "connected",
    "dask_setup",
    "local_workers",
    "on_dask",
]

# Seconds until a scheduler answers, or is given up once it does not.
PATIENCE: Final = 30
# Seconds in which a part that a worker has written must be seen here: file servers may be slow.
VISIBLE_WITHIN: Final = 60.0
# A sweep is cut into so many chunks for each thread, so that all have about equally much to do.
CHUNKS_PER_THREAD: Final = 4
# So many chunks are handed out for each thread: it is never idle, and the scheduler never full.
AHEAD: Final = 3
GONE: Final = "the scheduler of the Dask cluster has gone"


class MissingDaskError(VibrosweepError, ImportError):
    """A cluster was asked for, and Dask is not installed."""


@contextmanager
def local_workers(count: int) -> Iterator[Client]:
    """Start worker processes of one thread each on this machine.

    Raises
    ------
    MissingDaskError
        Dask is not installed.
    RunError
        They do not start.
    """
    with _settings() as distributed:
        try:
            cluster = distributed.LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                memory_limit=None,
                silence_logs=False,
                preload=[__name__],
            )
        except (OSError, RuntimeError, TimeoutError) as error:
            raise RunError(f"{count} workers cannot be started here: {error}") from error
        with cluster, distributed.Client(cluster, set_as_default=False) as client:
            yield client


@contextmanager
def connected(address: str) -> Iterator[Client]:
    """Connect to the scheduler of a running cluster.

    Raises
    ------
    MissingDaskError
        Dask is not installed.
    RunError
        No scheduler answers.
    """
    with _settings() as distributed:
        try:
            client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise RunError(
                f"no Dask scheduler answers at {address} ({error or type(error).__name__}); check "
                f"the address, as in tcp://host:8786, and that dask scheduler runs there"
            ) from error
        with client:
            yield client


@contextmanager
def _settings() -> Iterator[Any]:
    """Import Dask, with settings that hold while it is used.

    Workers are started afresh and not forked: a fork would copy threads in the middle of their
    work.  What Dask logs of a lost worker is no news: the chunk is computed again.
    """
    try:
        import dask
        import distributed
    except ImportError as error:
        raise MissingDaskError(
            "workers and schedulers need dask.distributed, which is not installed: "
            'pip install "vibrosweep[cluster]"'
        ) from error
    settings = {
        "distributed.worker.multiprocessing-method": "spawn",
        "distributed.nanny.pre-spawn-environ.DASK_DISTRIBUTED__LOGGING__DISTRIBUTED": "critical",
        "distributed.comm.timeouts.connect": f"{PATIENCE}s",
    }
    handlers = logging.getLogger("distributed").handlers
    levels = [handler.level for handler in handlers]
    try:
        for handler in handlers:
            handler.setLevel(logging.CRITICAL + 1)
        with dask.config.set(settings):
            yield distributed
    finally:
        for handler, level in zip(handlers, levels, strict=True):
            handler.setLevel(level)


def dask_setup(worker: object) -> None:
    """Prepare a worker that `local_workers` starts; Dask finds this function by its name.

    A terminal sends an interruption to all processes at once: only the first one is to act on it.
    """
    for ending in (signal.SIGINT, signal.SIGHUP):
        signal.signal(ending, signal.SIG_IGN)


def on_dask(client: Client) -> Runner:
    """Return a runner that computes chunks on the workers of a cluster, each in one thread."""

    def run(job: Job, chunks: Sequence[int], tick: Tick) -> Mapping[int, str]:
        if job.spec.table is not None:  # workers stand in other directories
            job = replace(job, spec=replace(job.spec, table=job.spec.table.resolve()))
        waiting = _Chunks(client, job, list(reversed(chunks)))
        try:
            for size in waiting.sizes():
                tick(size)
        except VibrosweepError:
            raise
        except OSError as error:
            raise RunError(GONE) from error
        finally:
            waiting.cancel()
        _await_visible(job, set(chunks) - waiting.failed.keys())
        return waiting.failed

    return run


def _compute(job: Job, index: int) -> None:
    """Compute a chunk on a worker, unless one that died since has finished it."""
    if index not in job.parts.finished():
        compute_chunk(job, index, threads=1)


class _Chunks:
    """Chunks that are to be computed; a few of them are with the scheduler at a time."""

    def __init__(self, client: Client, job: Job, queue: list[int]) -> None:
        self.failed: dict[int, str] = {}
        self._client = client
        self._job = job
        self._queue = queue
        self._suspects: list[int] = []
        self._alone: int | None = None
        self._submitted: dict[Future, int] = {}

    def sizes(self) -> Iterator[int]:
        """Compute all; give the number of realizations of each chunk that is finished."""
        from distributed import as_completed

        done = as_completed(loop=self._client.loop, raise_errors=False)
        self._submit(done)
        for future in done:
            index = self._submitted.pop(future)
            size = self._judge(future, index)
            if size is not None:
                yield size
            self._submit(done)

    def _submit(self, done: Any) -> None:
        """Hand out as many chunks as keep all workers busy, and suspects one by one at the end."""
        threads = sum(self._client.nthreads().values())
        batch = min(len(self._queue), max(1, AHEAD * threads) - len(self._submitted))
        indices = [self._queue.pop() for _ in range(batch)]
        if not indices and not self._submitted and self._suspects:
            self._alone = self._suspects.pop()
            indices = [self._alone]
        for index in indices:
            future = self._client.submit(_compute, self._job, index, pure=False)
            self._submitted[future] = index
            done.add(future)

    def _judge(self, future: Future, index: int) -> int | None:
        """Return the size of a finished chunk; put others back, or note why they failed."""
        from distributed import KilledWorker

        if future.status == "finished":
            start, stop = self._job.manifest.bounds(index)
            return stop - start
        if future.status != "error":
            raise RunError(GONE)
        error = future.exception()
        if isinstance(error, VibrosweepError):
            raise error
        if isinstance(error, KilledWorker):
            # Dask gives up all chunks that were with four workers when these died; which of them
            # is to blame is seen once each is computed with no other at work.
            if index == self._alone:
                self.failed[index] = "the workers that computed it died, time after time"
            else:
                self._suspects.append(index)
        elif isinstance(error, ImportError) or "deserializ" in str(error):
            raise RunError(
                f"the cluster cannot run vibrosweep ({type(error).__name__}: {error}); install "
                f"the same version of vibrosweep for its scheduler and its workers as here"
            )
        else:
            self.failed[index] = f"{type(error).__name__}: {error}"
        return None

    def cancel(self) -> None:
        """Let what has not begun be forgotten."""
        if self._submitted and self._client.status == "running":
            with suppress(OSError):
                self._client.cancel(list(self._submitted), force=True)


def _await_visible(job: Job, chunks: set[int]) -> None:
    """Wait until the parts that workers have written are seen here."""
    until = time.monotonic() + VISIBLE_WITHIN
    while missing := chunks - job.parts.finished().keys():
        if time.monotonic() > until:
            raise RunError(
                f"{job.parts.directory}: {len(missing)} parts that workers have written are not "
                f"seen here; workers and this process need one file system that they share"
            )
        time.sleep(0.5)
