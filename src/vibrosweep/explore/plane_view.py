"""The plane of a result as a Bokeh figure: points or pixels, closed forms, the chosen point."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from bokeh.models import (
    BoxSelectTool,
    ColorBar,
    HoverTool,
    LassoSelectTool,
    Range1d,
)
from bokeh.plotting import figure

from vibrosweep.arrays import Array
from vibrosweep.explore.colours import colouring
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
        self.source = empty_source("x", "y", "value", "marker", "said")
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
        self.painted = plot.image("image", "x", "y", "dw", "dh", source=self.image)
        self.dots = plot.scatter("x", "y", source=self.source, marker="marker", line_color=None)
        self.dots.nonselection_glyph.fill_alpha = 0.15
        for source, dash in ((self.solid, "solid"), (self.dashed, "dashed")):
            plot.multi_line("xs", "ys", source=source, line_color="black", line_dash=dash)
        lines = {"line_dash": "dash", "line_width": 2.0, "line_color": "#c2006f"}
        drawn = plot.multi_line("xs", "ys", source=self.borders, **lines)
        plot.add_tools(HoverTool(renderers=[drawn], tooltips=[("orbit", "@name")]))
        words = plot.text("x", "y", "text", source=self.names, text_align="center", **SMALL)
        words.glyph.update(background_fill_color="white", background_fill_alpha=0.85, padding=2)
        ring = {"size": 15, "fill_color": None, "line_color": "#d00000", "line_width": 2.5}
        plot.scatter("x", "y", source=self.chosen, **ring)
        self.hover = HoverTool(renderers=[self.painted if self.pixels else self.dots])
        plot.add_tools(self.hover)
        return plot

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
        mapper = self._coloured.mapper
        self.dots.glyph.fill_color = {"field": "value", "transform": mapper}
        self.painted.glyph.color_mapper = mapper
        self.figure.title.text = f"colour: {self._coloured.title}"
        self.scale.update(**self._coloured.scale)
        x, y, value = ("$x", "$y", "@image") if self.pixels else ("@x", "@y", "@said")
        labels = [self.points.columns[name].label for name in (self.x, self.y)]
        self.hover.tooltips = [
            (labels[0], x + "{0.0000}"),
            (labels[1], y + "{0.0000}"),
            (column.label, value),
        ]
        if self.pixels:
            self.paint()
        else:
            self._show_points()

    def paint(self) -> None:
        """Gather the points in the pixels of the present view."""
        left, right, bottom, top = self._window()
        view = View((left, right), (bottom, top), *inner_pixels(self.figure, GUESS))
        names = self._coloured.names
        codes = np.arange(len(names), dtype=np.float64) if names else None
        found = raster(self.values(self.x), self.values(self.y), self._coloured.values, view, codes)
        self.image.data = {
            "image": [found.values],
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

    def mark(self, x: float, y: float) -> None:
        """Put the ring of the chosen realization at a place."""
        self.chosen.data = {"x": [x], "y": [y]}

    def mark_point(self, index: int) -> None:
        """Put the ring around a point."""
        self.mark(float(self.values(self.x)[index]), float(self.values(self.y)[index]))

    def _show_points(self) -> None:
        column, coloured = self.points.columns[self.colour], self._coloured
        marks = [MARKERS[0]] * self.points.count
        if self.marker != NO_MARKER:
            kinds = colouring(self.points.columns[self.marker]).values
            marks = [MARKERS[int(np.nan_to_num(kind)) % len(MARKERS)] for kind in kinds]
        size = float(np.clip(160.0 / np.sqrt(self.points.count), 3.0, 9.0))
        cells = even_cells(self.values(self.x), self.values(self.y))
        if cells is not None:  # a grid is drawn as cells; invisible dots react to the pointer
            self.paint()
            size = HEIGHT / max(cells.shape)
        else:
            self.image.data = {name: [] for name in self.image.data}
        alpha = 1.0 if cells is None or self.marker != NO_MARKER else 0.0
        self.dots.glyph.update(size=size if cells is None else max(size, 3.0), fill_alpha=alpha)
        said = [
            column.codes.get(int(v), f"{v:.6g}") if v == v else "not known" for v in column.values
        ]
        self.source.data = {
            "x": self.values(self.x),
            "y": self.values(self.y),
            "value": coloured.values,
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
