"""What the pictures of a page show, in numbers.

Flights, stays and dots of a record; the elements that are visible in a window, without those that
others cover; many points gathered in pixels, and points that represent all of them; closed forms of
locked orbits over a plane in which one axis is the forcing.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, distance_transform_edt

from vibrosweep import analysis
from vibrosweep.analysis.records import BaseMotion, base_motion, course, recoils
from vibrosweep.arrays import Array
from vibrosweep.explorer.points import Points
from vibrosweep.figures.paint import Cells, commonest, grid_cells
from vibrosweep.figures.records import highest, parabolas
from vibrosweep.figures.windows import CURVE_SAMPLES, WindowEnd, window_ends
from vibrosweep.model.forcing import FORCINGS
from vibrosweep.model.shapes import SINE
from vibrosweep.theory import FIXED

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
    curves = parabolas(found, gravity)
    flights: Columns = {
        "particle": np.nonzero(found.flies)[0],
        "start": curves[:, 0, 0],
        "end": found.end[found.flies],
        "velocity": found.velocity[found.flies],
        "y_start": curves[:, 0, 1],
        "y_end": curves[:, 2, 1],
        "cx": curves[:, 1, 0],
        "cy": curves[:, 1, 1],
    }
    begin = min(0.0, float(one["launch_time"].min()))
    moved = _base(one, base, begin, end)
    levels = moved["height"]
    top, bottom = max(highest(found, gravity), float(levels.max())), float(levels.min())
    span = ((begin, end), (bottom, top if top > bottom else bottom + 1.0))
    return Heights(flights, _stays(one, base, end), moved, span)


def _stays(one: xr.Dataset, base: BaseMotion, end: float) -> Columns:
    landing = one["landing_time"].values
    leaves = np.fmin(one["liftoff_time"].values, end)  # NaN at rest for good: until the end
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


Rows = NDArray[np.int64]
LARGEST: Final = sys.float_info.max  # integers may be larger
BEYOND = 8  # pixels by which a line or a dot may reach into the window from outside
MOST = 1 << 20  # pixels that are distinguished along an axis


class Axis(NamedTuple):
    """An axis of a window: its two ends, its length in pixels, and whether it is logarithmic."""

    low: float
    high: float
    pixels: int
    log: bool = False

    def pixel(self, values: Array) -> Array:
        """Pixel of each value, counted from the low end; not finite where it has none."""
        low, high = self.low, self.high
        if self.log:
            with np.errstate(divide="ignore", invalid="ignore"):
                low, high, values = np.log(low), np.log(high), np.log(values)
        return np.asarray(np.floor((values - low) * (self.pixels / (high - low))))


def visible_rows(across: Sequence[Array], up: Array, x: Axis, y: Axis) -> Rows:
    """Row numbers of the elements that are visible in a window, in their order.

    Of several elements in the same pixels, the last one covers the others.  `across` holds the
    horizontal coordinate of each dot, or of the two ends of each line, the left one first; `up` is
    the vertical coordinate.
    """
    columns, row = [x.pixel(one) for one in across], y.pixel(up)
    within = (columns[-1] >= -BEYOND) & (columns[0] <= x.pixels + BEYOND) & np.isfinite(row)
    rows = np.flatnonzero(within)[::-1]  # `unique` keeps the first of equal keys: here the last row
    key = np.zeros(rows.size, np.int64)
    for pixel in (*columns, row):
        key = key * MOST + np.clip(pixel[rows] + MOST // 2, 0, MOST - 1).astype(np.int64)
    return np.sort(rows[np.unique(key, return_index=True)[1]])


def are_numbers(*values: object) -> bool:
    """Return whether all values are finite numbers."""
    return all(isinstance(value, int | float) and abs(value) <= LARGEST for value in values)


def is_window(x0: Any, x1: Any, y0: Any, y1: Any) -> bool:
    """Return whether these are the ends of a window: two of x and two of y."""
    return are_numbers(x0, x1, y0, y1) and 0 < abs(x1 - x0) < math.inf > abs(y1 - y0) > 0


# Least and most pixels on each side of a gap that is filled
GAPS: Final = (4, 40)
FIRST: Final = 1000  # number of first points that show whether all may form a grid


@dataclass(frozen=True)
class View:
    """A part of a plane, and its numbers of pixels."""

    x: tuple[float, float]
    y: tuple[float, float]
    columns: int
    rows: int


@dataclass(frozen=True)
class Raster:
    """Values of the pixels of a view."""

    # x, y: outer edges
    x: tuple[float, float]
    y: tuple[float, float]
    # Shape (row, column), the lowest y first.  Numbers: the mean of the finite ones; -inf where
    # there is none, but a -inf.  Codes: the commonest.  NaN where nothing is known
    values: Array


def raster(x: Array, y: Array, values: Array, view: View, codes: Array | None = None) -> Raster:
    """Gather points in the pixels of a view, or points of an even grid in the cells of the grid.

    `codes` lists the possible values if they are codes; it is None for numbers.
    """
    cells = even_cells(x, y)
    grid = cells is not None
    if cells is None:
        edges_x = np.linspace(*view.x, view.columns + 1)
        edges_y = np.linspace(*view.y, view.rows + 1)
        column = np.floor((x - view.x[0]) * (view.columns / (view.x[1] - view.x[0])))
        row = np.floor((y - view.y[0]) * (view.rows / (view.y[1] - view.y[0])))
        inside = (column >= 0) & (column < view.columns) & (row >= 0) & (row < view.rows)
        index = (row[inside] * view.columns + column[inside]).astype(np.int64)
        cells, values = Cells(edges_x, edges_y, index), values[inside]
    found = _mean(cells, values) if codes is None else commonest(cells, values, codes)
    if codes is not None:
        found = np.where(np.isnan(found), np.nan, codes[np.nan_to_num(found).astype(np.int64)])
    if not grid:
        found = _filled(found, np.bincount(cells.index, minlength=found.size))
    x_edges, y_edges = cells.x_edges, cells.y_edges
    return Raster(
        (float(x_edges[0]), float(x_edges[-1])), (float(y_edges[0]), float(y_edges[-1])), found
    )


def _filled(found: Array, counts: NDArray[np.int64]) -> Array:
    """Give pixels between points the value of the nearest pixel with points.

    Points that lie denser along one axis than along the other, as those of a grid over another
    forcing do, would otherwise leave stripes.  The wider apart the points, the wider the gaps that
    are filled.
    """
    empty = counts.reshape(found.shape) == 0
    if empty.all() or not empty.any():
        return found
    apart = int(np.clip(2.0 * np.sqrt(found.size / counts.sum()), *GAPS))
    near = distance_transform_edt(empty, return_distances=False, return_indices=True)
    around = np.pad(~empty, apart)  # closing would else end at the edges of the view
    within = binary_closing(around, np.ones((3, 3), np.bool_), apart)[apart:-apart, apart:-apart]
    return np.where(within, found[tuple(near)], found)


def even_cells(x: Array, y: Array) -> Cells | None:
    """Return the cells of an even grid of points; None for other points."""
    # a grid repeats the values along an axis; sorting a million values would take a second
    repeats = any(np.unique(v[:FIRST]).size < v[:FIRST].size for v in (x, y))
    cells = grid_cells(x, y) if repeats else None
    return cells if cells and _even(cells.x_edges) and _even(cells.y_edges) else None


def _mean(cells: Cells, values: Array) -> Array:
    size = int(np.prod(cells.shape))
    known = np.isfinite(values)
    infinite = np.bincount(cells.index[values == -np.inf], minlength=size)
    finite = np.bincount(cells.index[known], minlength=size)
    total = np.bincount(cells.index[known], values[known], minlength=size)
    found = np.divide(total, finite, out=np.full(size, np.nan), where=finite > 0)
    found[(infinite > 0) & (finite == 0)] = -np.inf
    return np.asarray(found.reshape(cells.shape))


def _even(edges: Array) -> bool:
    steps = np.diff(edges)
    return bool(np.ptp(steps) <= 1e-6 * steps.max())


def nearest(x: Array, y: Array, place: tuple[float, float], unit: tuple[float, float]) -> int:
    """Index of the finite point that is nearest to a place in the plane.

    `unit` holds the unit of distance along x and along y, such as the size of a pixel.
    """
    with np.errstate(over="ignore"):  # a distance that overflows is not the smallest
        distance = np.square((x - place[0]) / unit[0]) + np.square((y - place[1]) / unit[1])
    return int(np.argmin(np.where(np.isfinite(distance), distance, np.inf)))


FINEST = 32


def evenly(count: int, most: int) -> NDArray[np.int64]:
    """Indices of at most `most` of the points, evenly spaced in their order."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))


