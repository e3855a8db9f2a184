"""What the page of a server and the page in a file share."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from bokeh.models import Select

from vibrosweep.explore.plane_view import NO_MARKER, PlaneView

__all__ = ["TEMPLATE", "picker"]

TEMPLATE: Final = (Path(__file__).parent / "page.html").read_text("utf-8")
TITLES: Final = {"x": "horizontal", "y": "vertical", "colour": "colour", "marker": "marker"}


def picker(plane: PlaneView, name: str) -> Select:
    """Choose what the plane has along x or y, as its colour or as its marker."""
    columns = plane.points.columns
    options = [(key, one.label) for key, one in columns.items()]
    if name == "marker":
        coded = [option for option in options if columns[option[0]].codes]
        options = [(NO_MARKER, "no markers"), *coded]
    return Select(
        title=TITLES[name], value=getattr(plane, name), options=options, width=150, name=name
    )
