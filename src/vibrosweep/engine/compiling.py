"""A line while a kernel is compiled for its first use.

Meanwhile Python looks for unused cycles of objects less often, which had taken a tenth of the time.
"""

from __future__ import annotations

import gc
from typing import Final

from numba.core.event import Event, Listener, register

from vibrosweep.waiting import Line

OWN: Final = "vibrosweep."
COLLECT_AFTER: Final = 100_000  # new objects; Python's default is 700


class Notice(Listener):  # type: ignore[misc]
    """Listener that numba calls when it begins and ends to compile a kernel, or a piece of one."""

    def __init__(self) -> None:
        self._depth = 0  # pieces within pieces of a kernel that is compiled now
        self._line: Line | None = None
        self._collecting = gc.get_threshold()

    def on_start(self, event: Event) -> None:
        """Start the clock when a kernel of this package begins to compile."""
        function = event.data["dispatcher"].py_func
        if not self._depth and not str(function.__module__).startswith(OWN):
            return
        self._depth += 1
        if self._depth > 1:
            return
        self._collecting = often, *seldom = gc.get_threshold()
        gc.set_threshold(max(COLLECT_AFTER, often) if often else 0, *seldom)  # 0: switched off
        self._line = Line(f"compiling {function.__name__} (first use only; up to 30 s each)")

    def on_end(self, event: Event) -> None:
        """Take the line away."""
        if not self._depth:
            return
        self._depth -= 1
        if not self._depth:
            gc.set_threshold(*self._collecting)
            if self._line:
                self._line.end()


def listen() -> None:
    """Register a `Notice` with numba."""
    register("numba:compile", Notice())
