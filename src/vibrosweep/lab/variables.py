"""Variables of datasets with units and long names, and text of values with errors."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from numbers import Integral, Real
from typing import Any, Final

from vibrosweep.errors import ParameterError, TrackError, VibrosweepError
from vibrosweep.mistakes import Value, argument, cut
from vibrosweep.model.parameters import OF_RESTITUTION, PARAMETERS

LARGEST: Final = 1e9  # of any argument in SI units
KNOWN: Final = {**PARAMETERS, **OF_RESTITUTION}


def require_number(
    name: str,
    value: object,
    low: float = -LARGEST,
    high: float = LARGEST,
    *,
    whole: bool = False,
    error: type[VibrosweepError] = ParameterError,
) -> None:
    """Raise an error unless an argument is one number within the given limits."""
    if not (isinstance(value, Integral if whole else Real) and low <= value <= high):  # type: ignore[operator]
        kind = "a whole number" if whole else "a number"
        rule = f": must be {kind}, at least {low:g} and at most {high:g}"
        raise error(argument(name), Value(value), rule)


def require_instance(name: str, value: object, kind: type) -> None:
    """Raise an error unless an argument is an instance of a class."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise ParameterError(f"{name} = {cut(repr(value))}: must be {article} {kind.__name__}")


def require_name(name: str, value: object) -> None:
    """Raise an error unless an argument is a text or None."""
    if value is not None and not (isinstance(value, str) and value):
        raise TrackError(argument(name), Value(value), ": must be a name; leave it out for all")


def require_parameter(name: str, value: object, *, of: str = "") -> None:
    """Raise an error unless an argument is in the range of the parameter `name`, or `of`."""
    parameter = KNOWN[of or name]
    if not (isinstance(value, Real) and parameter.accepts(float(value))):
        raise ParameterError(argument(name), Value(value), f": must be {parameter.allowed}")


def require_range_of_frequencies(between: object) -> None:
    """Raise an error unless `between` holds two frequencies, the lower one first."""
    ends = between if isinstance(between, tuple | list) else ()
    for end in ends:
        require_parameter("frequency_range", end, of="frequency")
    if len(ends) != 2 or not ends[0] < ends[1]:
        raise ParameterError(
            f"frequency_range = {between!r}: must rise, in Hz, as (1.0, 100.0) does"
        )


def with_units(
    dims: Hashable | Sequence[Hashable], columns: Mapping[str, tuple[Any, str, str]]
) -> dict[str, Any]:
    """Make variables of a dataset from values, units and long names."""
    return {
        name: (dims, values, {"units": units, "long_name": words})
        for name, (values, units, words) in columns.items()
    }


def with_error(value: float, error: float, digits: int = 4) -> str:
    """Format a value with its standard error, if it has one."""
    return f"{value:.{digits}g}" + (f" ± {error:.2g}" if math.isfinite(error) else "")
