"""Elements of a picture that are visible in a window, without those that others cover."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array

Rows = NDArray[np.int64]
MARGIN = 8  # pixels by which a line or a dot may reach into the window from outside
MOST = 1 << 20  # pixels that are distinguished along an axis


class Axis(NamedTuple):
    """An axis of a window: its two ends, its length in pixels, and whether it is logarithmic."""

    low: float
    high: float
    pixels: int
    log: bool = False

    def pixel(self, values: Array) -> Array:
        """Pixel of each value, counted from the low end; not finite where it has none."""
        low, high = self.low, self.high
        if self.log:
            with np.errstate(divide="ignore", invalid="ignore"):
                low, high, values = np.log(low), np.log(high), np.log(values)
        return np.asarray(np.floor((values - low) * (self.pixels / (high - low))))


def visible_rows(across: Sequence[Array], up: Array, x: Axis, y: Axis) -> Rows:
    """Row numbers of the elements that are visible in a window, in their order.

    Of several elements in the same pixels, the last one covers the others.  `across` holds the
    horizontal coordinate of each dot, or of the two ends of each line, the left one first; `up` is
    the vertical coordinate.
    """
    columns, row = [x.pixel(one) for one in across], y.pixel(up)
    within = (columns[-1] >= -MARGIN) & (columns[0] <= x.pixels + MARGIN) & np.isfinite(row)
    rows = np.flatnonzero(within)[::-1]  # `unique` keeps the first of equal keys: here the last row
    key = np.zeros(rows.size, np.int64)
    for pixel in (*columns, row):
        key = key * MOST + np.clip(pixel[rows] + MOST // 2, 0, MOST - 1).astype(np.int64)
    return np.sort(rows[np.unique(key, return_index=True)[1]])
