"""Arguments that several commands take."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def positive(text: str) -> int:
    """Read a whole number of at least 1."""
    return whole(text, 1)


def whole(text: str, low: int = 0, high: int | None = None) -> int:
    """Read a whole number of at least `low`, and at most `high`."""
    value = int(text) if text.isdecimal() else -1
    if value < low or (high is not None and value > high):
        upper = "" if high is None else f" and at most {high}"
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least {low}{upper}")
    return value


def add_sweep(parser: argparse.ArgumentParser) -> None:
    """Add the sweep file and the result that is computed from it."""
    parser.add_argument("spec", metavar="SPEC.toml", type=Path, help="the sweep file")
    parser.add_argument(
        "-o", "--output", metavar="OUT.h5", type=Path, help="default: the name of the sweep file"
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
