"""Chosen points as a table of realizations, which a sweep reads as its design."""

from __future__ import annotations

import csv
import io
from array import array
from typing import Any, Final

import numpy as np
from matplotlib.path import Path as Outline
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.explore.points import LAUNCHED, Points
from vibrosweep.explore.sources import are_numbers, is_window

Rows = NDArray[np.int64]
TABLE: Final = "selection.csv"  # file name that a browser saves it under


def table(points: Points, rows: Rows) -> str:
    """CSV with the varied parameters of points; numbers keep every bit.

    Points of the same realization, such as the impacts of a bifurcation diagram, share one row.
    """
    names = table_columns(points)
    values = [points.columns[name].values[rows].tolist() for name in names]
    if not names:  # a single realization: every parameter is fixed
        inputs = points.base_choice.scene.inputs
        names, values = [*inputs], [[value] for value in inputs.values()]
    written = io.StringIO()
    writer = csv.writer(written, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(dict.fromkeys(zip(*values, strict=True)))
    return written.getvalue()


def table_columns(points: Points) -> list[str]:
    """Names of the columns of a table of points."""
    return [name for name in (*points.varied, LAUNCHED) if name in points.columns]


def enclosed(outline: Any, x: Array, y: Array) -> Rows | None:
    """Indices of the points within an outline from a browser; None for any other data."""
    if outline.get("type") == "rect":
        x0, x1, y0, y1 = (outline.get(name) for name in ("x0", "x1", "y0", "y1"))
        return in_rectangle(x, y, x0, x1, y0, y1) if is_window(x0, x1, y0, y1) else None
    sent = [outline.get(name) for name in "xy"]
    # Bokeh passes on arrays of numpy or of the standard library, whatever the browser sent
    corners = [v.tolist() if isinstance(v, np.ndarray | array) else v for v in sent]
    pairs = list(zip(*corners, strict=False)) if all(isinstance(v, list) for v in corners) else []
    if not pairs or not are_numbers(*(number for pair in pairs for number in pair)):
        return None
    return in_polygon(x, y, *np.array(pairs, np.float64).T)


def in_rectangle(x: Array, y: Array, x0: float, x1: float, y0: float, y1: float) -> Rows:
    """Indices of the points within a rectangle."""
    return np.flatnonzero((x >= x0) & (x <= x1) & (y >= y0) & (y <= y1))


def in_polygon(x: Array, y: Array, corners_x: Array, corners_y: Array) -> Rows:
    """Indices of the points within a polygon, by the even-odd rule."""
    box = (corners_x.min(), corners_x.max(), corners_y.min(), corners_y.max())
    near = in_rectangle(x, y, *box)
    polygon = Outline(np.column_stack([corners_x, corners_y]))
    inside: NDArray[np.bool_] = polygon.contains_points(np.column_stack([x[near], y[near]]))
    return np.asarray(near[inside])
