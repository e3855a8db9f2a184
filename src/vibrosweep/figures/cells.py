"""Realizations gathered in cells of a plane: those of a grid design, or equal cells."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array

__all__ = ["Cells", "commonest", "grid_cells"]

PER_CELL: Final = 20
MOST_CELLS: Final = 200
ALONE: Final = 0.01  # half the width of the cell of a single value, relative to it unless it is 0


@dataclass(frozen=True)
class Cells:
    """Cells of a plane; ``index`` is the cell of each point in row-major order, y first."""

    x_edges: Array
    y_edges: Array
    index: NDArray[np.int64]

    @property
    def shape(self) -> tuple[int, int]:
        """Rows (y) and columns (x)."""
        return self.y_edges.size - 1, self.x_edges.size - 1


def grid_cells(x: Array, y: Array) -> Cells | None:
    """Return the cells of a grid design, one around each of its points; None for other designs."""
    columns, column = np.unique(x, return_inverse=True)
    rows, row = np.unique(y, return_inverse=True)
    if min(columns.size, rows.size) < 2 or columns.size * rows.size > x.size:
        return None
    index = row * columns.size + column
    if np.unique(index).size != columns.size * rows.size:
        return None
    return Cells(between(columns), between(rows), index)


def equal_cells(x: Array, y: Array) -> Cells:
    """Return equal cells over the range of the points, about twenty points to a cell."""
    count = int(np.clip(np.sqrt(x.size / PER_CELL), 2, MOST_CELLS))
    x_edges = np.linspace(x.min(), x.max(), count + 1)
    y_edges = np.linspace(y.min(), y.max(), count + 1)
    column = np.clip(np.searchsorted(x_edges, x, side="right") - 1, 0, count - 1)
    row = np.clip(np.searchsorted(y_edges, y, side="right") - 1, 0, count - 1)
    return Cells(x_edges, y_edges, row * count + column)


def median(cells: Cells, values: Array) -> Array:
    """Lower median of the values in each cell, NaN where there are none.

    The lower median is always one of the values: zeros and infinities, which have a special
    meaning, are not averaged with other values.
    """
    known = ~np.isnan(values)
    index, kept = cells.index[known], values[known]
    order = np.lexsort((kept, index))
    count = np.bincount(index, minlength=int(np.prod(cells.shape)))
    middle = np.cumsum(count) - count + (np.maximum(count, 1) - 1) // 2
    result = np.full(count.size, np.nan)
    result[count > 0] = kept[order][middle[count > 0]]
    return result.reshape(cells.shape)


def commonest(cells: Cells, values: Array, codes: Array) -> Array:
    """Position in ``codes`` of the commonest code in each cell, NaN in empty cells."""
    of_code = [
        np.bincount(cells.index[values == code], minlength=int(np.prod(cells.shape)))
        for code in codes
    ]
    counts = np.stack(of_code)
    best = np.where(counts.sum(axis=0) > 0, counts.argmax(axis=0), np.nan)
    return np.asarray(best.reshape(cells.shape), dtype=np.float64)


def between(values: Array) -> Array:
    """Edges half-way between sorted values; the outer cells are symmetric about their values."""
    if values.size == 1:
        half = ALONE * (abs(float(values[0])) or 1.0)
        return np.array([values[0] - half, values[0] + half])
    middle = (values[1:] + values[:-1]) / 2.0
    first, last = values[0] - (middle[0] - values[0]), values[-1] + (values[-1] - middle[-1])
    return np.concatenate([[first], middle, [last]])
