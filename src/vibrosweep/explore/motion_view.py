"""The motion of one realization as four Bokeh figures: height, return map, phases, separations."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr
from bokeh.events import RangesUpdate
from bokeh.models import (
    ColumnDataSource,
    CustomJS,
    Div,
    HoverTool,
    LinearColorMapper,
    Range1d,
)
from bokeh.plotting import figure

from vibrosweep.arrays import Array
from vibrosweep.explore.colours import particle_colours
from vibrosweep.explore.pictures import DOTS, HEIGHT, Columns, heights
from vibrosweep.explore.sources import empty_source, inner_pixels, is_window
from vibrosweep.explore.visible import Axis, visible_rows

View = tuple[float, float, float, float]  # both ends of x, then of y

SCRIPT: Final = (Path(__file__).parent / "motion.js").read_text("utf-8")

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
ENDS: Final = ("start", "end")
# Pixels of a picture until the browser has sent the true number; few pictures have more
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
        self._columns: dict[str, Columns] = {}
        self._views: dict[str, View] = {}
        self.figures = {name: self._figure(name, key) for name in TITLES}
        self._draw_heights()
        for name in DOTS:
            self._draw_dots(name)
        self.heading = Div(text="", sizing_mode="stretch_width", name=f"heading {key}")
        self.holder = ColumnDataSource({"content": [{}]}, name=f"shown {key}")
        self.heading.tags = [self.holder]  # a browser receives only models that belong to a widget
        shown = {"holder": self.holder, "sources": self.sources, "figures": self.figures}
        self.script = CustomJS(
            args={**shown, "particles": self.mapper, "heading": self.heading}, code=SCRIPT
        )
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
        if not self.complete:
            plot.on_event(RangesUpdate, lambda event: self._moved(name, event))
        return plot

    @staticmethod
    def _is_log(name: str) -> bool:
        return name in DOTS and DOTS[name].log

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
        """Heading and figures, in the order of the page."""
        return [self.heading, *self.figures.values()]

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
