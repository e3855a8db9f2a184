"""Computations that run while the page stays responsive."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

T = TypeVar("T")


class Background:
    """A thread that computes for one visitor, one task at a time; only the newest task waits.

    A task that has begun runs to its end, because a kernel cannot be interrupted.
    """

    def __init__(self) -> None:
        self._executor = ThreadPoolExecutor(max_workers=1)
        self._tasks: list[Future[Any]] = []

    @property
    def busy(self) -> bool:
        """True while a task runs or waits."""
        return not all(task.done() for task in self._tasks)

    def call(self, work: Callable[[], T]) -> Future[T]:
        """Start a task; an earlier task that has not begun is cancelled."""
        for task in self._tasks:
            task.cancel()
        task = self._executor.submit(self._perform, work)
        self._tasks = [*(earlier for earlier in self._tasks if not earlier.done()), task]
        return task

    def _perform(self, work: Callable[[], T]) -> T:
        # a method, so that a running task keeps this object in the server's weak set
        return work()

    def close(self) -> None:
        """End the thread once the running task is finished."""
        self._executor.shutdown(wait=False, cancel_futures=True)
