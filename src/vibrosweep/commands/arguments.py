"""Arguments that several commands take."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
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


def add_quiet(parser: argparse.ArgumentParser) -> None:
    """Add the option that leaves out what is printed besides errors."""
    parser.add_argument("-q", "--quiet", action="store_true", help="print errors only")


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add the option that prints one JSON object in place of lines."""
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object in place of lines"
    )


def say(options: argparse.Namespace, *lines: str) -> None:
    """Print lines, unless `options` request JSON or silence."""
    if lines and not (getattr(options, "quiet", False) or getattr(options, "json", False)):
        print("\n".join(lines), flush=True)


def tell(options: argparse.Namespace, facts: Mapping[str, Any]) -> None:
    """Print facts as one JSON object where `options` request it."""
    if options.json:
        import json

        print(json.dumps(_plain(facts), indent=2, ensure_ascii=False, allow_nan=False))


def _plain(value: Any) -> Any:
    """Return a value as JSON can hold it; numbers that are not finite become null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def some(number: int, thing: str) -> str:
    """Write a number of things: 1 particle, 2 particles."""
    return f"{number} {thing}{'' if number == 1 else 's'}"
