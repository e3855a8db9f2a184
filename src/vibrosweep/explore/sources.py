"""Data of figures."""

from __future__ import annotations

from bokeh.models import ColumnDataSource

__all__ = ["empty_source"]


def empty_source(*names: str) -> ColumnDataSource:
    """Columns of these names, without rows."""
    return ColumnDataSource({name: [] for name in names})
