"""Threads for compiled kernels, which release the GIL, memory that batches share, and compiling.

A line on the terminal shows while a kernel is compiled for its first use.  During compilation
Python's garbage collector runs less often; it took a tenth of the time.
"""

from __future__ import annotations

import gc
import itertools
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Final, Self, TypeVar

from vibrosweep.kernels._numba import Listener, register
from vibrosweep.kernels.cycles import Cycles, empty_cycles
from vibrosweep.kernels.memory import FLAG, require_written
from vibrosweep.kernels.statistics import KINDS, Kinds, Statistics, empty_statistics
from vibrosweep.waiting import SECONDS, WaitingLine

__all__ = ["Workers"]

T = TypeVar("T")
R = TypeVar("R")

TRAJECTORIES_PER_TASK = 1 << 16
# Ranges of a stream: long against the cost of a call, some 15 us, but short enough for balance
PIECES_PER_THREAD = 16
SMALLEST_PIECE, SMALL_PIECE, LARGEST_PIECE = 1 << 8, 1 << 12, 1 << 14  # trajectories
PERIODS_PER_PIECE = 3 << 16  # forcing periods of all trajectories of a small piece together

# Results of `in_order` for each thread: one that is computed, and one that waits for its turn
AHEAD = 2


class Workers:
    """A pool of threads for kernels; a context manager.

    Parameters
    ----------
    threads
        Number of threads, at least 1.
    within
        Workers in one of whose threads this one computes, without further threads.
    """

    def __init__(self, threads: int, within: Workers | None = None) -> None:
        self.threads = threads
        self._pool = None if within else ThreadPoolExecutor(threads)
        self._statistics = empty_statistics(0)
        self._cycles = empty_cycles(0)
        self._interrupted: threading.Event = within._interrupted if within else threading.Event()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *exception: object) -> None:
        # a running kernel cannot be stopped: after an interruption do not wait for it
        if kind is not None:
            self._interrupted.set()
        if self._pool is not None:
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
        self._share(lambda first: task(first, min(first + size, total)), range(0, total, size))
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
        # each thread has its own first range, so that no thread takes all
        first, others = starts[: self.threads], iter(starts[self.threads :])

        def work(first: int, task: Callable[[int, int], object]) -> None:
            for start in itertools.chain((first,), others):
                if self._interrupted.is_set():
                    return
                task(start, min(start + piece, total))
            task(total, total)

        self._share(work, first, [begin() for _ in first])

    def in_order(self, compute: Callable[[Workers, T], R], items: Iterable[T]) -> Iterator[R]:
        """Yield ``compute(worker, item)`` for each item, each on a separate thread.

        Results come in the order of the items, of which no more than the next few are taken and
        computed while the caller uses a result.
        """
        assert self._pool is not None
        idle = [Workers(1, self) for _ in range(self.threads)]

        def work(item: T) -> R:
            worker = idle.pop()
            try:
                return compute(worker, item)
            finally:
                idle.append(worker)

        begun: deque[Future[R]] = deque()
        for item in items:
            begun.append(self._pool.submit(work, item))
            if len(begun) == AHEAD * self.threads:
                yield begun.popleft().result()
        while begun:
            yield begun.popleft().result()

    def _share(self, work: Callable[..., object], *arguments: Iterable[Any]) -> None:
        """Call a function for all arguments, on all threads, until one raises an exception."""
        if self._pool is not None:
            deque(self._pool.map(work, *arguments), maxlen=0)
            return
        for one in zip(*arguments, strict=True):
            if self._interrupted.is_set():
                return
            work(*one)


PACKAGE: Final = "vibrosweep."
COLLECT_AFTER: Final = 100_000  # new objects; Python's default is 700


class Notice(Listener):  # type: ignore[misc]
    """Listener that numba calls at the beginning and the end of each compilation."""

    def __init__(self, every: float = SECONDS) -> None:
        self._every = every  # seconds between versions of the line
        self._depth = 0  # nested compilations, from that of a kernel inwards
        self._line: WaitingLine | None = None
        self._collecting = gc.get_threshold()
        self._began = 0.0
        self.seconds = 0.0  # of compilation so far

    def on_start(self, event: Any) -> None:
        """Show a line when the compilation of a kernel of this package begins."""
        function = event.data["dispatcher"].py_func
        if not self._depth and not str(function.__module__).startswith(PACKAGE):
            return
        self._depth += 1
        if self._depth > 1:
            return
        self._began = time.perf_counter()
        self._collecting = youngest, *older = gc.get_threshold()
        gc.set_threshold(max(COLLECT_AFTER, youngest) if youngest else 0, *older)  # 0: off
        self._line = WaitingLine(
            f"compiling {function.__name__} (first use only; up to 30 s each)", self._every
        )

    def on_end(self, event: Any) -> None:
        """Erase the line when the compilation of the kernel has ended."""
        if not self._depth:
            return
        self._depth -= 1
        if not self._depth:
            self.seconds += time.perf_counter() - self._began
            gc.set_threshold(*self._collecting)
            if self._line:
                self._line.end()


_notice: Final = Notice()


register("numba:compile", _notice)  # numba tells of compilations


def seconds_of_compiling() -> float:
    """Return for how many seconds this process has compiled kernels until now."""
    return _notice.seconds
