"""What is computed while the page goes on."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any, TypeVar

T = TypeVar("T")


class Background:
    """A thread that computes for one visitor: one thing at a time, of those that wait the newest.

    What a kernel has begun it ends, for it cannot be interrupted.
    """

    def __init__(self) -> None:
        self._queue: SimpleQueue[tuple[Future[Any], Callable[[], Any]] | None] = SimpleQueue()
        self._given: Future[Any] | None = None
        self._begun: Future[Any] | None = None
        threading.Thread(target=self._run, daemon=True).start()

    @property
    def busy(self) -> bool:
        """Whether anything is still being computed, or waits for that."""
        return any(one is not None and not one.done() for one in (self._begun, self._given))

    def call(self, work: Callable[[], T]) -> Future[T]:
        """Compute something; what was given before and has not begun is given up."""
        self._give_up()
        self._given = future = Future[T]()
        self._queue.put((future, work))
        return future

    def close(self) -> None:
        """End the thread once what has begun is finished."""
        self._give_up()
        self._queue.put(None)

    def _give_up(self) -> None:
        if self._given is not None:
            self._given.cancel()

    def _run(self) -> None:
        while (given := self._queue.get()) is not None:
            future, work = given
            self._begun = future
            if future.set_running_or_notify_cancel():
                try:
                    future.set_result(work())
                except Exception as error:
                    future.set_exception(error)
