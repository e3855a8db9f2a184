"""Arguments that several commands take."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, Final

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


def add_sweep(parser: argparse.ArgumentParser) -> None:
    """Add the sweep file and the result that is computed from it."""
    parser.add_argument("spec", metavar="SPEC.toml", type=Path, help="the sweep file")
    parser.add_argument(
        "-o",
        "--output",
        metavar="OUT.h5",
        type=output_file,
        help="default: the name of the sweep file",
    )


def output_of(options: argparse.Namespace) -> Path:
    """Return the result that the options of `add_sweep` name."""
    output: Path = options.output or Path(f"{options.spec.stem}.h5")
    return output


def add_lines(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that decide which lines of orbits are followed, and how far."""
    for name, words, default in (
        ("impacts", "largest number of impacts of an orbit", 1),
        ("periods", "largest number of its forcing periods", 1),
        ("doublings", "number of successive doublings whose new orbits are followed", 0),
        ("points", "largest number of points of a line in each direction", 1000),
    ):
        kind = whole if default == 0 else positive
        text = f"{words}; default: {default}"
        parser.add_argument(f"--{name}", metavar="N", type=kind, default=default, help=text)


def lines_of(options: argparse.Namespace) -> dict[str, Any]:
    """Return the options of `add_lines`, as the analyses of lines take them."""
    wanted = options.impacts, options.periods
    return {"wanted": wanted, "doublings": options.doublings, "points": options.points}


def some(number: int, thing: str) -> str:
    """Write a number of things: 1 particle, 2 particles."""
    return f"{number} {thing}{'' if number == 1 else 's'}"
