"""What the page of a server and the page in a file share."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from bokeh.models import Select

from vibrosweep.explore.motion_view import MotionView
from vibrosweep.explore.plane_view import NO_MARKER, PlaneView

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


def parts(
    left: Sequence[Any], motions: Sequence[MotionView], right: Sequence[Any]
) -> tuple[list[Any], dict[str, Any]]:
    """Roots of the document, and where `TEMPLATE` places them by their names.

    The style sheet lays the page out.  Each picture and each text is a root of its own, because a
    change of a text would have Bokeh lay out all that is in the same root.  `left` is beside the
    plane, `right` below the motions.
    """
    roots = [*left, *(root for motion in motions for root in motion.roots), *right]
    names = {
        "left": [root.name for root in left],
        "motions": [[root.name for root in motion.roots] for motion in motions],
        "right": [root.name for root in right],
    }
    return roots, names
