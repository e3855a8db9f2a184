"""The motion of one realization as four Bokeh figures: height, return map, phases, separations."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr
from bokeh.layouts import column, row
from bokeh.models import (
    Div,
    HoverTool,
    LinearColorMapper,
    Range1d,
)
from bokeh.plotting import figure

from vibrosweep.explore import pictures
from vibrosweep.explore.colours import particle_colours
from vibrosweep.explore.sources import empty_source

__all__ = ["TITLES", "MotionView"]

TITLES: Final = {
    "height": "Height against time",
    "return map": "Return map",
    "phases": "Landing phases",
    "separations": "Separations",
}
AXES: Final = {
    "height": ("time t (s)", "height y (m)"),
    "return map": ("speed of arrival vₙ (m s⁻¹)", "next one vₙ₊₁ (m s⁻¹)"),
    "phases": ("time t (s)", "phase of landing (turns)"),
    "separations": ("time t (s)", "time since another landed (s)"),
}
DOTS: Final = {
    "return map": ("speed", "next"),
    "phases": ("time", "phase"),
    "separations": ("time", "gap"),
}
FLIGHT: Final = ("start", "y_start", "end", "y_end", "cx", "cy")


class MotionView:
    """Pictures of one realization.

    Parameters
    ----------
    key
        Distinguishes the pictures of one view from those of another on the same page.
    """

    def __init__(self, key: str) -> None:
        self.mapper = LinearColorMapper(palette=["#000000"], low=-0.5, high=0.5)
        self.flights = empty_source(*FLIGHT, "particle", "velocity")
        self.stays = empty_source("time", "height", "particle")
        self.base = empty_source("time", "height", "floor")
        self.dots = {
            "return map": empty_source("speed", "next", "particle", "time"),
            "phases": empty_source("time", "phase", "particle"),
            "separations": empty_source("time", "gap", "particle", "other"),
        }
        self.sources = {
            "flights": self.flights,
            "stays": self.stays,
            "base": self.base,
            **self.dots,
        }
        self.figures = {name: self._figure(name, key) for name in TITLES}
        self._draw_heights()
        for name in DOTS:
            self._draw_dots(name)
        self.heading = Div(text="", sizing_mode="stretch_width")
        small = [self.figures[name] for name in DOTS]
        beneath = row(*small, sizing_mode="stretch_width", styles={"flex-wrap": "wrap"})
        self.layout = column(
            self.heading,
            self.figures["height"],
            beneath,
            sizing_mode="stretch_width",
            styles={"flex": "1 1 320px"},  # two of them side by side where there is room
            name=f"motion {key}",
        )

    def _figure(self, name: str, key: str) -> Any:
        large = name == "height"
        given = {"y_axis_type": "log"} if name == "separations" else {}
        plot = figure(
            title=TITLES[name],
            height=290 if large else 250,
            min_width=240,
            sizing_mode="stretch_width",
            tools="pan,wheel_zoom,box_zoom,reset,save",
            active_drag="box_zoom",
            toolbar_location="right" if large else "above",
            x_axis_label=AXES[name][0],
            y_axis_label=AXES[name][1],
            x_range=Range1d(0, 1),
            y_range=Range1d(1e-3, 1),
            name=f"{name} {key}",
            **given,
        )
        plot.toolbar.logo = None
        plot.toolbar.autohide = not large
        return plot

    def _colour(self) -> dict[str, Any]:
        return {"field": "particle", "transform": self.mapper}

    def _draw_heights(self) -> None:
        plot = self.figures["height"]
        plot.varea("time", "floor", "height", source=self.base, fill_color="#e6e6e6")
        plot.line("time", "height", source=self.base, line_color="#888888")
        x0, y0, x1, y1, cx, cy = FLIGHT
        plot.quadratic(
            x0, y0, x1, y1, cx, cy, source=self.flights, line_color=self._colour(), line_width=1.2
        )
        plot.multi_line(
            "time", "height", source=self.stays, line_color=self._colour(), line_width=4
        )

    def _draw_dots(self, name: str) -> None:
        plot, (x, y) = self.figures[name], DOTS[name]
        source = self.dots[name]
        if name == "return map":
            plot.line(x=[-1e6, 1e6], y=[-1e6, 1e6], line_color="#bbbbbb")
        drawn = plot.scatter(x, y, source=source, size=3.5, color=self._colour())
        tips = [(AXES[name][0], f"@{x}{{0.000000}}"), (AXES[name][1], f"@{y}{{0.00000000}}")]
        others = [("particle", "@particle")]
        others += [("after particle", "@other")] if "other" in source.data else []
        plot.add_tools(HoverTool(renderers=[drawn], tooltips=[*tips, *others]))

    def show(self, record: xr.Dataset, words: str) -> None:
        """Show a record; `words` say of what."""
        found = pictures.heights(record)
        count = record.sizes["particle"]
        self.mapper.update(palette=particle_colours(count), high=count - 0.5)
        (begin, end), (bottom, top) = found.span
        room = 0.06 * (top - bottom)
        floor = bottom - room
        self.flights.data = found.flights
        self.stays.data = found.stays
        self.base.data = {**found.base, "floor": np.full(found.base["time"].shape, floor)}
        self._see("height", (begin, end), (floor, top + room))
        drawn = {
            "return map": pictures.return_map(record),
            "phases": pictures.landing_phases(record),
            "separations": pictures.separations(record),
        }
        for name, columns in drawn.items():
            self.dots[name].data = columns
        speeds = np.concatenate([drawn["return map"][name] for name in ("speed", "next")])
        fastest, slowest = float(speeds.max(initial=0.1)), float(speeds.min(initial=0.0))
        view = (slowest - 0.04 * fastest, 1.06 * fastest)
        self._see("return map", view, view)
        self._see("phases", (begin, end), (-0.02, 1.02))
        gaps = drawn["separations"]["gap"]
        known = gaps[gaps > 0.0]
        low, high = (float(known.min()), float(known.max())) if known.size else (1e-3, 1.0)
        self._see("separations", (begin, end), (low / 2.0, high * 2.0))
        self._head(words, found.left_out, int(np.count_nonzero(gaps == 0.0)))

    def shown(self) -> dict[str, Any]:
        """What is shown, as `page.js` shows it again."""
        ranges = {n: (plot.x_range, plot.y_range) for n, plot in self.figures.items()}
        return {
            **{name: dict(source.data) for name, source in self.sources.items()},
            "views": {n: [x.start, x.end, y.start, y.end] for n, (x, y) in ranges.items()},
            "palette": list(self.mapper.palette),
            "heading": self.heading.text,
        }

    def _see(self, name: str, across: tuple[float, float], up: tuple[float, float]) -> None:
        plot = self.figures[name]
        for view, (low, high) in ((plot.x_range, across), (plot.y_range, up)):
            view.update(start=low, end=high, reset_start=low, reset_end=high)

    def _head(self, words: str, left_out: int, together: int) -> None:
        notes = [words]
        if left_out:
            notes.append(f"the {left_out} shortest flights are not drawn")
        if together:
            notes.append(f"{together} landings coincide with another one, and have no separation")
        self.heading.text = f"<b>{notes[0]}</b>" + "".join(f"; {note}" for note in notes[1:])
