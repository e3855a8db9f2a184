"""Arguments that several commands take."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from vibrosweep.mistakes import cut
from vibrosweep.system import MOST_THREADS

MOST: Final = 2**53  # the largest count that a double still holds


def positive(text: str) -> int:
    """Read a whole number of at least 1."""
    return whole(text, 1)


def threads(text: str) -> int:
    """Read a number of threads or processes."""
    return whole(text, 1, MOST_THREADS)


def whole(text: str, low: int = 0, high: int = MOST) -> int:
    """Read a whole number of at least `low`, and at most `high`."""
    # Python refuses to read thousands of digits
    value = int(text) if text.isdecimal() and len(text) < 1000 else -1
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(
            f"{cut(text)!r} is not a whole number of at least {low} and at most {high}"
        )
    return value


def output_file(text: str) -> Path:
    """Read the path of a file to write."""
    path = Path(text)
    if not text or path.name in ("", ".."):
        raise argparse.ArgumentTypeError(f"{text!r} is not the name of a file")
    return path


def directory(text: str) -> Path:
    """Read the path of a directory."""
    if not text:
        raise argparse.ArgumentTypeError("'' is not the name of a directory")
    return Path(text)


def some(number: int, thing: str) -> str:
    """Write a number of things: 1 particle, 2 particles."""
    return f"{number} {thing}{'' if number == 1 else 's'}"
