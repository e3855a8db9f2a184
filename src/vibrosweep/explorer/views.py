"""The figures of a page in Bokeh: the plane of a result, and the motion of one realization.

The plane shows points or pixels, closed forms and the chosen point; the motion is shown as height
against time, return map, phases and separations.  What the served page and the page in a file have
in common is at the end.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr
from bokeh.core.property.descriptors import UnsetValueError
from bokeh.document import Document
from bokeh.events import DocumentReady, RangesUpdate
from bokeh.layouts import row
from bokeh.models import (
    BoxSelectTool,
    Button,
    ColorBar,
    ColumnDataSource,
    CustomAction,
    CustomJS,
    CustomJSHover,
    Div,
    FixedTicker,
    HoverTool,
    LassoSelectTool,
    LinearColorMapper,
    LogColorMapper,
    NumericInput,
    PreText,
    Range1d,
    SaveTool,
    Select,
    Slider,
    Span,
    Toggle,
)
from bokeh.palettes import Viridis256
from bokeh.plotting import figure
from matplotlib.ticker import LogLocator, MaxNLocator

from vibrosweep.arrays import Array
from vibrosweep.explorer.pictures import (
    DOTS,
    HEIGHT,
    LARGEST,
    Axis,
    Columns,
    View,
    curves_over,
    even_cells,
    heights,
    is_window,
    nearest,
    raster,
    visible_rows,
)
from vibrosweep.explorer.points import SYMBOLS, Column, Points
from vibrosweep.explorer.words import TABLE
from vibrosweep.figures.paint import scale_ends
from vibrosweep.figures.style import OKABE_ITO
from vibrosweep.figures.windows import name_places

# Most pixels along an axis, more than screens have: an array of them must fit in memory
MOST_PIXELS: Final = 8192
SVG_ICON: Final = (
    "data:image/svg+xml;base64,"
    + b64encode(
        b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 20 20"><text x="1" y="14" '
        b'font-family="sans-serif" font-size="9" font-weight="bold" fill="#5b5b5b">SVG</text></svg>'
    ).decode()
)
TO_SVG: Final = """
const layer = Bokeh.index.find_one_by_id(plot.id).export("svg")
layer.to_blob().then((blob) => {
  const link = document.createElement("a")
  link.href = URL.createObjectURL(blob)
  link.download = `${plot.name}.svg`
  link.click()
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000) // a browser may read it later
})
"""


def empty_source(*names: str) -> ColumnDataSource:
    """Columns of these names, without rows."""
    return ColumnDataSource({name: [] for name in names})


def svg_tool(plot: Any) -> CustomAction:
    """Button of a toolbar that saves a picture as SVG; the tool of Bokeh saves PNG."""
    plot.select_one(SaveTool).filename = plot.name
    return CustomAction(
        icon=SVG_ICON,
        description="Save as SVG",
        callback=CustomJS(args={"plot": plot}, code=TO_SVG),
    )


def inner_pixels(plot: Any, guess: tuple[int, int]) -> tuple[int, int]:
    """Columns and rows of pixels within the axes; a guess until the browser has sent them."""
    try:
        width, height = plot.inner_width, plot.inner_height
    except UnsetValueError:
        return guess
    if min(width, height) <= 0:  # 0 where it is hidden
        return guess
    return min(width, MOST_PIXELS), min(height, MOST_PIXELS)


GREY: Final = "#b5b5b5"
NAMED: Final = (*OKABE_ITO, GREY)
UNKNOWN: Final = "rgba(0, 0, 0, 0)"


class Scale(NamedTuple):
    """The visitor's choice of the colours of numbers."""

    kind: str = "automatic"  # one of `SCALES`
    # Ends; None to follow the numbers
    low: float | None = None
    high: float | None = None


SCALES: Final = ("automatic", "linear", "logarithmic")
AUTOMATIC: Final = Scale()


