"""Data of figures, and their size."""

from __future__ import annotations

from typing import Any

from bokeh.core.property.descriptors import UnsetValueError
from bokeh.models import ColumnDataSource


def empty_source(*names: str) -> ColumnDataSource:
    """Columns of these names, without rows."""
    return ColumnDataSource({name: [] for name in names})


def inner_pixels(plot: Any, guess: tuple[int, int]) -> tuple[int, int]:
    """Columns and rows of pixels within the axes; a guess until the browser has told them."""
    try:
        width, height = plot.inner_width, plot.inner_height
    except UnsetValueError:
        return guess
    return (width, height) if min(width, height) > 0 else guess  # 0 where it is hidden
