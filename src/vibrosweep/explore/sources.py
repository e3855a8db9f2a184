"""Data sources of figures, and checks of the values that a browser sends."""

from __future__ import annotations

import math
import sys
from typing import Any, Final

from bokeh.core.property.descriptors import UnsetValueError
from bokeh.models import ColumnDataSource

# Most pixels along an axis, more than screens have: an array of them must fit in memory
MOST_PIXELS: Final = 8192
LARGEST: Final = sys.float_info.max  # integers may be larger


def empty_source(*names: str) -> ColumnDataSource:
    """Columns of these names, without rows."""
    return ColumnDataSource({name: [] for name in names})


def inner_pixels(plot: Any, guess: tuple[int, int]) -> tuple[int, int]:
    """Columns and rows of pixels within the axes; a guess until the browser has sent them."""
    try:
        width, height = plot.inner_width, plot.inner_height
    except UnsetValueError:
        return guess
    if min(width, height) <= 0:  # 0 where it is hidden
        return guess
    return min(width, MOST_PIXELS), min(height, MOST_PIXELS)


def are_numbers(*values: object) -> bool:
    """Return whether all values are finite numbers."""
    return all(isinstance(value, int | float) and abs(value) <= LARGEST for value in values)


def is_window(x0: Any, x1: Any, y0: Any, y1: Any) -> bool:
    """Return whether these are the ends of a window: two of x and two of y."""
    return are_numbers(x0, x1, y0, y1) and 0 < abs(x1 - x0) < math.inf > abs(y1 - y0) > 0