@dataclass(frozen=True)
class Colouring:
    """Colours of a column."""

    # Values to be coloured, shape (point,): numbers, or for codes their position in `names`
    values: Array
    title: str  # label of the column, and meaning of grey
    # low, high: ends of the scale, which `palette` divides evenly
    low: float
    high: float
    palette: Sequence[str] = Viridis256
    below: str = Viridis256[0]  # colour of values below the scale
    log: bool = False  # True for a logarithmic scale
    # Meanings of the codes that occur; the last one stands for all codes without a colour
    names: Sequence[str] = ()

    def scaled(self, values: Array) -> Array:
        """Numbers whose colours are linear between the ends of `mapping`: values or logarithms."""
        if not self.log:
            return values
        with np.errstate(divide="ignore", invalid="ignore"):  # zeros are below the scale
            return np.log(values)

    @property
    def mapping(self) -> dict[str, Any]:
        """Properties of the linear mapper with which all pictures of `scaled` are coloured."""
        low, high = self.scaled(np.array([self.low, self.high])).tolist()
        return {"palette": self.palette, "low": low, "high": high, "low_color": self.below}

    @property
    def ticks(self) -> dict[float, str]:
        """Numbers beside the colour bar; an arrow marks an end beyond which there are more."""
        known = self.values[np.isfinite(self.values)]
        least, most = self.scaled(np.array([self.low, self.high])).tolist()
        beside = 1e-6 * (most - least)  # a tick at the very end may be rounded away
        ends = [least + beside, most - beside]
        low, high = np.exp(ends).tolist() if self.log else ends
        clipped = {low: f"▼ {self.low:.3g}"} if np.any(known < self.low) else {}
        clipped |= {high: f"▲ {self.high:.3g}"} if np.any(known > self.high) else {}
        decades = np.log10(self.high / self.low) if self.log else 0.0
        fine = LogLocator(subs=(1.0, 2.0, 5.0) if decades < 2.0 else (1.0,))
        chosen = fine if self.log else MaxNLocator(6)
        found = np.asarray(chosen.tick_values(self.low, self.high), np.float64)
        clear = self.scaled(np.array([*clipped], np.float64))
        ticks = {}
        for tick, place in zip(found.tolist(), self.scaled(found), strict=True):
            far = bool(np.all(abs(place - clear) > 0.06 * (most - least)))
            if far and least <= place <= most:
                ticks[tick] = f"{tick:.6g}"
        return ticks | clipped

    @property
    def bar(self) -> dict[str, Any]:
        """Properties of the colour bar."""
        kind = LogColorMapper if self.log else LinearColorMapper
        labels = {float(i): name for i, name in enumerate(self.names)} or self.ticks
        return {
            "ticker": FixedTicker(ticks=[*labels]),
            "major_label_overrides": labels,
            "tags": [*self.names],
            # the last one, since it makes the browser rebuild the bar, with the other two
            "color_mapper": kind(palette=self.palette, low=self.low, high=self.high),
        }


def colouring(column: Column, wish: Scale = AUTOMATIC) -> Colouring:
    """Colour a column: codes in a palette, numbers along a scale, zeros of separations in grey.

    Chosen ends that leave no scale between them are ignored.
    """
    if column.codes:
        return _of_codes(column)
    values = column.values
    known = values[np.isfinite(values)]
    positive = known[known > 0.0]
    log = column.zero_apart if wish.kind == SCALES[0] else wish.kind == SCALES[2]
    log &= positive.size > 0
    if log:
        # a few almost coincident landings would stretch the scale to the limits of precision
        high = float(positive.max())
        low = max(float(np.quantile(positive, 0.01)), 1e-6 * high)
        high = max(high, 1.01 * low)
    else:
        low, high = scale_ends(known) if known.size else (0.0, 1.0)
        low, high = (low, high) if low < high else (low - 0.5, high + 0.5)
    wished = low if wish.low is None else wish.low, high if wish.high is None else wish.high
    if wished[0] < wished[1] and (wished[0] > 0.0 or not log):
        low, high = wished
    least = float(known.min()) if known.size else low
    grey = ""
    if np.any(values == -np.inf):
        grey = "-∞" if least >= low else f"below {low:.3g}"
    elif log and least < low:
        grey = "0" if not np.any(positive < low) else f"below {low:.3g}"
    title = f"{column.label}, grey: {grey}" if grey else column.label
    return Colouring(values, title, low, high, below=GREY if grey else Viridis256[0], log=log)