TRIED: Final = 16  # points of which one that moves is looked for


def moving_point(points: Points) -> int:
    """Index of a point near the middle of which particles do not come to rest for good.

    Of the points that are tried it is the first at which fewest do.
    """
    indices = [*islice(spread_out(*(points.columns[name].values for name in points.axes)), TRIED)]
    resting = []
    for index in indices:
        record = points.choice(index).shortened().simulate()
        lies = (record["rested"] == 1) & record["liftoff_time"].isnull()
        resting.append(float(lies.any("impact").mean()))
        if resting[-1] == 0.0:
            break
    return indices[int(np.argmin(resting))]


def spread_out(x: Array, y: Array) -> Iterator[int]:
    """Yield indices of points, first far apart, then closer and closer together.

    The plane is cut into 1, 4, 16, ... equal cells; each gives the point nearest to its middle.
    """
    known = np.isfinite(x) & np.isfinite(y)
    low = float(x[known].min()), float(y[known].min())
    width = float(np.ptp(x[known])) or 1.0, float(np.ptp(y[known])) or 1.0
    given: set[int] = set()
    cells = 1
    while cells <= FINEST:
        unit = width[0] / cells, width[1] / cells
        for row, column in np.ndindex(cells, cells):
            middle = low[0] + (column + 0.5) * unit[0], low[1] + (row + 0.5) * unit[1]
            found = nearest(x, y, middle, unit)
            if found not in given:
                given.add(found)
                yield found
        cells *= 2


