"""Chunks computed by the workers of a Dask cluster, which write the parts themselves.

Only chunk numbers return over the network: finished chunks are files in the run directory, on a
file system that all machines share.  If a worker dies, only the chunks that it was computing are
lost; if the scheduler or this process dies, the same call computes the missing chunks.
"""

from __future__ import annotations

import logging
import signal
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from vibrosweep.errors import RunError, VibrosweepError
from vibrosweep.runs.chunks import Job, Runner, Tick, compute_chunk

if TYPE_CHECKING:
    from distributed import Client, Future

# Seconds to wait for an answer from the scheduler
PATIENCE: Final = 30
# Seconds to wait for a new worker once all have gone.  Dask restarts a local worker within seconds,
# unless it died while it was starting.  Workers of a batch system may have to queue.
LOCAL_ABSENCE: Final = 120.0
ABSENCE: Final = 1800.0
POLL: Final = 0.05  # seconds between checks of futures
LOOK: Final = 1.0  # seconds between checks of workers
# Seconds until a part written by a worker must be visible here: file servers may be slow
VISIBLE_WITHIN: Final = 60.0
# Chunks per thread into which a sweep is cut, so that all threads get about equal work
CHUNKS_PER_THREAD: Final = 4
# Chunks per thread that are submitted ahead: no thread is idle, and the scheduler's queue is short
AHEAD: Final = 3
GONE: Final = "the scheduler of the Dask cluster is gone"


class MissingDaskError(VibrosweepError, ImportError):
    """Dask, which a cluster needs, is not installed."""


@contextmanager
def local_workers(count: int) -> Iterator[Client]:
    """Start worker processes of one thread each on this machine.

    Raises a MissingDaskError without Dask, and a RunError if the workers do not start.
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
        try:
            with distributed.Client(cluster, set_as_default=False) as client:
                yield client
        finally:
            try:
                cluster.close(timeout=PATIENCE)
            except TimeoutError:  # a worker that never started does not close either
                logging.getLogger("distributed.nanny").setLevel(logging.CRITICAL + 1)


@contextmanager
def connected(address: str) -> Iterator[Client]:
    """Connect to the scheduler of a running cluster.

    Raises a MissingDaskError without Dask, and a RunError if no scheduler answers.
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
    """Import Dask, and change its settings for the time of the run.

    Workers are spawned, not forked: a fork would copy running threads.  Dask's messages about lost
    workers are silenced, because lost chunks are computed again.
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

    A terminal sends Ctrl-C to all processes at once: only the main process must act on it.
    """
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):  # Windows has no SIGHUP
            signal.signal(getattr(signal, name), signal.SIG_IGN)


def on_dask(client: Client, absence: float = ABSENCE) -> Runner:
    """Return a runner that computes chunks on the workers of a cluster, each in one thread.

    The run waits for a first worker without limit.  If all workers have gone, it waits `absence`
    seconds for a new one and then ends with a RunError.
    """

    def run(job: Job, chunks: Sequence[int], tick: Tick) -> Mapping[int, str]:
        table = job.spec.design.table
        if isinstance(table, Path):  # workers have other working directories
            design = replace(job.spec.design, table=table.resolve())
            job = replace(job, spec=replace(job.spec, design=design))
        waiting = _Chunks(client, job, list(reversed(chunks)), absence)
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
    """Compute a chunk on a worker, unless another worker finished it before it died."""
    if index not in job.parts.finished():
        compute_chunk(job, index, threads=1)


class _Chunks:
    """The chunks to compute; only a few of them are submitted to the scheduler at a time."""

    def __init__(self, client: Client, job: Job, queue: list[int], absence: float) -> None:
        self.failed: dict[int, str] = {}
        self._client = client
        self._job = job
        self._queue = queue
        self._absence = absence
        self._seen: float | None = None
        self._suspects: list[int] = []
        self._alone: int | None = None
        self._submitted: dict[Future, int] = {}

    def sizes(self) -> Iterator[int]:
        """Compute all chunks; yield the number of realizations of each finished chunk."""
        from distributed import as_completed

        done = as_completed(loop=self._client.loop, raise_errors=False)
        self._submit(done)
        while self._submitted:
            self._await(done)
            future = next(done)
            index = self._submitted.pop(future)
            size = self._judge(future, index)
            if size is not None:
                yield size
            self._submit(done)

    def _await(self, done: Any) -> None:
        """Wait until a chunk has ended; raise a RunError if all workers stay away too long."""
        looked = time.monotonic()
        while not done.has_ready():
            time.sleep(POLL)
            now = time.monotonic()
            if now - looked < LOOK:
                continue
            looked = now
            if not self._threads() and self._seen is not None and now - self._seen > self._absence:
                raise RunError(
                    f"all workers of the Dask cluster are gone, and no new one has arrived for "
                    f"{self._absence:.0f} s"
                )

    def _threads(self) -> int:
        """Return the number of threads of all workers; note the time if there are any."""
        threads: int = sum(self._client.nthreads().values())
        if threads:
            self._seen = time.monotonic()
        return threads

    def _submit(self, done: Any) -> None:
        """Submit enough chunks to keep all workers busy; at the end, suspects one at a time."""
        threads = self._threads()
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
        """Return the size of a finished chunk; requeue a lost one, note why another failed."""
        from distributed import KilledWorker

        if future.status == "finished":
            start, stop = self._job.parts.manifest.bounds(index)
            return stop - start
        if future.status in ("pending", "lost"):  # its worker has died since it ended
            self._queue.append(index)
            return None
        if future.status != "error":
            raise RunError(GONE)
        error = future.exception()
        if isinstance(error, VibrosweepError):
            raise error
        if isinstance(error, KilledWorker):
            # Dask gives up a chunk once four workers that held it have died, even if they were
            # computing another one.  Computed alone, a chunk shows whether it kills its worker.
            if index == self._alone:
                self.failed[index] = "the workers that computed it died repeatedly"
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
        """Cancel the chunks that no worker has begun."""
        if self._submitted and self._client.status == "running":
            with suppress(OSError):
                self._client.cancel(list(self._submitted), force=True)


def _await_visible(job: Job, chunks: set[int]) -> None:
    """Wait until the parts written by workers are visible here."""
    until = time.monotonic() + VISIBLE_WITHIN
    while missing := chunks - job.parts.finished().keys():
        if time.monotonic() > until:
            raise RunError(
                f"{job.parts.directory}: {len(missing)} parts written by workers are not "
                f"visible here; workers and this process must share one file system"
            )
        time.sleep(0.5)