def _of_codes(column: Column) -> Colouring:
    present = [code for code in column.codes if np.any(column.values == code)]
    names = [column.codes[code] for code in present]
    if len(present) > len(NAMED):
        rest = len(present) - len(NAMED) + 1
        names = [*names[: len(NAMED) - 1], f"{rest} others"]
    position = np.full(column.values.shape, np.nan)
    for i, code in enumerate(present):
        position[column.values == code] = min(i, len(names) - 1)
    palette = NAMED[: max(len(names), 1)]
    high = len(palette) - 0.5
    return Colouring(position, column.label, -0.5, high, palette, palette[0], names=names)


def particle_colours(count: int) -> list[str]:
    """One colour for each particle."""
    if count <= len(OKABE_ITO):
        return list(OKABE_ITO[:count])
    # without the palest tenth of the palette, in which thin lines would vanish on white
    return [Viridis256[int(i)] for i in np.linspace(0, 0.9 * 255, count)]


Window = tuple[float, float, float, float]  # both ends of x, then of y

SCRIPT: Final = (Path(__file__).parent / "motion.js").read_text("utf-8")
CURSOR: Final = (Path(__file__).parent / "cursor.js").read_text("utf-8")
ALONG: Final = "time.setv({value: Math.min(cb_obj.value, time.end)}, {sync: false})"
# The cursor crosses the visible part of the motion in ten seconds
PLAY: Final = """
let before = null
const step = (now) => {
  if (!cb_obj.active) return
  const low = Math.max(view.start, time.start), high = Math.min(view.end, time.end)
  const passed = before === null ? 0 : (now - before) / 10_000 * (high - low)
  before = now
  const t = time.value < low || time.value >= high ? low : Math.min(time.value + passed, high)
  time.setv({value: t}, {sync: false})
  if (t < high) requestAnimationFrame(step)
  else cb_obj.active = false
}
if (cb_obj.active) requestAnimationFrame(step)
cb_obj.label = cb_obj.active ? "⏸ stop" : "▶ play"
"""

TITLES: Final = {
    "height": "Height against time",
    "return map": "Return map",
    "phases": "Landing phases",
    "separations": "Separations",
}
LABELS: Final = {
    HEIGHT: ("time t (s)", "height y (m)"),
    **{name: (dots.x_label, dots.y_label) for name, dots in DOTS.items()},
}
FLIGHT: Final = ("start", "y_start", "end", "y_end", "cx", "cy")
STAY: Final = FLIGHT[:4]
OF_TIME: Final = (HEIGHT, "phases", "separations")  # pictures whose horizontal axis is the time
ENDS: Final = ("start", "end")
# Pixels of a picture, and of the plane, until the browser has sent the true number; few pictures
# have more
GUESS: Final = (1000, 500)