# Parameters, apart from the forcing, on which the ends of a window depend
SOURCES: Final = ("restitution", "frequency", "gravity")


def curves_over(points: Points, axes: tuple[str, str]) -> tuple[list[WindowEnd], str]:
    """Curves A_min and A_max of the modes over a plane, converted to the forcing on its axis.

    Returns the curves that cross the range of the points, and the reason if there are none.
    """
    forcing = next((name for name in axes if name in FORCINGS), None)
    base = points.base_choice.scene.base
    if base not in FIXED:
        return [], "closed forms hold for a base without recoil"
    if points.base_choice.scene.waveform != SINE:
        return [], "closed forms of windows hold for a sinusoidal base"
    if forcing is None:
        return [], "closed forms are drawn where an axis is the forcing"
    other = axes[1 - axes.index(forcing)]
    along = _span(points.columns[other].values)
    known = []
    for name in SOURCES:
        value = along if name == other else _common(points, name)
        if value is None:
            return [], f"closed forms depend on {name}, which differs between the points"
        known.append(np.asarray(value))
    low, high = _range(points.columns[forcing].values)
    found = []
    e, frequency, gravity = known
    for mode, is_upper, end in window_ends(forcing, base, e, frequency, gravity):
        values = end * np.ones_like(along)
        if np.any((values > low) & (values < high)):
            pair = (along, values) if axes[1] == forcing else (values, along)
            found.append(WindowEnd(mode, is_upper, *pair))
    return found, "" if found else "no window of modes 1 to 3 ends in this range"


def _common(points: Points, name: str) -> float | None:
    """Value that all points share, or None."""
    if name not in points.columns:
        return points.base_choice.inputs.get(name)
    values = points.columns[name].values
    return float(values[0]) if np.ptp(values) == 0.0 else None


def _range(values: Array) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    return float(known.min()), float(known.max())


def _span(values: Array) -> Array:
    return np.linspace(*_range(values), CURVE_SAMPLES)
