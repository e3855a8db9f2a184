"""The page as one file that works without a server, with a sample of motions in it."""

from __future__ import annotations

import html
import pickle
from itertools import chain
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from bokeh.document import Document
from bokeh.embed import file_html
from bokeh.events import DocumentReady, RangesUpdate, Tap
from bokeh.models import ColumnDataSource, CustomJS, FixedTicker, Select, Toggle
from bokeh.resources import INLINE

from vibrosweep.errors import OutputError
from vibrosweep.explorer.pictures import even_cells, evenly, moving_point, spread_out
from vibrosweep.explorer.points import Column, Points, legible
from vibrosweep.explorer.views import (
    SCALES,
    TEMPLATE,
    MotionView,
    PlaneView,
    Scale,
    code_block,
    code_picker,
    colouring,
    fill,
    limits,
    paragraph,
    picker,
    picker_row,
    save_button,
    scale_pickers,
)
from vibrosweep.explorer.words import (
    PICTURES,
    TABLE,
    around,
    facts_html,
    motion_lines,
    parameters_line,
    plane_lines,
    simulation,
    table_columns,
)
from vibrosweep.store.disk import check_output, replacing

SCRIPT: Final = (Path(__file__).parent / "page.js").read_text("utf-8")
# Most bytes of the motions in memory; as text they take a third more
OF_MOTIONS: Final = 6_500_000
PERIODS: Final = 20.0
PLANE: Final = "plane as first shown"


class Limits(NamedTuple):
    """Limits of the size and the contents of a page."""

    size: int = 10_000_000  # bytes
    points: int = 5000
    motions: int = 150


USUAL: Final = Limits()


def write_page(points: Points, output: Path, *, force: bool, limits: Limits = USUAL) -> str:
    """Write a page as one file; return a sentence about its contents.

    Raises an OutputError if the file cannot be written, exists without `force`, or would be larger
    than its limit.
    """
    check_output(output, force=force, inputs=(points.path,))
    text, contents = page_text(points, output, limits)
    with replacing(output, force=force) as disk:
        disk.write(text.encode())
    return f"written to {output} ({len(text.encode()) / 1e6:.2g} MB): {contents}"


