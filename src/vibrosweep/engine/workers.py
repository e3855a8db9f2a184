"""Threads for compiled kernels, which release the GIL, and memory that batches share."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Self

from vibrosweep.engine import compiling
from vibrosweep.kernels.cycles import Cycles, empty_cycles
from vibrosweep.kernels.statistics import KINDS, Kinds, Statistics, empty_statistics
from vibrosweep.kernels.unwritten import FLAG, require_written

TRAJECTORIES_PER_TASK = 1 << 16
# Ranges of a stream: long against the cost of a call, some 15 us, but short enough for balance
PIECES_PER_THREAD = 16
SMALLEST_PIECE, SMALL_PIECE, LARGEST_PIECE = 1 << 8, 1 << 12, 1 << 14  # trajectories
PERIODS_PER_PIECE = 3 << 16  # forcing periods of all trajectories of a small piece together

compiling.listen()


class Workers:
    """A pool of threads for kernels; a context manager.

    Parameters
    ----------
    threads
        Number of threads, at least 1.
    """

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._pool = ThreadPoolExecutor(threads)
        self._statistics = empty_statistics(0)
        self._cycles = empty_cycles(0)
        self._interrupted = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *exception: object) -> None:
        # a running kernel cannot be stopped: after an interruption do not wait for it
        self._interrupted = kind is not None
        self._pool.shutdown(wait=kind is None, cancel_futures=True)

    def statistics(self, trajectories: int, kinds: Kinds = KINDS) -> Statistics:
        """Return memory for statistics, the same at each call: new pages cost a third of a run."""
        if self._statistics.status.size < trajectories or self._statistics.kinds != kinds:
            self._statistics = empty_statistics(trajectories, kinds)
        _, totals, at_rest, status = self._statistics
        shape = len(kinds), trajectories
        totals = totals.ravel()[: shape[0] * shape[1]].reshape(shape)
        at_rest[:trajectories] = status[:trajectories] = FLAG
        return Statistics(kinds, totals, at_rest[:trajectories], status[:trajectories])

    def cycles(self, trajectories: int) -> Cycles:
        """Return memory for cycles, the same at each call."""
        if self._cycles.shape[1] < trajectories:
            self._cycles = empty_cycles(trajectories)
        fields = self._cycles.shape[0]
        return self._cycles.ravel()[: fields * trajectories].reshape(fields, trajectories)

    def run(self, task: Callable[[int, int], object], total: int, size: int, *results: Any) -> None:
        """Call ``task(first, last)`` for ranges of at most `size` that cover ``range(total)``.

        Raises a RunError if an array of the `results`, named tuples, is not filled.
        """
        size = max(1, min(size, -(-total // self.threads)))
        starts = range(0, total, size)
        for _ in self._pool.map(lambda first: task(first, min(first + size, total)), starts):
            pass
        for result in results:
            require_written(result)

    def stream(
        self, begin: Callable[[], Callable[[int, int], object]], total: int, periods: float
    ) -> None:
        """Let each thread take ranges of ``range(total)``, one after the other, until none is left.

        Each thread has its own ``task = begin()``.  It calls ``task(first, last)`` for each range,
        which may leave trajectories to the next call, and at the end ``task(total, total)``.
        A trajectory lasts for at most `periods` forcing periods.
        """
        small = min(SMALL_PIECE, max(SMALLEST_PIECE, PERIODS_PER_PIECE // max(1.0, periods)))
        piece = max(int(small), min(total // (PIECES_PER_THREAD * self.threads), LARGEST_PIECE))
        # a multiple of the number of threads, so that all have as many ranges if these last as long
        piece = math.ceil(total / (self.threads * math.ceil(total / (self.threads * piece))))
        starts = range(0, total, piece)
        # each thread has a first range of its own, so that no thread takes all
        first, others = starts[: self.threads], iter(starts[self.threads :])

        def work(first: int, task: Callable[[int, int], object]) -> None:
            for start in itertools.chain((first,), others):
                if self._interrupted:
                    return
                task(start, min(start + piece, total))
            task(total, total)

        for _ in self._pool.map(work, first, [begin() for _ in first]):
            pass