class MotionView:
    """Pictures of one realization.

    Parameters
    ----------
    key
        Name of the view, unique on its page.
    complete
        True if the browser holds all elements.  Otherwise it is sent those that are visible in the
        present window, whenever the window changes.

    Attributes
    ----------
    holder
        Source whose entry ``content`` holds the data that were sent last.  They are sent as one
        message, so that the browser draws each picture once; Bokeh would send one for each model.
    """

    def __init__(self, key: str, *, complete: bool = False) -> None:
        self.complete = complete
        self.mapper = LinearColorMapper(palette=["#000000"], low=-0.5, high=0.5)
        self.colour = {"field": "particle", "transform": self.mapper}
        self.sources = {
            "base": empty_source("time", "height", "floor"),
            "flights": empty_source(*FLIGHT, "particle"),
            "stays": empty_source(*STAY, "particle"),
            **{name: empty_source(dots.x, dots.y, "particle") for name, dots in DOTS.items()},
        }
        self.sources["separations"].add([], "previous_particle")
        self.sources["return map"].add([], "landing_time")
        self._columns: dict[str, Columns] = {}
        self._views: dict[str, Window] = {}
        self.figures = {name: self._figure(name, key) for name in TITLES}
        self._draw_heights()
        for name in DOTS:
            self._draw_dots(name)
        self.heading = Div(text="", sizing_mode="stretch_width", name=f"heading {key}")
        self.holder = ColumnDataSource({"content": [{}]}, name=f"shown {key}")
        self.heading.tags = [self.holder]  # a browser receives only models that belong to a widget
        shown = {"holder": self.holder, "sources": self.sources, "figures": self.figures}
        self.clock = self._clock(key)
        texts = {"particles": self.mapper, "heading": self.heading, "time": self.time}
        self.script = CustomJS(args={**shown, **texts}, code=SCRIPT)
        self.holder.js_on_change("data", self.script)

    def _figure(self, name: str, key: str) -> Any:
        large = name == "height"
        given = {"y_axis_type": "log"} if self._is_log(name) else {}
        plot = figure(
            title=TITLES[name],
            height=290 if large else 250,
            min_width=240,
            sizing_mode="stretch_width",
            tools="pan,wheel_zoom,box_zoom,reset,save",
            active_drag="box_zoom",
            toolbar_location="right" if large else "above",
            x_axis_label=LABELS[name][0],
            y_axis_label=LABELS[name][1],
            x_range=Range1d(0, 1),
            y_range=Range1d(1e-3, 1),
            name=f"{name} {key}",
            **given,
        )
        plot.toolbar.logo = None
        plot.toolbar.autohide = not large
        plot.add_tools(svg_tool(plot))
        if not self.complete:
            plot.on_event(RangesUpdate, lambda event: self._moved(name, event))
        return plot

    @staticmethod
    def _is_log(name: str) -> bool:
        return name in DOTS and DOTS[name].log

    def _clock(self, key: str) -> Any:
        """Button and slider of the time, whose cursor is drawn in all four pictures."""
        spans = [Span(dimension="height", line_color="#d00000", visible=False) for _ in OF_TIME]
        for name, span in zip(OF_TIME, spans, strict=True):
            self.figures[name].add_layout(span)
        dots = {"size": 9, "fill_color": self.colour, "line_color": "black"}
        there = {name: empty_source("x", "y", "particle") for name in (HEIGHT, "return map")}
        for name, source in there.items():
            self.figures[name].scatter("x", "y", source=source, **dots)
        play = Toggle(label="▶ play", width=80, name=f"play {key}")
        self.time = time = Slider(
            title="time t (s)", start=0.0, end=1.0, step=1e-4, value=0.0, format="0[.]0000"
        )
        time.update(sizing_mode="stretch_width", name=f"time {key}")
        args = {"time": time, "spans": spans, "there": there, "sources": self.sources}
        time.js_on_change("value", CustomJS(args=args, code=CURSOR))
        view = self.figures[HEIGHT].x_range
        play.js_on_change("active", CustomJS(args={"time": time, "view": view}, code=PLAY))
        return row(play, time, sizing_mode="stretch_width", name=f"clock {key}")

    def _draw_heights(self) -> None:
        plot, colour, base = self.figures["height"], self.colour, self.sources["base"]
        plot.varea("time", "floor", "height", source=base, fill_color="#e6e6e6")
        plot.line("time", "height", source=base, line_color="#888888")
        # lines of one pixel are drawn twice as fast as wider ones
        plot.quadratic(*FLIGHT, source=self.sources["flights"], line_color=colour, line_width=1)
        plot.segment(
            *STAY, source=self.sources["stays"], line_color=colour, line_width=4, line_cap="round"
        )

    def _draw_dots(self, name: str) -> None:
        plot, x, y = self.figures[name], DOTS[name].x, DOTS[name].y
        source = self.sources[name]
        if name == "return map":
            plot.line(x=[-1e6, 1e6], y=[-1e6, 1e6], line_color="#bbbbbb")
        drawn = plot.scatter(
            x, y, source=source, marker="square", size=3, fill_color=self.colour, line_color=None
        )
        tips = [(LABELS[name][0], f"@{x}{{0.000000}}"), (LABELS[name][1], f"@{y}{{0.00000000}}")]
        others = [("particle", "@particle")]
        if "previous_particle" in source.data:
            others.append(("after particle", "@previous_particle"))
        plot.add_tools(HoverTool(renderers=[drawn], tooltips=[*tips, *others]))

    @property
    def roots(self) -> list[Any]:
        """Heading, figures and clock, in the order of the page."""
        return [self.heading, self.clock, *self.figures.values()]

    @property
    def content(self) -> dict[str, Any]:
        """Data that were sent last: columns of `sources` by name, ``views``, heading."""
        return dict(self.holder.data["content"][0])

    def show(self, record: xr.Dataset, words: str) -> None:
        """Show a record under a heading."""
        found = heights(record)
        self._columns = {
            "flights": found.flights,
            "stays": found.stays,
            **{name: dots.columns(record) for name, dots in DOTS.items()},
        }
        span, (bottom, top) = found.span
        margin = 0.06 * (top - bottom)
        arrivals = self._columns["return map"]
        speeds = np.concatenate([arrivals["arrival_speed"], arrivals["next_arrival_speed"]])
        fastest, slowest = float(speeds.max(initial=0.1)), float(speeds.min(initial=0.0))
        view = (slowest - 0.04 * fastest, 1.06 * fastest)
        gaps = self._columns["separations"]["separation"]
        known = gaps[gaps > 0.0]
        low, high = (float(known.min()), float(known.max())) if known.size else (1e-3, 1.0)
        self._views = {
            "height": (*span, bottom - margin, top + margin),
            "return map": (*view, *view),
            "phases": (*span, -0.02, 1.02),
            "separations": (*span, low / 2.0, high * 2.0),
        }
        together = int(np.count_nonzero(gaps == 0.0))
        note = f"; {together} landings coincide with another one, and have no separation"
        floor = np.full(found.base["time"].shape, bottom - margin)
        content = {
            "base": {**found.base, "floor": floor},
            "views": {name: list(view) for name, view in self._views.items()},
            "palette": particle_colours(record.sizes["particle"]),
            "heading": f"<b>{words}</b>{note if together else ''}",
        }
        for name in TITLES:
            content.update(self._visible(name))
        self.holder.data = {"content": [content]}

    def _moved(self, name: str, event: RangesUpdate) -> None:
        """Send the elements that are visible after a move of the window of a picture."""
        ends = event.x0, event.x1, event.y0, event.y1
        if is_window(*ends):
            self._views[name] = ends
            self.holder.data = {"content": [self._visible(name)]}

    def _visible(self, name: str) -> dict[str, Columns]:
        """Columns of the elements that are visible in the window of a picture."""
        if name != HEIGHT:
            x, y = (self._columns[name][column] for column in (DOTS[name].x, DOTS[name].y))
            return {name: self._taken(name, name, [x], y)}
        flights, stays = self._columns["flights"], self._columns["stays"]
        middles = {
            "flights": (flights["y_start"] + 2.0 * flights["cy"] + flights["y_end"]) / 4.0,
            "stays": (stays["y_start"] + stays["y_end"]) / 2.0,
        }
        return {
            source: self._taken(name, source, [self._columns[source][e] for e in ENDS], middle)
            for source, middle in middles.items()
        }

    def _taken(self, name: str, source: str, across: list[Array], up: Array) -> Columns:
        rows = np.arange(up.size) if self.complete else visible_rows(across, up, *self._axes(name))
        return {n: self._columns[source][n][rows] for n in self.sources[source].data}

    def _axes(self, name: str) -> tuple[Axis, Axis]:
        columns, rows = inner_pixels(self.figures[name], GUESS)
        left, right, low, high = self._views[name]
        return Axis(left, right, columns), Axis(low, high, rows, log=self._is_log(name))


