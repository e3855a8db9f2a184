"""Ranges of the arguments of closed forms, outside which they are refused."""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Mapping
from typing import Final, ParamSpec, TypeVar

import numpy as np

from vibrosweep.errors import ParameterError
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

_ARGUMENTS: Final[Mapping[str, Parameter]] = {
    **PARAMETERS,
    "mass_ratio": MOUNT["mass_ratio"],
    "damping": MOUNT["mount_damping"],
    **OF_RESTITUTION,
    "k": Parameter("k", "k", "1", "forcing periods between impacts", math.nan, SMALLEST, LARGEST),
    "natural": Parameter("natural", "nu", "1", "natural frequency", math.nan, SMALLEST, LARGEST),
    "turns": Parameter("turns", "X", "1", "phases in turns", math.nan, -LARGEST, LARGEST),
    **{
        name: Parameter(name, name, "1", name.replace("_", " "), math.nan, 0.0, LARGEST)
        for name in (
            "acceleration",
            "kick",
            "launch_speed",
            "launch_flight",
            "rest_flight",
            "velocity",
        )
    },
}


def physical(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function refuse arguments outside the ranges of the parameters they name, and NaN."""
    names = inspect.signature(function)

    @functools.wraps(function)
    def refusing(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            bound = names.bind(*args, **kwargs)
        except TypeError as error:
            raise TypeError(f"{function.__name__}() {error}") from None
        for name, given in bound.arguments.items():
            if name in _ARGUMENTS:
                allowed, values = _ARGUMENTS[name], np.asarray(given, dtype=np.float64)
                refused = values[~allowed.accepts(values)]
                if refused.size:
                    raise ParameterError(f"{name} = {refused[0]:g}: must be {allowed.allowed}")
        return function(*args, **kwargs)

    return refusing
