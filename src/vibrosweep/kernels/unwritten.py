"""Marks for numbers in arrays of results that no kernel has written yet.

A result that a kernel leaves unwritten raises an error that names it; it is never taken from
uninitialised memory.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, Final, TypeVar, get_type_hints

import numpy as np
from numpy.typing import DTypeLike, NDArray

from vibrosweep.errors import RunError
from vibrosweep.kernels._jit import Complexes, Flags, Floats, Integers

T = TypeVar("T")

# Initial values of flags, and of other numbers: as a float64, a NaN that no arithmetic gives
FLAG: Final = -128
NUMBER: Final = 0x7FF8_0000_0BAD_F00D
DTYPE: Final[dict[Any, type]] = {
    Floats: np.float64,
    Complexes: np.complex128,
    Integers: np.int64,
    Flags: np.int8,
}


def unwritten(shape: int | tuple[int, ...], dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """Allocate an array of a result: of float64, int64, complex128, or of flags as int8."""
    array = np.empty(shape, dtype)
    bits, mark = _bits(array)
    bits[...] = mark
    return array


def empty(kind: type[T], *shape: int) -> T:
    """Allocate a named tuple of results, all arrays of this shape and of the types it declares."""
    return kind(*(unwritten(shape, DTYPE[named]) for named in get_type_hints(kind).values()))


def require_written(results: Any, fields: Collection[str] = ()) -> None:
    """Raise a RunError that names a field of a named tuple with an unwritten number.

    All fields are checked unless some are named, and those of nested named tuples too.
    """
    for name in fields or results._fields:
        values = getattr(results, name)
        if hasattr(values, "_fields"):
            require_written(values)
        elif isinstance(values, np.ndarray):
            bits, mark = _bits(values)
            if np.any(bits == mark):
                raise RunError(
                    f"{type(results).__name__}.{name}: not completely written by a kernel; this is "
                    f"a fault of vibrosweep: please report it"
                )


def _bits(array: NDArray[Any]) -> tuple[NDArray[Any], int]:
    return (array.view(np.int8), FLAG) if array.itemsize == 1 else (array.view(np.int64), NUMBER)
