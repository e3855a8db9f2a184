"""What of a picture is seen: what covers the same pixels as something drawn later is not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array

Rows = NDArray[np.int64]
BEYOND = 8  # pixels outside the window to which a line or a dot within it may reach
MOST = 1 << 20  # pixels that are told apart along an axis


class Axis(NamedTuple):
    """From where to where an axis of a window goes, and over how many pixels.

    `log` says that it is logarithmic.
    """

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


def seen(across: Sequence[Array], up: Array, x: Axis, y: Axis) -> Rows:
    """Numbers of the things that are seen in a window, in their order.

    Of things in the same pixels only the last is seen.  `across` holds the horizontal coordinates
    of each thing, the least first: one of a dot, of a line those of its ends; `up` its vertical
    one.
    """
    columns, row = [x.pixel(one) for one in across], y.pixel(up)
    there = (columns[-1] >= -BEYOND) & (columns[0] <= x.pixels + BEYOND) & np.isfinite(row)
    rows = np.flatnonzero(there)[::-1]  # of equal ones `unique` finds the first
    key = np.zeros(rows.size, np.int64)
    for pixel in (*columns, row):
        key = key * MOST + np.clip(pixel[rows] + MOST // 2, 0, MOST - 1).astype(np.int64)
    return np.sort(rows[np.unique(key, return_index=True)[1]])