# Number of points above which they are gathered in pixels
MANY: Final = 20_000
DENSE: Final = 1000  # number above which those of a grid are never drawn as dots
NO_MARKER: Final = "(none)"
MARKERS: Final = ("circle", "square", "triangle", "diamond", "inverted_triangle", "plus", "x")
MARGIN: Final = 0.03
# Distance in pixels up to which a click selects a point
REACH: Final = 12.0
PLANE_HEIGHT: Final = 430
PLANE_GUESS: Final = (PLANE_HEIGHT, PLANE_HEIGHT)
# For the places of names, which are half as wide again as those of a figure of the same size
PLANE_INCHES: Final = (3.0, 3.0)
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
if (isNaN(value)) return "not known"
if (bar.tags.length) return bar.tags[value]
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
        self.colour, self.marker, self.wish = points.colour, NO_MARKER, AUTOMATIC
        self.pixels = points.count > MANY
        # Dots of a dense grid over other axes would make a moire
        regular = len(points.varied) > 1 and points.count > DENSE
        self.regular = regular and even_cells(*map(self.values, points.varied[:2])) is not None
        self.source = empty_source("x", "y", "value", "alpha", "marker", "said")
        self.image = empty_source("image", "x", "y", "dw", "dh")
        self.ends = empty_source("xs", "ys", "dash")
        self.names = empty_source("x", "y", "text")
        self.chosen, self.pinned = empty_source("x", "y"), empty_source("x", "y")
        self.borders = empty_source("xs", "ys", "name", "dash")
        self.curves = (self.ends, self.names, self.borders)
        self.why_no_curves = ""
        self.figure = self._figure()
        self.show()

    def _figure(self) -> Any:
        plot = figure(
            height=PLANE_HEIGHT,
            sizing_mode="stretch_width",
            tools="pan,wheel_zoom,box_zoom,reset,save",
            active_drag=None,
            active_scroll="wheel_zoom",
            x_range=Range1d(0, 1),
            y_range=Range1d(0, 1),
            name="plane",
            toolbar_location="below",
        )
        plot.toolbar.logo = None
        plot.add_tools(svg_tool(plot), LassoSelectTool(continuous=False), BoxSelectTool())
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
        plot.multi_line("xs", "ys", source=self.ends, line_color="black", line_dash="dash")
        lines = {"line_dash": "dash", "line_width": 2.0, "line_color": "#c2006f"}
        drawn = plot.multi_line("xs", "ys", source=self.borders, **lines)
        plot.add_tools(HoverTool(renderers=[drawn], tooltips=[("orbit", "@name")]))
        words = plot.text("x", "y", "text", source=self.names, text_align="center", **SMALL)
        words.glyph.update(background_fill_color="white", background_fill_alpha=0.85, padding=2)
        ring = {"size": 15, "fill_color": None, "line_width": 2.5}
        for source, colour in ((self.pinned, "#0057d0"), (self.chosen, "#d00000")):
            plot.scatter("x", "y", source=source, line_color=colour, **ring)
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
        self._coloured = colouring(column, self.wish)
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
        left, right, bottom, top = self.window
        view = View((left, right), (bottom, top), *inner_pixels(self.figure, PLANE_GUESS))
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
        columns, rows = inner_pixels(self.figure, PLANE_GUESS)
        left, right, bottom, top = self.window
        unit = abs(right - left) / columns, abs(top - bottom) / rows
        x, y = self.values(self.x), self.values(self.y)
        index = nearest(x, y, place, unit)
        with np.errstate(over="ignore"):
            far = np.hypot((x[index] - place[0]) / unit[0], (y[index] - place[1]) / unit[1])
        return index, bool(far <= REACH)

    @property
    def whole(self) -> Window:
        """Ends of the view of all points: left, right, bottom, top."""
        return (*limits(self.values(self.x)), *limits(self.values(self.y)))

    @property
    def views(self) -> tuple[Range1d, Range1d]:
        """Ranges of both axes."""
        return self.figure.x_range, self.figure.y_range

    @property
    def window(self) -> Window:
        """Ends of the present view."""
        x, y = self.views
        ends = (x.start, x.end, y.start, y.end)
        if is_window(*ends):
            return ends
        return self.whole

    def mark(self, *place: float | None, pinned: bool = False) -> None:
        """Put the ring of the shown motion at a place; remove it if a coordinate is None."""
        known = [[] if None in place else [value] for value in place]
        (self.pinned if pinned else self.chosen).data = dict(zip("xy", known, strict=True))

    def _show_points(self) -> None:
        column, coloured = self.points.columns[self.colour], self._coloured
        marks = [MARKERS[0]] * self.points.count
        if self.marker != NO_MARKER:
            kinds = colouring(self.points.columns[self.marker]).values
            marks = [MARKERS[int(np.nan_to_num(kind)) % len(MARKERS)] for kind in kinds]
        cells = self.regular or even_cells(self.values(self.x), self.values(self.y)) is not None
        if cells:  # a lasso chooses from invisible dots
            self.paint()
        else:
            self.image.data = {name: [] for name in self.image.data}
        self.over_dots.renderers = [] if cells else [self.dots]
        alpha = 1.0 if not cells or self.marker != NO_MARKER else 0.0
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
        ends, self.why_no_curves = curves_over(self.points, (self.x, self.y))
        self.ends.data = {
            "xs": [end.x for end in ends],
            "ys": [end.y for end in ends],
            "dash": ["dashed" if end.is_upper else "solid" for end in ends],
        }
        borders = [one for one in self.points.borders if {self.x, self.y} <= one.values.keys()]
        self.borders.data = {
            "xs": [one.values[self.x] for one in borders],
            "ys": [one.values[self.y] for one in borders],
            "name": [one.name for one in borders],
            "dash": [one.dash for one in borders],
        }
        views = limits(self.values(self.x)), limits(self.values(self.y))
        named = [*name_places(ends, *views, PLANE_INCHES)]
        forcing = SYMBOLS.get(self.y, SYMBOLS.get(self.x, ""))
        self.names.data = {
            "x": [end.x[at] for end, at in named],
            "y": [end.y[at] for end, at in named],
            "text": [f"{forcing} {SUBSCRIPTS[end.is_upper]}({end.mode})" for end, _ in named],
        }


