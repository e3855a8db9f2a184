"""A line on a terminal or in a notebook while a kernel is compiled for its first use.

Other streams stay as they are.  ``TQDM_DISABLE=1`` silences it, as it does the bars.  Meanwhile
Python looks for unused cycles of objects less often, which had taken a tenth of the time.
"""

from __future__ import annotations

import contextlib
import gc
import os
import sys
import threading
import time
from typing import Final

from numba.core.event import Event, Listener, register

SECONDS: Final = 1.0  # before the line appears, and between its updates
OWN: Final = "vibrosweep."
COLLECT_AFTER: Final = 100_000  # new objects; Python's default is 700


class Notice(Listener):  # type: ignore[misc]
    """Listener that numba calls when it begins and ends to compile a kernel, or a piece of one."""

    def __init__(self) -> None:
        self._depth = 0  # pieces within pieces of a kernel that is compiled now
        self._made = threading.Event()
        self._thread = threading.Thread()
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
        if _is_seen():
            self._made = threading.Event()
            told = function.__name__, self._made
            self._thread = threading.Thread(target=_tell, args=told, daemon=True)
            self._thread.start()

    def on_end(self, event: Event) -> None:
        """Take the line away."""
        if not self._depth:
            return
        self._depth -= 1
        if not self._depth:
            gc.set_threshold(*self._collecting)
            self._made.set()
            if self._thread.is_alive():
                self._thread.join()


def _is_seen() -> bool:
    terminal = sys.stderr is not None and sys.stderr.isatty()
    return (terminal or "ipykernel" in sys.modules) and os.environ.get("TQDM_DISABLE") != "1"


def _tell(name: str, made: threading.Event) -> None:
    """Write every second which kernel is compiled, and for how long, over the line before."""
    began, line = time.monotonic(), ""
    while not made.wait(SECONDS):
        passed = time.monotonic() - began
        line = f"vibrosweep: compiling {name} (first use only; up to 30 s each): {passed:.0f} s"
        _write(f"\r{line}")
    if line:
        _write(f"\r{' ' * len(line)}\r")


def _write(text: str) -> None:
    with contextlib.suppress(OSError, ValueError):  # a closed terminal must not end a computation
        print(text, end="", file=sys.stderr, flush=True)


def listen() -> None:
    """Register a `Notice` with numba."""
    register("numba:compile", Notice())
