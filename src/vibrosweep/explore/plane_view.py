"""The plane of a result as a Bokeh figure: points or pixels, closed forms, the chosen point."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from bokeh.models import (
    BoxSelectTool,
    ColorBar,
    CustomJSHover,
    HoverTool,
    LassoSelectTool,
    LinearColorMapper,
    Range1d,
)
from bokeh.plotting import figure

from vibrosweep.arrays import Array
from vibrosweep.explore.colours import UNKNOWN, colouring
from vibrosweep.explore.curves import WindowEnd, window_ends
from vibrosweep.explore.labels import SYMBOLS
from vibrosweep.explore.points import Points
from vibrosweep.explore.raster import View, even_cells, nearest, raster
from vibrosweep.explore.sources import LARGEST, empty_source, inner_pixels, is_window

# Number of points above which they are gathered in pixels
MANY: Final = 20_000
NO_MARKER: Final = "(none)"
MARKERS: Final = ("circle", "square", "triangle", "diamond", "inverted_triangle", "plus", "x")
MARGIN: Final = 0.03
# Distance in pixels up to which a click selects a point
REACH: Final = 12.0
HEIGHT: Final = 430
GUESS: Final = (HEIGHT, HEIGHT)  # pixels until the browser has sent the true number
SMALL: Final = {"text_font_size": "11px", "text_baseline": "middle"}
SUBSCRIPTS: Final = {False: "min", True: "max"}
DIGITS: Final = "{%.6g}"  # of the numbers beside the pointer
# The middle of the cell below the pointer, along one axis
MIDDLE: Final = """
const start = source.data[low][0], size = source.data[width][0]
const count = source.data.image[0].shape[axis]
const cell = Math.floor((value - start) / size * count)
return Number((start + (cell + 0.5) * size / count).toPrecision(6))
"""
# What the colour of a cell means, as the colour bar says it
MEANING: Final = """
const names = bar.major_label_overrides
const list = names instanceof Map ? [...names.values()] : Object.values(names)
if (isNaN(value)) return "not known"
if (list.length) return list[value]
const number = bar.color_mapper.type === "LogColorMapper" ? Math.exp(value) : value
return Number(number.toPrecision(6))
"""


class PlaneView:
    """The plane of a result, with the columns of its axes and colours.

    Parameters
    ----------
    points
        Points of the result.
    """

    def __init__(self, points: Points) -> None:
        self.points = points
        self.x, self.y = points.axes
        self.colour, self.marker = points.colour, NO_MARKER
        self.pixels = points.count > MANY
        self.source = empty_source("x", "y", "value", "alpha", "marker", "said")
        self.image = empty_source("image", "x", "y", "dw", "dh")
        self.solid = empty_source("xs", "ys")
        self.dashed = empty_source("xs", "ys")
        self.names = empty_source("x", "y", "text")
        self.chosen = empty_source("x", "y")
        self.borders = empty_source("xs", "ys", "name", "dash")
        self.curves = (self.solid, self.dashed, self.names, self.borders)
        self.why_no_curves = ""
        self.figure = self._figure()
        self.show()

    def _figure(self) -> Any:
        plot = figure(
            height=HEIGHT,
            sizing_mode="stretch_width",
            tools="pan,wheel_zoom,box_zoom,reset,save",
            active_drag=None,
            active_scroll="wheel_zoom",
            x_range=Range1d(0, 1),
            y_range=Range1d(0, 1),
            name="plane",
            toolbar_location="above",
        )
        plot.toolbar.logo = None
        plot.add_tools(LassoSelectTool(continuous=False), BoxSelectTool())
        self.scale = ColorBar(width=12, padding=6, major_label_text_font_size="11px")
        plot.add_layout(self.scale, "right")
        # One mapper for good, whose properties change: a browser copies the glyphs, for points that
        # are chosen for example, and the copies would keep a mapper that is replaced
        self.mapper = LinearColorMapper(nan_color=UNKNOWN)
        self.painted = plot.image(
            "image", "x", "y", "dw", "dh", source=self.image, color_mapper=self.mapper
        )
        self.dots = plot.scatter(
            "x",
            "y",
            source=self.source,
            marker="marker",
            size=float(np.clip(160.0 / np.sqrt(self.points.count), 3.0, 9.0)),
            fill_color={"field": "value", "transform": self.mapper},
            fill_alpha={"field": "alpha"},
            line_color=None,
            selection_line_color="black",
            nonselection_fill_alpha=0.15,
        )
        for source, dash in ((self.solid, "solid"), (self.dashed, "dashed")):
            plot.multi_line("xs", "ys", source=source, line_color="black", line_dash=dash)
        lines = {"line_dash": "dash", "line_width": 2.0, "line_color": "#c2006f"}
        drawn = plot.multi_line("xs", "ys", source=self.borders, **lines)
        plot.add_tools(HoverTool(renderers=[drawn], tooltips=[("orbit", "@name")]))
        words = plot.text("x", "y", "text", source=self.names, text_align="center", **SMALL)
        words.glyph.update(background_fill_color="white", background_fill_alpha=0.85, padding=2)
        ring = {"size": 15, "fill_color": None, "line_color": "#d00000", "line_width": 2.5}
        plot.scatter("x", "y", source=self.chosen, **ring)
        self.over_cells = HoverTool(
            renderers=[self.painted],
            formatters={
                "$x": self._middle("x", "dw", axis=1),
                "$y": self._middle("y", "dh", axis=0),
                "@image": CustomJSHover(args={"bar": self.scale}, code=MEANING),
            },
        )
        self.over_dots = HoverTool(formatters={"@x": "printf", "@y": "printf"})
        plot.add_tools(self.over_cells, self.over_dots)
        return plot

    def _middle(self, low: str, width: str, axis: int) -> CustomJSHover:
        names = {"low": low, "width": width, "axis": axis}
        return CustomJSHover(args={"source": self.image, **names}, code=MIDDLE)

    def values(self, name: str) -> Array:
        """Values of a column, shape (point,)."""
        return self.points.columns[name].values

    def show(self) -> None:
        """Show the chosen columns, in a view of all points."""
        plot = self.figure
        for name, axis, view in (
            (self.x, plot.xaxis, plot.x_range),
            (self.y, plot.yaxis, plot.y_range),
        ):
            axis.axis_label = self.points.columns[name].label
            low, high = limits(self.values(name))
            view.update(start=low, end=high, reset_start=low, reset_end=high)
        self._show_curves()
        self.recolour()

    def recolour(self) -> None:
        """Show the chosen colours and markers, in the present view."""
        column = self.points.columns[self.colour]
        self._coloured = colouring(column)
        self.mapper.update(**self._coloured.mapping)
        self.figure.title.text = f"colour: {self._coloured.title}"
        self.scale.update(**self._coloured.bar)
        across, up = (self.points.columns[name].label for name in (self.x, self.y))
        for hover, x, y, value in (
            (self.over_cells, "$x", "$y", f"@image{DIGITS}"),
            (self.over_dots, "@x", "@y", "@said"),
        ):
            hover.tooltips = [(across, x + DIGITS), (up, y + DIGITS), (column.label, value)]
        if self.pixels:
            self.paint()
        else:
            self._show_points()

    def paint(self) -> None:
        """Gather the points in the pixels of the present view."""
        left, right, bottom, top = self._window()
        view = View((left, right), (bottom, top), *inner_pixels(self.figure, GUESS))
        coloured, names = self._coloured, self._coloured.names
        codes = np.arange(len(names), dtype=np.float64) if names else None
        found = raster(self.values(self.x), self.values(self.y), coloured.values, view, codes)
        self.image.data = {
            "image": [coloured.scaled(found.values)],
            "x": [found.x[0]],
            "y": [found.y[0]],
            "dw": [found.x[1] - found.x[0]],
            "dh": [found.y[1] - found.y[0]],
        }

    def hit(self, place: tuple[float, float]) -> tuple[int, bool]:
        """Index of the point nearest to a place, and whether it is within `REACH`."""
        columns, rows = inner_pixels(self.figure, GUESS)
        left, right, bottom, top = self._window()
        unit = abs(right - left) / columns, abs(top - bottom) / rows
        x, y = self.values(self.x), self.values(self.y)
        index = nearest(x, y, place, unit)
        with np.errstate(over="ignore"):
            far = np.hypot((x[index] - place[0]) / unit[0], (y[index] - place[1]) / unit[1])
        return index, bool(far <= REACH)

    def _window(self) -> tuple[float, float, float, float]:
        """Ends of the present view: left, right, bottom, top."""
        ranges = self.figure.x_range, self.figure.y_range
        ends = tuple(end for one in ranges for end in (one.start, one.end))
        if is_window(*ends):
            return ends
        return (*limits(self.values(self.x)), *limits(self.values(self.y)))

    def mark(self, *place: float | None) -> None:
        """Put the ring of the shown motion at a place; remove it if a coordinate is None."""
        known = [[] if None in place else [value] for value in place]
        self.chosen.data = dict(zip("xy", known, strict=True))

    def _show_points(self) -> None:
        column, coloured = self.points.columns[self.colour], self._coloured
        marks = [MARKERS[0]] * self.points.count
        if self.marker != NO_MARKER:
            kinds = colouring(self.points.columns[self.marker]).values
            marks = [MARKERS[int(np.nan_to_num(kind)) % len(MARKERS)] for kind in kinds]
        cells = even_cells(self.values(self.x), self.values(self.y))
        if cells is not None:  # a grid is drawn as cells; a lasso chooses from invisible dots
            self.paint()
        else:
            self.image.data = {name: [] for name in self.image.data}
        self.over_dots.renderers = [self.dots] if cells is None else []
        alpha = 1.0 if cells is None or self.marker != NO_MARKER else 0.0
        said = [
            column.codes.get(int(v), f"{v:.6g}") if v == v else "not known" for v in column.values
        ]
        self.source.data = {
            "x": self.values(self.x),
            "y": self.values(self.y),
            "value": coloured.scaled(coloured.values),
            "alpha": np.full(self.points.count, alpha),
            "marker": marks,
            "said": said,
        }

    def _show_curves(self) -> None:
        ends, self.why_no_curves = window_ends(self.points, (self.x, self.y))
        for source, is_upper in ((self.solid, False), (self.dashed, True)):
            shown = [end for end in ends if end.is_upper == is_upper]
            source.data = {"xs": [end.x for end in shown], "ys": [end.y for end in shown]}
        borders = [one for one in self.points.borders if {self.x, self.y} <= one.values.keys()]
        self.borders.data = {
            "xs": [one.values[self.x] for one in borders],
            "ys": [one.values[self.y] for one in borders],
            "name": [one.name for one in borders],
            "dash": [one.dash for one in borders],
        }
        places = [
            _place(end, limits(self.values(self.x)), limits(self.values(self.y)), i)
            for i, end in enumerate(ends)
        ]
        forcing = SYMBOLS.get(self.y, SYMBOLS.get(self.x, ""))
        self.names.data = {
            "x": [place[0] for place in places],
            "y": [place[1] for place in places],
            "text": [f"{forcing} {SUBSCRIPTS[end.is_upper]}({end.mode})" for end in ends],
        }


def limits(values: Array) -> tuple[float, float]:
    """Ends of an axis that shows all values, with a margin."""
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    margin = MARGIN * high - MARGIN * low or 0.5
    return max(low - margin, -LARGEST), min(high + margin, LARGEST)


def _place(
    end: WindowEnd, across: tuple[float, float], up: tuple[float, float], number: int
) -> tuple[float, float]:
    """Place for the name of a curve, on its visible part; successive names are staggered."""
    visible = np.flatnonzero(
        (end.x > across[0]) & (end.x < across[1]) & (end.y > up[0]) & (end.y < up[1])
    )
    at = visible[int((0.2 + 0.6 * (number % 3) / 2.0) * (visible.size - 1))]
    return float(end.x[at]), float(end.y[at])
