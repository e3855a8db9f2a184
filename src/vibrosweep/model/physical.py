"""Ranges of the arguments of closed forms; other values are refused."""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Mapping
from typing import Final, ParamSpec, TypeVar

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError
from vibrosweep.mistakes import cut
from vibrosweep.model.parameters import (
    LARGEST,
    MOUNT,
    OF_RESTITUTION,
    PARAMETERS,
    SMALLEST,
    Parameter,
)

P = ParamSpec("P")
R = TypeVar("R")

# Ranges of arguments that are not parameters of a scene
_RANGES: Final = {
    "k": (SMALLEST, LARGEST),
    "natural": (SMALLEST, LARGEST),
    "turns": (-LARGEST, LARGEST),
    **dict.fromkeys(("acceleration", "kick", "velocity"), (0.0, LARGEST)),
    **dict.fromkeys(("launch_speed", "launch_flight", "rest_flight"), (0.0, LARGEST)),
}
_ARGUMENTS: Final[Mapping[str, Parameter]] = {
    **PARAMETERS,
    **OF_RESTITUTION,
    "mass_ratio": MOUNT["mass_ratio"],
    "damping": MOUNT["mount_damping"],
    **{name: Parameter(name, name, "1", name, math.nan, *ends) for name, ends in _RANGES.items()},
}


def physical(function: Callable[P, R]) -> Callable[P, R]:
    """Make a function refuse NaN, and arguments outside the range of the parameter they name."""
    names = inspect.signature(function)

    @functools.wraps(function)
    def refusing(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            bound = names.bind(*args, **kwargs)
        except TypeError as error:
            raise TypeError(f"{function.__name__}() {error}") from None
        for name, given in bound.arguments.items():
            if name in _ARGUMENTS:
                allowed, values = _ARGUMENTS[name], as_numbers(name, given)
                if values.ndim and names.parameters[name].annotation == "float":
                    raise ParameterError(f"{name} = {cut(repr(given))}: must be one number")
                refused = values[~allowed.accepts(values)]
                if refused.size:
                    raise ParameterError(f"{name} = {refused[0]:g}: must be {allowed.allowed}")
                if np.asarray(given).dtype == object:  # of fractions and decimals
                    bound.arguments[name] = values[()]
        return function(*bound.args, **bound.kwargs)

    return refusing


def as_numbers(name: str, given: object) -> Array:
    """Return an argument as an array of floats; a ParameterError unless it holds real numbers."""
    try:
        found = np.asarray(given)
        if found.dtype.kind in "biufO":
            return np.asarray(found, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        pass
    raise ParameterError(f"{name} = {cut(repr(given))}: must be a number, or an array of numbers")
