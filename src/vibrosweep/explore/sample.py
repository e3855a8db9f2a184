"""Choose points of a plane that represent all of them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.explore.raster import nearest

FINEST = 32


def evenly(count: int, most: int) -> NDArray[np.int64]:
    """Indices of at most `most` of the points, evenly spaced in their order."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))


def spread_out(x: Array, y: Array) -> Iterator[int]:
    """Yield indices of points, first far apart, then closer and closer together.

    The plane is cut into 1, 4, 16, ... equal cells; each gives the point nearest to its middle.
    """
    known = np.isfinite(x) & np.isfinite(y)
    low = float(x[known].min()), float(y[known].min())
    width = float(np.ptp(x[known])) or 1.0, float(np.ptp(y[known])) or 1.0
    given: set[int] = set()
    cells = 1
    while cells <= FINEST:
        unit = width[0] / cells, width[1] / cells
        for row, column in np.ndindex(cells, cells):
            middle = low[0] + (column + 0.5) * unit[0], low[1] + (row + 0.5) * unit[1]
            found = nearest(x, y, middle, unit)
            if found not in given:
                given.add(found)
                yield found
        cells *= 2
