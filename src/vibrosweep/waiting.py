"""A line on a terminal or in a notebook that shows which task is taking long.

If standard error is neither, nothing is written.  ``TQDM_DISABLE=1`` silences the line, as it does
the progress bars.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
from typing import Final, Self

SECONDS: Final = 1.0  # before the line appears, and between its updates


class WaitingLine:
    """Line with a task and the seconds it has taken, rewritten regularly until its end."""

    def __init__(self, words: str, every: float = SECONDS) -> None:
        self._words, self._every = words, every
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._show, daemon=True)
        if is_watched() and os.environ.get("TQDM_DISABLE") != "1":
            self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.end()

    def end(self) -> None:
        """Erase the line."""
        self._done.set()
        if self._thread.is_alive():
            self._thread.join()

    def _show(self) -> None:
        began, line = time.monotonic(), ""
        while not self._done.wait(self._every):
            line = f"vibrosweep: {self._words}: {time.monotonic() - began:.0f} s"
            _write(f"\r{line}")
        if line:
            _write(f"\r{' ' * len(line)}\r")


def is_watched() -> bool:
    """Return whether a person sees standard error: on a terminal, or in a notebook."""
    return (sys.stderr is not None and sys.stderr.isatty()) or "ipykernel" in sys.modules


def _write(text: str) -> None:
    with contextlib.suppress(OSError, ValueError):  # a closed terminal must not end a computation
        print(text, end="", file=sys.stderr, flush=True)
