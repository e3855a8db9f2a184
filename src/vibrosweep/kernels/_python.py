"""Kernels as plain Python, for runs with the compiler switched off."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

F = TypeVar("F", bound=Callable[..., Any])


def as_python(function: F) -> F:
    """Make plain Python divide by zero as machine code does, silently to an infinity or NaN.

    Numpy's floats do so, whereas Python's raise an exception; floats in arguments and results are
    therefore turned into numpy's.
    """

    @functools.wraps(function)
    def plain(*arguments: Any) -> Any:
        with np.errstate(all="ignore"):
            return _of_numpy(function(*map(_of_numpy, arguments)))

    return plain  # type: ignore[return-value]


def _of_numpy(value: Any) -> Any:
    """Turn a float, or the floats in a tuple, into numpy's."""
    if isinstance(value, float):
        return np.float64(value)
    if isinstance(value, tuple):
        items = map(_of_numpy, value)
        return type(value)(*items) if hasattr(value, "_fields") else tuple(items)
    return value
