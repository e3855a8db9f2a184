"""Every mistake a user can make, as one family of exceptions.

Each message is one clear text that names the file, the key, the value, what is allowed and what
to do.  The command line prints it and exits with code 2; no traceback is shown.
"""

from __future__ import annotations

__all__ = [
    "DataError",
    "Interruption",
    "OutputError",
    "ParameterError",
    "RunError",
    "SpecError",
    "TableError",
    "TrackError",
    "VibrosweepError",
]


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


class DataError(VibrosweepError, ValueError):
    """A result file cannot be read, or lacks a variable that was asked of it."""


class RunError(VibrosweepError, RuntimeError):
    """Another run or an unfinished one stands in the way, or chunks of a run failed."""


class Interruption(KeyboardInterrupt):
    """An interruption, with a sentence on what was kept."""


class TrackError(VibrosweepError, ValueError):
    """Tracks of a camera cannot be read, or are no tracks of bouncing particles."""