def limits(values: Array) -> tuple[float, float]:
    """Ends of an axis that shows all values, with a margin."""
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    margin = MARGIN * high - MARGIN * low or 0.5
    return max(low - margin, -LARGEST), min(high + margin, LARGEST)


TEMPLATE: Final = (Path(__file__).parent / "page.html").read_text("utf-8")
FIT: Final = """
const label = cb_obj.options.find(([key, label]) => key === cb_obj.value)[1]
cb_obj.min_width = Math.min(60 + 7 * label.length, 350)
"""
MENUS: Final = {"x": "horizontal", "y": "vertical", "colour": "colour", "marker": "marker"}
WRAP: Final = {"flex-wrap": "wrap"}


def picker(plane: PlaneView, name: str) -> Select:
    """Menu of the columns for x, y, colour or marker of the plane."""
    columns = plane.points.columns
    options = [(key, one.label) for key, one in columns.items()]
    if name == "marker":
        coded = [option for option in options if columns[option[0]].codes]
        options = [(NO_MARKER, "no markers"), *coded]
    menu = Select(
        title=MENUS[name],
        value=getattr(plane, name),
        options=options,
        sizing_mode="stretch_width",
        name=name,
    )
    menu.js_on_change("value", CustomJS(code=FIT))
    menu.min_width = menu_width(dict(options)[menu.value])
    return menu


