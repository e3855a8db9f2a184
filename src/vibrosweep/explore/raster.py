"""Many points gathered in the pixels of a view, and the point nearest to a place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.figures.paint import Cells, commonest, grid_cells

FIRST: Final = 1000  # number of first points that show whether all may form a grid


@dataclass(frozen=True)
class View:
    """A part of a plane, and its numbers of pixels."""

    x: tuple[float, float]
    y: tuple[float, float]
    columns: int
    rows: int


@dataclass(frozen=True)
class Raster:
    """Values of the pixels of a view."""

    # x, y: outer edges
    x: tuple[float, float]
    y: tuple[float, float]
    # Shape (row, column), the lowest y first.  Numbers: the mean of the finite ones; -inf where
    # there is none, but a -inf.  Codes: the commonest.  NaN where nothing is known
    values: Array


def raster(x: Array, y: Array, values: Array, view: View, codes: Array | None = None) -> Raster:
    """Gather points in the pixels of a view, or points of an even grid in the cells of the grid.

    `codes` lists the possible values if they are codes; it is None for numbers.
    """
    cells = even_cells(x, y)
    if cells is None:
        edges_x = np.linspace(*view.x, view.columns + 1)
        edges_y = np.linspace(*view.y, view.rows + 1)
        column = np.floor((x - view.x[0]) * (view.columns / (view.x[1] - view.x[0])))
        row = np.floor((y - view.y[0]) * (view.rows / (view.y[1] - view.y[0])))
        inside = (column >= 0) & (column < view.columns) & (row >= 0) & (row < view.rows)
        index = (row[inside] * view.columns + column[inside]).astype(np.int64)
        cells, values = Cells(edges_x, edges_y, index), values[inside]
    found = _mean(cells, values) if codes is None else commonest(cells, values, codes)
    if codes is not None:
        found = np.where(np.isnan(found), np.nan, codes[np.nan_to_num(found).astype(np.int64)])
    x_edges, y_edges = cells.x_edges, cells.y_edges
    return Raster(
        (float(x_edges[0]), float(x_edges[-1])), (float(y_edges[0]), float(y_edges[-1])), found
    )


def even_cells(x: Array, y: Array) -> Cells | None:
    """Return the cells of an even grid of points; None for other points."""
    # a grid repeats the values along an axis; sorting a million values would take a second
    repeats = any(np.unique(v[:FIRST]).size < v[:FIRST].size for v in (x, y))
    cells = grid_cells(x, y) if repeats else None
    return cells if cells and _even(cells.x_edges) and _even(cells.y_edges) else None


def _mean(cells: Cells, values: Array) -> Array:
    size = int(np.prod(cells.shape))
    known = np.isfinite(values)
    infinite = np.bincount(cells.index[values == -np.inf], minlength=size)
    finite = np.bincount(cells.index[known], minlength=size)
    total = np.bincount(cells.index[known], values[known], minlength=size)
    found = np.divide(total, finite, out=np.full(size, np.nan), where=finite > 0)
    found[(infinite > 0) & (finite == 0)] = -np.inf
    return np.asarray(found.reshape(cells.shape))


def _even(edges: Array) -> bool:
    steps = np.diff(edges)
    return bool(np.ptp(steps) <= 1e-6 * steps.max())


def nearest(x: Array, y: Array, place: tuple[float, float], unit: tuple[float, float]) -> int:
    """Index of the finite point that is nearest to a place in the plane.

    `unit` holds the unit of distance along x and along y, such as the size of a pixel.
    """
    with np.errstate(over="ignore"):  # a distance that overflows is not the smallest
        distance = np.square((x - place[0]) / unit[0]) + np.square((y - place[1]) / unit[1])
    return int(np.argmin(np.where(np.isfinite(distance), distance, np.inf)))
