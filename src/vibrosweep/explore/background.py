"""What is computed while the page goes on: kernels that are not ready yet, and what takes long."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any, TypeVar

from vibrosweep.explore.choice import Choice

T = TypeVar("T")


class Background:
    """A thread that computes in turn what it is given, for all pages of a server."""

    def __init__(self) -> None:
        self._queue: SimpleQueue[tuple[Future[Any], Callable[[], Any]]] = SimpleQueue()
        self._prepared: dict[tuple[str, str, bool], Future[Any]] = {}
        self._last: Future[Any] | None = None
        threading.Thread(target=self._run, daemon=True).start()

    @property
    def busy(self) -> bool:
        """Whether anything is still being computed."""
        return self._last is not None and not self._last.done()

    def call(self, work: Callable[[], T]) -> Future[T]:
        """Compute something, after all that was given before."""
        self._last = future = Future[T]()
        self._queue.put((future, work))
        return future

    def prepare(self, choice: Choice) -> Future[Any]:
        """Load the kernels that a choice is simulated with, or compile them at their first use."""
        known = self._prepared.get(choice.variant)
        # what cannot be computed may have stopped before its kernels were ready
        if known is None or (known.done() and known.exception() is not None):
            known = self._prepared[choice.variant] = self.call(choice.simulate)
        return known

    def _run(self) -> None:
        while True:
            future, work = self._queue.get()
            try:
                future.set_result(work())
            except Exception as error:
                future.set_exception(error)
