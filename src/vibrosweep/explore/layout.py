"""Parts that the served page and the page in a file share."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

from bokeh.document import Document
from bokeh.events import DocumentReady
from bokeh.layouts import row
from bokeh.models import Button, Div, PreText, Select

from vibrosweep.explore.motion_view import MotionView
from vibrosweep.explore.plane_view import NO_MARKER, PlaneView
from vibrosweep.explore.table import TABLE

TEMPLATE: Final = (Path(__file__).parent / "page.html").read_text("utf-8")
TITLES: Final = {"x": "horizontal", "y": "vertical", "colour": "colour", "marker": "marker"}
WRAP: Final = {"flex-wrap": "wrap"}


def picker(plane: PlaneView, name: str) -> Select:
    """Menu of the columns for x, y, colour or marker of the plane."""
    columns = plane.points.columns
    options = [(key, one.label) for key, one in columns.items()]
    if name == "marker":
        coded = [option for option in options if columns[option[0]].codes]
        options = [(NO_MARKER, "no markers"), *coded]
    return Select(
        title=TITLES[name], value=getattr(plane, name), options=options, width=150, name=name
    )


def picker_row(pickers: Iterable[Select]) -> Any:
    """Row of menus, which wraps on a narrow page."""
    return row(*pickers, styles=WRAP, sizing_mode="stretch_width", name="pickers")


def paragraph(name: str, text: str = "") -> Div:
    """Paragraph of HTML as wide as its column."""
    return Div(text=text, sizing_mode="stretch_width", name=name)


def code_block(text: str = "") -> PreText:
    """Block with the Python lines of a picture."""
    return PreText(text=text, styles={"overflow-x": "auto"}, name="code")


def code_picker(options: Sequence[str]) -> Select:
    """Menu of the pictures whose Python lines can be shown."""
    return Select(title="Python lines of", value="height", options=[*options], name="picture")


def save_button() -> Button:
    """Button that saves the chosen points; disabled until there are some."""
    return Button(label=f"Save the table as {TABLE}", disabled=True, name="save")


def fill(
    document: Document,
    left: Sequence[Any],
    motions: Sequence[MotionView],
    right: Sequence[Any],
) -> dict[str, Any]:
    """Add the widgets and figures to a document; return their names for the places of `TEMPLATE`.

    The style sheet lays the page out: `left` stands around the plane, `right` below the motions.
    Each picture and each text is a root, because Bokeh repeats the layout of a whole root when one
    of its texts changes.
    """
    roots = [*left, *(root for motion in motions for root in motion.roots), *right]
    with document.models.freeze():  # otherwise each root makes Bokeh gather all models again
        for root in roots:
            document.add_root(root)
    document.js_on_event(DocumentReady, *(motion.script for motion in motions))
    return {
        "left": [root.name for root in left],
        "motions": [[root.name for root in motion.roots] for motion in motions],
        "right": [root.name for root in right],
    }