def page_text(points: Points, name: object, limits: Limits = USUAL) -> tuple[str, str]:
    """Return a page, and a sentence about its contents; `name` is that of its errors.

    Raises an OutputError if it would be larger than its limit.
    """
    page = _Page(points, limits)
    text = page.html().encode()
    while len(text) > limits.size and len(page.kept) > 1:
        page = _Page(points, limits._replace(motions=len(page.kept) // 2))
        text = page.html().encode()
    if len(text) > limits.size:
        raise OutputError(
            f"{name}: would have {len(text)} bytes, more than {limits.size}; explore a "
            f"result with fewer particles or a shorter duration"
        )
    return text.decode(), page.contents


class _Page:
    """Widgets and figures of the page; their callbacks are in its script."""

    def __init__(self, points: Points, limits: Limits) -> None:
        self.points = points.taken(evenly(points.count, limits.points))
        self.plane = PlaneView(self.points)
        self.motion = MotionView("first", complete=True)
        self.beside = MotionView("second", complete=True)
        self.kept: list[int] = []
        self.motions: list[dict[str, Any]] = []
        self._compute(limits.motions)
        self.contents = (
            f"{self.points.count} of {points.count} points; a click shows the nearest of "
            f"{len(self.kept)} realizations (crosses) that were computed beforehand, spread evenly "
            f"over the plane, for at most {PERIODS:g} forcing periods"
        )

    def _compute(self, most: int) -> None:
        """Compute motions until there are `most` of them or their memory is used up."""
        left = OF_MOTIONS
        axes = (self.plane.values(name) for name in self.points.axes)
        for index in dict.fromkeys(chain([moving_point(self.points)], spread_out(*axes))):
            choice = self.points.choice(index).shortened(PERIODS)
            self.motion.show(choice.simulate(), parameters_line(choice))
            found = self.motion.content
            left -= len(pickle.dumps(found))
            if self.motions and (left < 0 or len(self.motions) == most):
                break
            self.kept.append(index)
            texts = {"facts": facts_html(choice), "call": simulation(choice)}
            self.motions.append({**found, **texts})
        first = self.points.choice(self.kept[0]).shortened(PERIODS)
        self.motion.show(first.simulate(), parameters_line(first))
        self.plane.mark(*(float(self.plane.values(n)[self.kept[0]]) for n in self.points.axes))
        self.facts = paragraph("facts", self.motions[0]["facts"])
        self.code = code_block(motion_lines(first, "height"))

    def html(self) -> str:
        """Return the page."""
        document, plane, points = Document(), self.plane, self.points
        pickers = [picker(plane, name) for name in ("x", "y", "colour")]
        texts = {name: list(around(name)) for name in PICTURES}
        texts[PLANE] = [plane_lines(points, plane.x, plane.y, plane.colour), ""]
        self.picture = code_picker([*texts])
        self.scales = scale_pickers()
        self.pin = Toggle(label="Pin this motion, to see another beside it", name="pin")
        self.selection = paragraph("selection", "Choose points with the lasso or the box.")
        self.save = save_button()
        kept = {name: plane.values(name)[self.kept] for name in points.axes}
        marks = ColumnDataSource(dict(zip("xy", kept.values(), strict=True)))
        plane.figure.scatter("x", "y", source=marks, marker="cross", size=8, line_color="black")
        arguments = {**self._arguments(pickers, marks), "around": texts}
        document.js_on_event(DocumentReady, self._listen(arguments, pickers))
        name = legible(points.path.name)
        needs = f"Other parameters need the program: vibrosweep explore {name}"
        contents = html.escape(f"{self.contents}. {needs}. {points.remark}")
        left = [
            picker_row("pickers", pickers),
            picker_row("scales", self.scales),
            plane.figure,
            paragraph("said", f"<b>Click a point</b> to see its motion. {contents}"),
            self.pin,
            self.selection,
            self.save,
        ]
        motions = [self.motion, self.beside]
        places = fill(document, left, motions, [self.facts, self.picture, self.code])
        page = file_html(
            document, INLINE, points.heading, template=TEMPLATE, template_variables=places
        )
        return str(page)

    def _arguments(self, pickers: list[Select], marks: ColumnDataSource) -> dict[str, Any]:
        plane, points = self.plane, self.points
        curves = [r for r in plane.figure.renderers if r.data_source in plane.curves]
        return {
            "motions": self.motions,
            "kept": self.kept,
            "holder": self.motion.holder,
            "beside": self.beside.holder,
            "pin": self.pin,
            "scales": list(self.scales),
            "ticks": FixedTicker(ticks=[]),
            "pinned": plane.pinned,
            "facts": self.facts,
            "code": self.code,
            "picture": self.picture,
            "plane": plane.figure,
            "dots": plane.source,
            "renderer": plane.dots,
            "image": plane.image,
            "mapper": plane.mapper,
            "over_cells": plane.over_cells,
            "over_dots": plane.over_dots,
            "bar": plane.scale,
            "ring": plane.chosen,
            "marks": marks,
            "curves": curves,
            "pickers": pickers,
            "initial": list(points.axes),
            "columns": ColumnDataSource({n: c.values for n, c in points.columns.items()}),
            "views": {n: [*limits(c.values), c.label] for n, c in points.columns.items()},
            "colourings": {name: self._colourings(name) for name in points.columns},
            "grids": {x: self._grids(x) for x in points.columns},
            "selection": self.selection,
            "save": self.save,
            "varied": table_columns(points),
            "file": TABLE,
            "shown": ColumnDataSource({"index": [0]}),
        }

    def _colourings(self, name: str) -> dict[str, dict[str, Any]]:
        """Colours of a column by the kind of scale."""
        column = self.points.columns[name]
        kinds = SCALES[:1] if column.codes else SCALES
        return {kind: self._colouring(column, Scale(kind)) for kind in kinds}

    @staticmethod
    def _colouring(column: Column, wish: Scale) -> dict[str, Any]:
        found = colouring(column, wish)
        return {
            "values": found.values if column.codes else None,  # else those of the column
            "log": found.log,
            "ends": [found.low, found.high],
            "title": f"colour: {found.title}",
            "mapping": found.mapping,
            "bar": found.bar,
            "words": {str(code): word for code, word in column.codes.items()},
            "names": list(found.names),
        }

    def _grids(self, x: str) -> dict[str, Any]:
        """Cells of the planes with this horizontal axis whose points form a grid."""
        found = {}
        for y in self.points.columns:
            cells = even_cells(self.plane.values(x), self.plane.values(y))
            if cells is not None:
                (left, *_, right), (low, *_, high) = cells.x_edges, cells.y_edges
                found[y] = {
                    "index": cells.index.astype(np.int32),
                    "shape": cells.shape,
                    "place": {"x": [left], "y": [low], "dw": [right - left], "dh": [high - low]},
                }
        return found

    def _listen(self, arguments: dict[str, Any], pickers: list[Select]) -> CustomJS:
        # a single callback, because each one would hold its own copy of the motions
        script = CustomJS(args=arguments, code=SCRIPT)
        self.plane.figure.js_on_event(Tap, script)
        self.plane.figure.js_on_event(RangesUpdate, script)
        for menu in (*pickers, *self.scales, self.picture):
            menu.js_on_change("value", script)
        self.pin.js_on_change("active", script)
        self.plane.source.selected.js_on_change("indices", script)
        self.save.js_on_click(script)
        return script
