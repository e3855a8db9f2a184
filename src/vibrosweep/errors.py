"""Every mistake a user can make, as one family of exceptions; and what is warned of.

Each message is one clear text that names the file, the key, the value, what is allowed and what
to do.  The command line prints it, with its own options, and exits with code 2; no traceback is
shown.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

__all__ = [
    "OPTIONS",
    "DataError",
    "ExistingOutputError",
    "Interruption",
    "OutputError",
    "ParameterError",
    "RunError",
    "ShortObservationWarning",
    "SpecError",
    "TableError",
    "TakenOutputError",
    "TrackError",
    "VibrosweepError",
]


# Messages advise arguments as Python spells them; the command line prints its own options instead.
OPTIONS: Final[Mapping[str, str]] = {
    "output=": "-o",
    "force=True": "--force",
    "chunk=": "--chunk",
    "impact_budget=": "--impact-budget",
}


class VibrosweepError(Exception):
    """Base of all errors that a user can cause and mend."""


class ParameterError(VibrosweepError, ValueError):
    """A physical parameter is missing, of the wrong type or outside its range."""


class SpecError(VibrosweepError, ValueError):
    """A sweep file cannot be read or holds one or more mistakes (all are listed)."""


class TableError(VibrosweepError, ValueError):
    """A table of realizations cannot be read, lacks a column or holds a bad value."""


class OutputError(VibrosweepError, OSError):
    """The output cannot be written, or exists already."""


class ExistingOutputError(OutputError):
    """The output exists already.

    Parameters
    ----------
    path
        The output.
    what
        What it is, in words, where that is known.
    """

    def __init__(self, path: Path, what: str = "") -> None:
        end = "" if what.endswith("\n") else "; "
        super().__init__(
            f"{path}: exists and is kept{what and ': '}{what}{end}write to another file with "
            f"output=, or replace it with force=True"
        )
        self.path = path


class TakenOutputError(OutputError):
    """Another program wrote the output meanwhile; the result was saved under another name."""

    def __init__(self, path: Path, beside: Path) -> None:
        super().__init__(
            f"{path}: appeared while the result was computed, and is kept; the result is complete "
            f"in {beside}"
        )


class DataError(VibrosweepError, ValueError):
    """A result file cannot be read, or lacks a variable that was asked of it."""


class RunError(VibrosweepError, RuntimeError):
    """Another run or an unfinished run blocks the output, or chunks of a run failed."""


class Interruption(KeyboardInterrupt):
    """An interruption, with a sentence on what was kept."""


class TrackError(VibrosweepError, ValueError):
    """Tracks of a camera cannot be read, or are no tracks of bouncing particles."""


class ShortObservationWarning(UserWarning):
    """Orbits are observed for too short a time to tell what they settle on."""
