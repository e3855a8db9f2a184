"""Pictures of a record of landings: heights against time, and three with a dot per landing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep import analysis
from vibrosweep.analysis.records import BaseMotion, base_motion, course, recoils

Columns = dict[str, NDArray[Any]]

SAMPLES: Final = 48  # points of the base in a forcing period
MOST_SAMPLES: Final = 20_000
OF_STAY: Final = 8  # least number of pieces of a stay on a moving base

HEIGHT: Final = "height"


class Dots(NamedTuple):
    """A picture that shows a dot for each landing, coloured by the particle."""

    analysis: Callable[[xr.Dataset], xr.Dataset]  # from a record to its columns
    # x, y: names of two columns; x_label, y_label: labels of the axes
    x: str
    y: str
    x_label: str
    y_label: str
    log: bool = False  # True if the vertical axis is logarithmic

    def columns(self, record: xr.Dataset) -> Columns:
        """Columns of the dots of the first realization of a record."""
        return {str(name): column.values for name, column in self.analysis(record).items()}


DOTS: Final[Mapping[str, Dots]] = {
    "return map": Dots(
        analysis.return_map,
        "arrival_speed",
        "next_arrival_speed",
        "velocity of arrival vₙ (m s⁻¹)",
        "next velocity of arrival vₙ₊₁ (m s⁻¹)",
    ),
    "phases": Dots(
        analysis.landing_phases, "landing_time", "phase", "time t (s)", "phase of landing (turns)"
    ),
    "separations": Dots(
        analysis.landing_separations,
        "landing_time",
        "separation",
        "time t (s)",
        "time since another landed (s)",
        log=True,
    ),
}


class Heights(NamedTuple):
    """Height against time of one realization."""

    # ``particle``; ``start``, ``end`` (s), ``velocity`` at the start (m s-1), ``y_start`` and
    # ``y_end`` (m) of each flight; ``cx``, ``cy``: control point of the quadratic Bezier curve
    # that is the parabola of the flight
    flights: Columns
    # ``particle``, ``start``, ``end`` (s), ``y_start`` and ``y_end`` (m) of the straight pieces
    # with which stays on the base are drawn
    stays: Columns
    base: Columns  # ``time`` (s) and ``height`` (m) of the base
    # Smallest and largest time (s); smallest and largest height (m)
    span: tuple[tuple[float, float], tuple[float, float]]


def heights(record: xr.Dataset) -> Heights:
    """Flights, stays and the base of the first realization of a record."""
    one = record.isel(realization=0)
    end, gravity = float(one["duration"]), float(one["gravity"])
    base = base_motion(one, "heights")
    found = course(one, base, end)
    particle, flight = np.nonzero(found.flies)
    at = (particle, flight)
    start, stop = found.start[at], found.end[at]
    velocity, low = found.velocity[at], found.height[at]
    half = (stop - start) / 2.0
    flights: Columns = {
        "particle": particle,
        "start": start,
        "end": stop,
        "velocity": velocity,
        "y_start": low,
        "y_end": low + velocity * (stop - start) - gravity * (stop - start) ** 2 / 2.0,
        "cx": start + half,
        "cy": low + velocity * half,
    }
    begin = min(0.0, float(one["launch_time"].min()))
    moved = _base(one, base, begin, end)
    rise = np.clip(velocity / gravity, 0.0, stop - start)
    tops = low + rise * (velocity - gravity * rise / 2.0)
    levels = moved["height"]
    top, bottom = max(float(tops.max(initial=0.0)), float(levels.max())), float(levels.min())
    span = ((begin, end), (bottom, top if top > bottom else bottom + 1.0))
    return Heights(flights, _stays(one, base, end), moved, span)


def _stays(one: xr.Dataset, base: BaseMotion, end: float) -> Columns:
    landing = one["landing_time"].values
    leaves = np.fmin(one["liftoff_time"].values, end)  # NaN at permanent rest: until the end
    particle, impact = np.nonzero((one["rested"].values == 1) & (landing < end))
    start, length = landing[particle, impact], (leaves - landing)[particle, impact]
    pieces = np.ones(start.size, np.int64)
    if base.speed > 0.0:  # the stay follows the base and is drawn as finely
        wanted = np.ceil(SAMPLES * base.frequency * length)
        share = min(1.0, MOST_SAMPLES / max(wanted.sum(), 1.0))
        pieces = np.maximum(wanted * share, OF_STAY).astype(int)
    stay = np.repeat(np.arange(start.size), pieces)
    number = np.arange(stay.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    step = (length / pieces)[stay]
    begin = start[stay] + number * step
    return {
        "particle": particle[stay],
        "start": begin,
        "end": begin + step,
        "y_start": base.height(begin),
        "y_end": base.height(begin + step),
    }


def _base(one: xr.Dataset, base: BaseMotion, begin: float, end: float) -> Columns:
    if base.speed == 0.0:
        time = np.array([begin, end])
    else:
        count = int(min(SAMPLES * base.frequency * (end - begin), MOST_SAMPLES)) + 2
        time = np.linspace(begin, end, count)
        if recoils(one):  # the motion has a kink at each impact
            landing = one["landing_time"].values
            time = np.union1d(time, landing[np.isfinite(landing)])
    return {"time": time, "height": base.height(time)}