def menu_width(label: str) -> int:
    """Pixels in which a menu shows a label; at most those of a narrow page."""
    return min(60 + 7 * len(label), 350)


def scale_pickers(plane: PlaneView) -> tuple[Select, NumericInput, NumericInput]:
    """Menu of the scale of colours, and fields of its ends; hidden while codes are coloured."""
    ends = [
        NumericInput(mode="float", placeholder="automatic", title=f"colours {name}", name=name)
        for name in ("from", "to")
    ]
    scale = Select(title="scale", value=SCALES[0], options=[*SCALES], name="scale")
    for one in (scale, *ends):
        one.update(sizing_mode="stretch_width", min_width=100)
        one.visible = not plane.points.columns[plane.colour].codes
    return scale, *ends


def picker_row(name: str, pickers: Iterable[Any]) -> Any:
    """Row of menus, which wraps on a narrow page."""
    return row(*pickers, styles=WRAP, sizing_mode="stretch_width", name=name)


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
    first, *others = (motion.time for motion in motions)
    for time in others:  # the first cursor moves the others
        first.js_on_change("value", CustomJS(args={"time": time}, code=ALONG))
    with document.models.freeze():  # otherwise each root makes Bokeh gather all models again
        for root in roots:
            document.add_root(root)
    document.js_on_event(DocumentReady, *(motion.script for motion in motions))
    return {
        "left": [root.name for root in left],
        "motions": [[root.name for root in motion.roots] for motion in motions],
        "right": [root.name for root in right],
    }
