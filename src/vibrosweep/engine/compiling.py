"""A line on the terminal while a kernel is compiled for its first use, and how long this takes.

During compilation Python's garbage collector runs less often; it took a tenth of the time.
"""

from __future__ import annotations

import gc
import time
from typing import Any, Final

from vibrosweep.kernels._numba import Listener, register
from vibrosweep.waiting import SECONDS, Line

PACKAGE: Final = "vibrosweep."
COLLECT_AFTER: Final = 100_000  # new objects; Python's default is 700


class Notice(Listener):  # type: ignore[misc]
    """Listener that numba calls at the beginning and the end of each compilation."""

    def __init__(self, every: float = SECONDS) -> None:
        self._every = every  # seconds between versions of the line
        self._depth = 0  # nested compilations, from that of a kernel inwards
        self._line: Line | None = None
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
        self._line = Line(
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


def listen() -> None:
    """Let numba tell of compilations."""
    register("numba:compile", _notice)


def seconds() -> float:
    """Return for how many seconds this process has compiled kernels until now."""
    return _notice.seconds
