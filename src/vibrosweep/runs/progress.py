"""Progress of a run: a bar on a terminal or in a notebook, plain lines elsewhere."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, Final, Protocol, TextIO

from vibrosweep.waiting import is_watched

__all__ = ["Advance", "silent"]

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
