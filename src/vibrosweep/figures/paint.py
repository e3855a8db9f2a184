"""Paint values or codes of realizations into a plane, as dots or as cells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import QuadMesh
from matplotlib.colorbar import Colorbar
from matplotlib.colors import Colormap, ListedColormap, LogNorm, Normalize, TwoSlopeNorm, to_rgba
from matplotlib.ticker import MaxNLocator
from matplotlib.typing import ColorType
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.figures import style

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["Cells", "between", "commonest", "equal_cells", "grid_cells", "median", "scale_ends"]

MOST_VALUES: Final = (0.01, 0.99)  # quantiles between which a scale of colours shows differences

APART: Final = ("0.72", "0.35")  # colours of values apart from the scale
PER_CELL: Final = 20
MOST_CELLS: Final = 200
ALONE: Final = 0.01  # half the width of the cell of a single value, relative to it unless it is 0


@dataclass(frozen=True)
class Places:
    """Realizations in the plane; ``cells`` is None if each of them is drawn as a dot."""

    x: Array
    y: Array
    cells: Cells | None

    @property
    def repeated(self) -> bool:
        """True if a cell holds more than one realization."""
        return self.cells is not None and self.x.size > int(np.prod(self.cells.shape))


def scatter_points(x: Array, y: Array) -> Places:
    """Place realizations: in the cells of their grid, in equal cells if many, else as dots."""
    cells = grid_cells(x, y)
    if cells is None and x.size > style.MANY:
        cells = equal_cells(x, y)
    return Places(x, y, cells)


def paint_numbers(
    axes: Axes,
    points: Places,
    values: Array,
    label: str,
    apart: Mapping[float, str],
    *,
    signed: bool,
    logarithmic: bool = False,
) -> Colorbar | None:
    """Paint numbers, one per realization, with a labelled colour bar; NaN means no value.

    `apart` names the values that have colours apart from the scale.  A scale of signed numbers is
    diverging, with zero in its middle; a logarithmic one is for numbers above zero.
    """
    drawn = values if points.cells is None else median(points.cells, values)
    for (value, name), colour in zip(apart.items(), APART, strict=False):
        _paint_one_colour(axes, points, drawn == value, colour, name, marker="x")
    _paint_nothing(axes, points, drawn)
    drawn = np.where(np.isin(drawn, list(apart)), np.nan, drawn)
    known = drawn[np.isfinite(drawn)]
    if not known.size:
        return None
    norm = _around_zero(known) if signed else _norm(known, logarithmic=logarithmic)
    colours = style.DIVERGING_MAP if signed else style.SEQUENTIAL_MAP
    mappable = _paint(axes, points, drawn, colormaps[colours], norm)
    # a scale of counts has ticks at whole numbers only
    counts = not logarithmic and bool(np.all(known == np.rint(known)))
    ticks = _ticks_around_zero(norm) if signed else None
    return style.bar(
        axes,
        mappable,
        f"{label}, cell median" if points.repeated else label,
        extend=_beyond(known, norm),
        ticks=MaxNLocator(integer=True, min_n_ticks=1) if counts and not signed else ticks,
    )


def paint_codes(
    axes: Axes, points: Places, values: Array, codes: Array, meanings: Sequence[str]
) -> None:
    """Paint every code in its colour, with a legend entry for each code that occurs."""
    colours = style.colours(len(codes))
    if points.cells is None:
        position = np.full(values.shape, np.nan)
        for i, code in enumerate(codes):
            position[values == code] = i
    else:
        position = commonest(points.cells, values, codes)
    for i, meaning in enumerate(meanings):
        _paint_one_colour(axes, points, position == i, colours[i], meaning.replace("_", " "))
    _paint_nothing(axes, points, position)


def paint_grid(axes: Axes, values: xr.DataArray, across: str, up: str, **look: Any) -> QuadMesh:
    """Paint the values at the points of two axes as cells around them; axes may be unsorted."""
    cells = values.sortby([across, up]).transpose(up, across)
    edges = (between(cells[name].values) for name in (across, up))
    return axes.pcolormesh(*edges, cells.values, rasterized=True, **look)


def _paint_nothing(axes: Axes, points: Places, drawn: Array) -> None:
    """Paint the places without a value."""
    nothing = "white" if points.cells is not None else "0.8"
    _paint_one_colour(axes, points, np.isnan(drawn), nothing, "no value", marker="+")


def _around_zero(known: Array) -> Normalize:
    """Scale with zero in its middle, over both signs even if only one occurs."""
    low, high = scale_ends(known)
    most = max(abs(low), abs(high)) or 1.0
    return TwoSlopeNorm(0.0, low if low < 0.0 else -most, high if high > 0.0 else most)


def _ticks_around_zero(norm: Normalize) -> Array:
    """Ticks of both halves, each of which has its own scale."""
    ends = float(norm.vmin or 0.0), float(norm.vmax or 0.0)
    halves = [MaxNLocator(4).tick_values(*sorted((0.0, end))) for end in ends]
    ticks = np.unique(np.concatenate(halves))
    return ticks[(ticks >= ends[0]) & (ticks <= ends[1])]


def _beyond(known: Array, norm: Normalize) -> Literal["neither", "min", "max", "both"]:
    """Ends of a scale beyond which there are values, as a colour bar names them."""
    below, above = bool(known.min() < norm.vmin), bool(known.max() > norm.vmax)
    if below and above:
        return "both"
    return "min" if below else "max" if above else "neither"


def _norm(known: Array, *, logarithmic: bool) -> Normalize:
    if logarithmic:
        low, high = float(known.min()), float(known.max())
        # a few almost coincident landings would stretch the scale to the limits of precision
        low = max(low, float(np.quantile(known, 0.01, method="lower")), 1e-6 * high)
        return LogNorm(low, high) if low < high else LogNorm(low / 2.0, low * 2.0)
    low, high = scale_ends(known)
    return Normalize(low, high) if low < high else Normalize(low - 0.5, low + 0.5)


def _paint(
    axes: Axes, points: Places, drawn: Array, cmap: Colormap, norm: Normalize, marker: str = "o"
) -> ScalarMappable:
    if points.cells is not None:
        return axes.pcolormesh(
            points.cells.x_edges,
            points.cells.y_edges,
            np.ma.masked_invalid(drawn),
            cmap=cmap,
            norm=norm,
            rasterized=True,
        )
    known = np.isfinite(drawn)
    return axes.scatter(
        points.x[known],
        points.y[known],
        # at this size dots of a random design touch but seldom overlap
        s=float(np.clip(6000.0 / points.x.size, 2.0, 22.0)),
        c=drawn[known],
        cmap=cmap,
        norm=norm,
        marker=marker,
        linewidths=0.0 if marker == "o" else 1.0,  # crosses consist of lines alone
        rasterized=points.x.size > 5000,
    )


def _paint_one_colour(
    axes: Axes,
    points: Places,
    chosen: np.ndarray[tuple[int, ...], np.dtype[np.bool_]],
    colour: ColorType,
    name: str,
    marker: str = "o",
) -> None:
    if not np.any(chosen):
        return
    shown = np.where(chosen, 0.0, np.nan)
    _paint(axes, points, shown, ListedColormap([to_rgba(colour)]), Normalize(-1, 1), marker)
    # a separate marker: a cell, or a dot of a large sweep, is too small to show its colour
    axes.plot(
        [],
        [],
        marker if points.cells is None else "s",
        markersize=5.0,
        color=colour,
        markeredgecolor="0.6" if colour == "white" else colour,
        label=name,
    )


@dataclass(frozen=True)
class Cells:
    """Cells of a plane; ``index`` is the cell of each point in row-major order, y first."""

    x_edges: Array
    y_edges: Array
    index: NDArray[np.int64]

    @property
    def shape(self) -> tuple[int, int]:
        """Rows (y) and columns (x)."""
        return self.y_edges.size - 1, self.x_edges.size - 1


def grid_cells(x: Array, y: Array) -> Cells | None:
    """Return the cells of a grid design, one around each of its points; None for other designs."""
    columns, column = np.unique(x, return_inverse=True)
    rows, row = np.unique(y, return_inverse=True)
    if min(columns.size, rows.size) < 2 or columns.size * rows.size > x.size:
        return None
    index = row * columns.size + column
    if np.unique(index).size != columns.size * rows.size:
        return None
    return Cells(between(columns), between(rows), index)


def equal_cells(x: Array, y: Array) -> Cells:
    """Return equal cells over the range of the points, about twenty points to a cell."""
    count = int(np.clip(np.sqrt(x.size / PER_CELL), 2, MOST_CELLS))
    x_edges = np.linspace(x.min(), x.max(), count + 1)
    y_edges = np.linspace(y.min(), y.max(), count + 1)
    column = np.clip(np.searchsorted(x_edges, x, side="right") - 1, 0, count - 1)
    row = np.clip(np.searchsorted(y_edges, y, side="right") - 1, 0, count - 1)
    return Cells(x_edges, y_edges, row * count + column)


def median(cells: Cells, values: Array) -> Array:
    """Lower median of the values in each cell, NaN where there are none.

    The lower median is always one of the values: zeros and infinities, which have a special
    meaning, are not averaged with other values.
    """
    known = ~np.isnan(values)
    index, kept = cells.index[known], values[known]
    order = np.lexsort((kept, index))
    count = np.bincount(index, minlength=int(np.prod(cells.shape)))
    middle = np.cumsum(count) - count + (np.maximum(count, 1) - 1) // 2
    result = np.full(count.size, np.nan)
    result[count > 0] = kept[order][middle[count > 0]]
    return result.reshape(cells.shape)


def commonest(cells: Cells, values: Array, codes: Array) -> Array:
    """Position in ``codes`` of the commonest code in each cell, NaN in empty cells."""
    of_code = [
        np.bincount(cells.index[values == code], minlength=int(np.prod(cells.shape)))
        for code in codes
    ]
    counts = np.stack(of_code)
    best = np.where(counts.sum(axis=0) > 0, counts.argmax(axis=0), np.nan)
    return np.asarray(best.reshape(cells.shape), dtype=np.float64)


def between(values: Array) -> Array:
    """Edges half-way between sorted values; the outer cells are symmetric about their values."""
    if values.size == 1:
        half = ALONE * (abs(float(values[0])) or 1.0)
        return np.array([values[0] - half, values[0] + half])
    middle = (values[1:] + values[:-1]) / 2.0
    first, last = values[0] - (middle[0] - values[0]), values[-1] + (values[-1] - middle[-1])
    return np.concatenate([[first], middle, [last]])


def scale_ends(values: Array) -> tuple[float, float]:
    """Return ends of a scale of colours that a few values far from the others do not spoil."""
    low, high = float(values.min()), float(values.max())
    least, most = (float(end) for end in np.quantile(values, MOST_VALUES))
    if most > least:  # the extreme values take no more of the scale than all others
        low = low if least - low <= most - least else least
        high = high if high - most <= most - least else most
    return low, high
