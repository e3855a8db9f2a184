"""Exceptions for mistakes of users, all derived from `VibrosweepError`, and warnings.

Each message is one clear text that names the file, the key, the value, what is allowed and what
to do.  The command line prints it, naming its own options, and exits with code 2 and without a
traceback.  Mistakes in a description are held as data too (`VibrosweepError.mistakes`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from numbers import Integral, Real
from pathlib import Path

from vibrosweep.mistakes import (
    FORCE,
    OUTPUT,
    PYTHON,
    Dialect,
    Mistake,
    Mistakes,
    Text,
    Value,
    argument,
)

__all__ = [
    "DataError",
    "ExistingOutputError",
    "Interruption",
    "OtherKernelsWarning",
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


def __dir__() -> list[str]:
    return sorted(__all__)


class _InDialect(BaseException):
    """An exception whose message can be written again in another dialect."""

    def __init__(self, *parts: Text, dialect: Dialect = PYTHON) -> None:
        super().__init__(dialect.write(parts))
        self.parts = parts

    def write_again(self, parts: Iterable[Text]) -> None:
        """Replace the message."""
        self.parts = (*parts,)
        self.args = (PYTHON.write(self.parts),)


class VibrosweepError(_InDialect, Exception):
    """Base of all errors that a user can cause and correct."""

    @property
    def mistakes(self) -> tuple[Mistake, ...]:
        """Mistakes that the message lists: key, value, what is allowed, remedy."""
        return tuple(part for part in self.parts if isinstance(part, Mistake))


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
        Sentence that describes it, if known.
    """

    def __init__(self, path: Path, what: str = "") -> None:
        end = "" if what.endswith("\n") else "; "
        super().__init__(
            f"{path}: exists and was not replaced{what and ': '}{what}{end}write to another file ",
            *("with ", OUTPUT, ", or replace it with ", FORCE),
        )
        self.path = path


class TakenOutputError(OutputError):
    """Another program wrote the output meanwhile; the result was saved under another name."""

    def __init__(self, path: Path, beside: Path) -> None:
        super().__init__(
            f"{path}: appeared while the result was computed, and was not replaced; the result "
            f"is complete in {beside}"
        )


class DataError(VibrosweepError, ValueError):
    """A result file cannot be read, or lacks a requested variable."""


class RunError(VibrosweepError, RuntimeError):
    """Another run or an unfinished run blocks the output, or chunks of a run failed."""


class Interruption(_InDialect, KeyboardInterrupt):
    """The user interrupted a computation; the message says what was kept."""


class TrackError(VibrosweepError, ValueError):
    """Tracks of a camera cannot be read, or are not those of bouncing particles."""


class OtherKernelsWarning(UserWarning):
    """A result is used that was computed with other kernels."""


class ShortObservationWarning(UserWarning):
    """The observation is too short to tell which attractors the orbits settle on."""


def require_one_of(
    name: str, value: object, names: Collection[str], error: type[VibrosweepError] = ParameterError
) -> None:
    """Raise an error unless the value of an argument is one of these names."""
    if not isinstance(value, str) or value not in names:
        raise error(f"{name} = {value!r}: must be one of {', '.join(names)}")


def count(name: str, value: object, least: int = 1, most: int | None = None) -> int:
    """Return a whole number as a Python int, because numpy integers can overflow.

    Raises a ParameterError unless it is an int or a numpy integer, from `least` to `most`.
    """
    if (
        not isinstance(value, Integral)
        or isinstance(value, bool)
        or int(value) < least
        or (most is not None and int(value) > most)
    ):
        upper = "" if most is None else f" and at most {most}"
        rule = f": must be a whole number, at least {least}{upper}"
        raise ParameterError(argument(name), Value(value), rule)
    return int(value)


def finite(name: str, value: object) -> float:
    """Return a number as a float; raises a ParameterError unless it is real and finite."""
    try:
        number = float(value) if isinstance(value, Real) else math.nan
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ParameterError(argument(name), Value(value), ": must be a finite number")
    return number


def refuse(
    mistakes: Mistakes, error: type[VibrosweepError] = SpecError, most: int | None = None
) -> None:
    """Raise one error that lists every mistake, or the first `most` of them, if there are any."""
    listed, count = mistakes.listed[:most], len(mistakes.listed)
    if not listed:
        return
    dialect = mistakes.dialect
    where = (f"{mistakes.where}: ",) if mistakes.where else ()
    if count == 1:
        raise error(*where, *listed, dialect=dialect)
    lines = [part for mistake in listed for part in ("\n  ", mistake)]
    more = [f"\n  ... and {count - len(listed)} more"] if count > len(listed) else []
    raise error(*where, f"{count} mistakes", *lines, *more, dialect=dialect)
