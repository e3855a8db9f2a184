"""Realizations of a result: along one dimension, or along the axes of a grid.

A grid of parameters is stored with its axes as dimensions.  Code that works realization by
realization reads any result through the functions of this module: the realizations of a grid are
numbered with its last axis varying fastest.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.model.forcing import INPUTS
from vibrosweep.store.arranged import REALIZATION, arranged

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["read_rows", "row_count", "row_dims"]

# Characters that no text in a file can contain: a zero byte, and lone surrogates
UNSTORABLE: Final = re.compile("[\0\ud800-\udfff]")
# Rows of a grid that are read at once: one row takes as long as thousands
ROWS_AT_A_TIME: Final = 1 << 14
# Rows of a slice, where all rows of a file are needed, but not at once
ROWS_OF_A_SLICE: Final = 1 << 18

Box = tuple[slice, ...]


def along(dims: tuple[str, ...], axes: tuple[str, ...]) -> tuple[str, ...]:
    """Replace the dimension of realizations by the axes of their grid."""
    return tuple(d for dim in dims for d in (axes if dim == REALIZATION else (dim,)))


def flat(sweep: xr.Dataset) -> xr.Dataset:
    """Return the result of a sweep with its realizations along one dimension ``realization``.

    Parameters
    ----------
    sweep
        Result of a sweep.

    Returns
    -------
    xarray.Dataset
        The same result; a grid is stacked, so that its axes become coordinates.

    Raises
    ------
    DataError
        It is not a dataset, or its attributes contradict its variables.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> grid = vs.sweep(design="grid", restitution=[0.8, 0.9], amplitude=[1.0, 2.0, 3.0])
    >>> vs.analysis.flat(grid).sizes["realization"]
    6
    """
    sweep = arranged(sweep)
    axes_of = ([d for d in v.dims if d in INPUTS] for v in sweep.variables.values())
    longest = max(axes_of, key=len, default=[])
    axes = list(dict.fromkeys([*longest, *(d for d in sweep.sizes if d in INPUTS)]))
    if not axes:
        return sweep
    return sweep.stack({REALIZATION: axes}, create_index=False).transpose(REALIZATION, ...)


def row_dims(file: Any) -> tuple[str, ...]:
    """Return the dimensions of an open result file along which its realizations lie."""
    single = REALIZATION in file.dimensions
    return (REALIZATION,) if single else tuple(file.variables["status"].dimensions)


def row_count(file: Any) -> int:
    """Return the number of realizations in an open result file."""
    return math.prod(file.dimensions[dim].size for dim in row_dims(file))


def slices(rows: int) -> Iterator[slice]:
    """Yield slices that together cover a number of realizations, in order."""
    for start in range(0, rows, ROWS_OF_A_SLICE):
        yield slice(start, min(start + ROWS_OF_A_SLICE, rows))


def read_rows(file: Any, name: str, rows: slice | NDArray[np.int64]) -> NDArray[Any]:
    """Read some realizations of a variable of a file of h5netcdf, shape (realization, ...).

    The variable lies along realizations, or along some axes of their grid; `rows` is a slice
    without a step, or increasing indices.
    """
    variable, dims = file.variables[name], row_dims(file)
    if len(dims) == 1:
        return np.asarray(variable[rows])
    sizes = [file.dimensions[dim].size for dim in dims]
    total = math.prod(sizes)
    if variable.dimensions[: len(dims)] == dims:
        if isinstance(rows, slice):
            return _range(variable, sizes, *rows.indices(total)[:2])
        blocks = rows // ROWS_AT_A_TIME
        pieces = [_range(variable, sizes, 0, 0)]
        for block in np.unique(blocks).tolist():
            start = block * ROWS_AT_A_TIME
            found = _range(variable, sizes, start, min(start + ROWS_AT_A_TIME, total))
            pieces.append(found[rows[blocks == block] - start])
        return np.concatenate(pieces)
    flat_index = np.arange(total)[rows] if isinstance(rows, slice) else rows
    places = dict(zip(dims, np.unravel_index(flat_index, sizes), strict=True))
    index = [places[dim] for dim in variable.dimensions if dim in places]
    return np.asarray(variable[...][tuple(index)])


def _range(variable: Any, sizes: list[int], start: int, stop: int) -> NDArray[Any]:
    """Read a range of the realizations of a grid."""
    rest = variable.shape[len(sizes) :]
    pieces = [np.empty((0, *rest), variable.dtype)]
    pieces += [variable[box].reshape(-1, *rest) for box in boxes(sizes, start, stop)]
    return np.concatenate(pieces)


def boxes(sizes: list[int], start: int, stop: int) -> Iterator[Box]:
    """Cut elements start, ..., stop - 1 of an array, in the order of memory, into boxes."""
    inner = math.prod(sizes[1:])
    while start < stop:
        row, within = divmod(start, inner)
        rows = (stop - start) // inner
        if within or not rows:  # a part of one row
            end = min((row + 1) * inner, stop)
            for box in boxes(sizes[1:], within, end - row * inner):
                yield (slice(row, row + 1), *box)
        else:
            end = start + rows * inner
            yield (slice(row, row + rows), *(slice(0, size) for size in sizes[1:]))
        start = end
