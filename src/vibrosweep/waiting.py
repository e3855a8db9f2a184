"""What a user waits for: modules loaded at first use, slow tasks, and the progress of a run.

The line is shown on a terminal and in a notebook only; ``TQDM_DISABLE=1`` silences it, as it does
the progress bars.
"""

from __future__ import annotations

import os
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib import import_module
from typing import Any, Final, Protocol, Self, TextIO

__all__ = ["Advance", "WaitingLine", "lazily", "reporting", "silent"]

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
    with suppress(OSError, ValueError):  # a closed terminal must not end a computation
        print(text, end="", file=sys.stderr, flush=True)


def lazily(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package.

    `homes` gives the module that defines each public name; a name that is the last part of its
    module's name stands for the module itself.  No name may be that of another module of the
    package: as soon as that module is imported, Python finds it first.
    """

    def find(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        home = sys.modules.get(homes[name])
        if home is None:
            with WaitingLine("loading"):
                home = import_module(homes[name])
        return home if homes[name].endswith(f".{name}") else getattr(home, name)

    return find


SECONDS_BETWEEN_LINES: Final = 10.0
SECONDS_BEFORE_BAR: Final = 0.5


class Advance(Protocol):
    """Called with the number of finished realizations and the total.

    The first call tells what was there before; speeds count what has been finished since.
    """

    def __call__(self, done: int, total: int, /) -> object:
        """Report progress."""


def silent(done: int, total: int, /) -> None:
    """Report nothing."""


@contextmanager
def reporting(
    stream: TextIO,
    things: str = "realizations",
    delay: float = SECONDS_BEFORE_BAR,
    *,
    quiet: bool = False,
) -> Iterator[Advance]:
    """Report progress, speed and remaining time of a run on `stream`, counted in `things`.

    Runs of less than `delay` seconds, and those that should be `quiet`, report nothing.
    """
    if quiet:
        yield silent
        return
    if not stream.isatty():
        yield _Lines(stream, things)
        return
    from tqdm import tqdm  # imported only for a terminal

    with _following(tqdm(file=stream, unit=f" {things}", leave=False, delay=delay)) as advance:
        yield advance


@contextmanager
def showing(wanted: bool | None) -> Iterator[Advance]:
    """Show a bar that counts realizations, for functions called from Python.

    None shows it in a notebook and on a terminal only.
    """
    if wanted is None:
        wanted = is_watched()
    if not wanted:
        yield silent
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # without ipywidgets the bar is text
        from tqdm.auto import tqdm
    with _following(tqdm(unit=" realizations", leave=False, delay=SECONDS_BEFORE_BAR)) as advance:
        yield advance


@contextmanager
def _following(bar: Any) -> Iterator[Advance]:
    """Let a bar follow a run, and close it at the end."""
    told = False

    def advance(done: int, total: int, /) -> None:
        nonlocal told
        with suppress(OSError):  # a closed terminal must not end the run
            bar.total = total
            if not told:  # the bar would count this as done since it was made
                bar.initial = bar.n = bar.last_print_n = done
                bar.start_t = bar.last_print_t = time.time()
                told = True
            bar.update(done - bar.n)

    try:
        yield advance
    finally:
        with suppress(OSError):
            bar.close()


class _Lines:
    """Occasional lines of text."""

    def __init__(self, stream: TextIO, things: str) -> None:
        self.stream, self.things = stream, things
        self.last = time.monotonic()
        self.began: tuple[int, float] | None = None

    def __call__(self, done: int, total: int, /) -> None:
        now = time.monotonic()
        before, since = self.began = self.began or (done, now)
        if now - self.last < SECONDS_BETWEEN_LINES or done == before or now == since:
            return
        self.last = now
        rate = (done - before) / (now - since)
        with suppress(OSError):  # a log that cannot be written must not end the run
            print(
                f"{done} of {total} {self.things}, {rate:.4g} per second, "
                f"{(total - done) / rate:.0f} s remaining",
                file=self.stream,
                flush=True,
            )
