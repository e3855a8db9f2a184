"""Stability windows: computed ones as bands, closed forms of locked orbits as curves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.typing import ColorType

from vibrosweep import theory
from vibrosweep.analysis.records import base_name, has_closed_forms
from vibrosweep.arrays import Array
from vibrosweep.figures import data, style
from vibrosweep.figures.paint import between
from vibrosweep.figures.style import Panels
from vibrosweep.model.forcing import FORCINGS
from vibrosweep.model.measures import UNDETERMINED
from vibrosweep.model.orbit_theory import lower_end

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["CURVE_SAMPLES", "WindowEnd", "name_places", "window_ends"]

Interval = tuple[int, float, float]  # position of a restitution, lower and upper end

WINDOW_NEEDS: Final = ("window_ends", "restitution", "scan", "frequency", "gravity")
PANEL_HEIGHT: Final = 3.2
LEGEND_LINE: Final = 0.18
NONE_FOUND: Final = ": no window found"
# Of windows in both directions, and in one of them only
OF_DIRECTIONS: Final = (style.OKABE_ITO[2], style.OKABE_ITO[5], style.OKABE_ITO[4])
TINT: Final = 0.2  # opacity of the windows of locked orbits, which overlap
MODES: Final = (1, 2, 3)
CURVE_SAMPLES: Final = 201
# Where a lower and an upper end is named at best, as a share of its visible part: the lower ends
# meet at e = 1, the upper ones at both sides
NAMED_AT: Final = (0.45, 0.25)
PLACES: Final = np.linspace(0.08, 0.92, 29)  # where else, as such shares
# Inches between the middle of a name and the other names, and other curves, if possible
FROM_NAMES, FROM_CURVES = 0.5, 0.15
SHORTEST: Final = CURVE_SAMPLES // 20  # visible part that has room for a name


@style.styled
def stability_windows(
    windows: xr.Dataset, *, ax: Axes | Sequence[Axes] | Panels | None = None
) -> Panels:
    """Draw the intervals of the forcing in which conditions hold against restitution.

    All locked orbits share the first panel, with curves through the ends of their windows; every
    other condition has a panel, with a bar for each window.  Where orbits were continued along the
    forcing, colours tell windows in both directions from those in one, which are hysteretic.  A
    window may continue beyond the end of the scan, or beyond grey points, where the condition is
    undetermined.  Black curves are the closed forms of locked orbits without reflection: the orbit
    exists above the solid curve and is stable up to the dashed one.

    Parameters
    ----------
    windows
        Result of `vibrosweep.windows`.
    ax
        Axes to draw on, one for each panel; by default those of a new figure of pyplot.

    Returns
    -------
    numpy.ndarray of matplotlib.axes.Axes
        The axes, shape (panel,).

    Raises
    ------
    DataError
        The dataset lacks a variable.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import stability_windows
    >>> found = vs.windows(restitution=[0.8, 0.9], amplitude=[0.1, 1.0, 2.0, 4.0])
    >>> stability_windows(found)[0].get_xlabel()
    'restitution $e$'
    """
    symbol = FORCINGS[_scanned(windows)].symbol
    needs = data.Requirements((f"{symbol}_min", f"{symbol}_max", *WINDOW_NEEDS))
    needs.check("stability_windows", windows)
    windows = windows.sortby("restitution")
    names = [str(name) for name in windows["condition"].values]
    locked = [name for name in names if name.startswith("locked(")]
    panels = ([locked] if locked else []) + [[name] for name in names if name not in locked]
    height = PANEL_HEIGHT * len(panels) + LEGEND_LINE * max(0, len(locked) - 4)
    rows = [[i] for i in range(len(panels))]
    all_axes = style.panels_on(ax, style.MEDIUM, height, rows, sharex=True)
    for axes, panel in zip(all_axes, panels, strict=True):
        _panel(axes, windows, panel, is_locked=panel is locked)
    for axes in all_axes if ax is not None else all_axes[-1:]:  # a user's axes may be side by side
        axes.set_xlabel("restitution $e$")
    return all_axes


def _panel(axes: Axes, windows: xr.Dataset, names: list[str], *, is_locked: bool) -> None:
    e, scan = windows["restitution"].values, windows["scan"].values
    axes.set_xlim(*between(e)[[0, -1]])
    # existence and stability of a locked orbit do not depend on the direction
    directions = windows["direction"].values[: 1 if is_locked else None]
    of_names = [_intervals(windows.sel(condition=n, direction=directions[0])) for n in names]
    labels = [name.replace("_", " ") for name in names]
    if len(directions) == 2:
        other = _intervals(windows.sel(condition=names[0], direction=directions[1]))
        _draw_directions(axes, e, of_names[0], other, labels[0], [str(d) for d in directions])
        of_names.append(other)
    else:
        draw = _draw_ends if is_locked else _draw_bars
        for one, label, colour in zip(of_names, labels, style.colours(len(names)), strict=True):
            draw(axes, e, one, colour, label)
    top = max((high for one in of_names for _, _, high in one), default=0.0)
    _undetermined(axes, windows.sel(condition=names, direction=directions))
    axes.set_ylim(scan[0], min(scan[-1], 1.05 * top) if is_locked and top > 0.0 else scan[-1])
    name = _scanned(windows)
    axes.set_ylabel(data.label(windows, name))
    modes = [int(name[len("locked(") : -1]) for name in names] if is_locked else MODES
    scene = base_name(windows), float(windows["frequency"]), float(windows["gravity"])
    forcing = Forcing(data.SYMBOLS[name], *scene, name)
    if has_closed_forms(windows):
        draw_windows(axes, forcing, over=True, modes=modes)
    # labels with `NONE_FOUND` or a direction are long: only two fit in a row
    lacking = any(text.endswith(NONE_FOUND) for text in axes.get_legend_handles_labels()[1])
    turned = is_locked and windows.attrs.get("rebound") == "reflect"
    remark = "; curves: orbits without reflection" if turned else ""
    few = lacking or len(directions) == 2
    style.head(axes, data.conditions(windows) + remark, columns=2 if few else 4)


def _intervals(chosen: xr.Dataset) -> list[Interval]:
    """Windows of one condition in one direction; one that reaches an end of the scan ends there."""
    scan, symbol = chosen["scan"].values, FORCINGS[_scanned(chosen)].symbol
    exists = chosen["window_ends"].values >= 0
    lower, upper = (chosen[f"{symbol}_{end}"].values for end in ("min", "max"))
    lower = np.where(np.isnan(lower), scan[0], lower)
    upper = np.where(np.isnan(upper), scan[-1], upper)
    return [
        (int(i), float(lower[i, k]), float(upper[i, k]))
        for i, k in zip(*np.nonzero(exists), strict=True)
    ]


def _draw_bars(
    axes: Axes, e: Array, found: Sequence[Interval], colour: ColorType, label: str
) -> None:
    """Draw a bar for each interval, as wide as the cell of its restitution."""
    edges = between(e)
    if not found:
        axes.plot([], [], "s", color=colour, label=label + NONE_FOUND)
        return
    at, low, high = (np.array(numbers) for numbers in zip(*found, strict=True))
    axes.bar(
        edges[at],
        high - low,
        width=np.diff(edges)[at],
        bottom=low,
        align="edge",
        color=colour,
        linewidth=0.0,
        label=label,
        zorder=1.0,
    )


def _draw_ends(
    axes: Axes, e: Array, found: Sequence[Interval], colour: ColorType, label: str
) -> None:
    """Draw curves through both ends of the windows of an orbit, and what lies between them."""
    counts: dict[int, int] = {}
    ends = np.full((2, e.size, len(found)), np.nan)
    for at, *pair in found:
        ends[:, at, counts.get(at, 0)] = pair
        counts[at] = counts.get(at, 0) + 1
    for k in range(max(counts.values(), default=0)):
        low, high = ends[:, :, k]
        axes.fill_between(e, low, high, color=colour, alpha=TINT, linewidth=0.0, zorder=1.0)
        for end in low, high:  # dots show a window that stands alone
            axes.plot(e, end, ".-", color=colour, linewidth=1.2, markersize=2.0, zorder=1.5)
    axes.plot([], [], "s", color=colour, label=label if found else label + NONE_FOUND)


def _draw_directions(
    axes: Axes,
    e: Array,
    one: Sequence[Interval],
    other: Sequence[Interval],
    label: str,
    directions: Sequence[str],
) -> None:
    """Draw where windows of two directions overlap, and where there is one of them only."""
    parts: dict[tuple[bool, bool], list[Interval]] = {}
    for i in range(e.size):
        here = [[(low, high) for j, low, high in some if j == i] for some in (one, other)]
        for low, high in pairwise(sorted({end for some in here for pair in some for end in pair})):
            middle = (low + high) / 2.0
            inside = [any(a < middle < b for a, b in some) for some in here]
            parts.setdefault((inside[0], inside[1]), []).append((i, low, high))
    first, second = directions
    names = {
        (True, True): f"{label}, both ways",
        (True, False): f"{label}, {first} only",
        (False, True): f"{label}, {second} only",
    }
    for (where, name), colour in zip(names.items(), OF_DIRECTIONS, strict=True):
        if where in parts:
            _draw_bars(axes, e, parts[where], colour, name)
    if not one and not other:
        _draw_bars(axes, e, [], OF_DIRECTIONS[0], label)


def _undetermined(axes: Axes, chosen: xr.Dataset) -> None:
    """Draw grey cells around points of the scan at which some condition is undetermined.

    Results of earlier versions lack ``holds``, and so these points.
    """
    if "holds" not in chosen:
        return
    undetermined = (chosen["holds"] == UNDETERMINED).any(("condition", "direction"))
    unknown = undetermined.transpose("scan", "restitution").values
    if not unknown.any():
        return
    axes.pcolormesh(
        between(chosen["restitution"].values),
        between(chosen["scan"].values),
        np.ma.masked_array(unknown, ~unknown),
        cmap=ListedColormap([style.GREY]),
        alpha=0.3,
        linewidth=0.0,
        zorder=0.5,
        rasterized=True,
    )
    axes.plot([], [], "s", color=style.GREY, alpha=0.3, label="undetermined")


def _scanned(windows: xr.Dataset) -> str:
    """Name of the scanned forcing."""
    return str(windows.attrs.get("forcing", "amplitude"))


@dataclass(frozen=True)
class Forcing:
    """Form in which the forcing is drawn."""

    symbol: str  # in mathtext, without dollar signs
    base: str  # one of `vibrosweep.model.parameters.BASES`
    # frequency, gravity: Hz and m s-2; with the defaults an amplitude is the dimensionless kick
    frequency: float = 1.0
    gravity: float = 2.0
    name: str = "amplitude"  # name of the forcing, one of `vibrosweep.model.forcing.FORCINGS`


class WindowEnd(NamedTuple):
    """An end of the window of mode k: where its orbit begins to exist, or to be unstable."""

    mode: int
    is_upper: bool
    # the coordinates; one is the forcing
    x: Array
    y: Array


def window_ends(
    name: str,
    base: str,
    e: Array,
    frequency: float | Array,
    gravity: float | Array,
    modes: Sequence[int] = MODES,
) -> Iterator[tuple[int, bool, Array]]:
    """Yield the mode of each end of a window, whether it is the upper one, and its forcing."""
    scale = per_amplitude(name, e, frequency, gravity)
    for is_upper, end in (False, lower_end), (True, theory.amplitude_max):
        for mode in modes:
            yield mode, is_upper, end(mode, e, frequency, gravity, base) * scale


def window_curves(
    x_range: tuple[float, float],
    y_range: tuple[float, float],
    forcing: Forcing,
    modes: Sequence[int] = MODES,
) -> list[WindowEnd]:
    """Return the ends of the windows of the modes that cross the view.

    The view is a range of the restitution and one of the forcing.
    """
    e = np.linspace(max(x_range[0], 0.0), min(x_range[1], 1.0), CURVE_SAMPLES)
    given = forcing.name, forcing.base, e, forcing.frequency, forcing.gravity
    ends = (WindowEnd(k, is_upper, e, y) for k, is_upper, y in window_ends(*given, modes))
    low, high = y_range
    return [end for end in ends if np.any((end.y > low) & (end.y < high))]


def per_amplitude(name: str, e: Array, frequency: float | Array, gravity: float | Array) -> Array:
    """Return the ratio of a forcing to its amplitude A = (1 + e) V0."""
    if name == "amplitude":
        return np.ones_like(e)
    omega = 2.0 * np.pi * frequency
    units = {
        "base_velocity": 1.0,
        "base_displacement": 1.0 / omega,
        "base_acceleration": omega / gravity,
    }
    return np.asarray(units[name] / (1.0 + e))


def draw_windows(axes: Axes, forcing: Forcing, *, over: bool, modes: Sequence[int] = MODES) -> None:
    """Draw the ends of the windows into the present view and name each on its curve.

    With `over` the curves are drawn over cells, with a halo; otherwise they lie under the dots, and
    only their names lie over them.
    """
    curves = window_curves(axes.get_xlim(), axes.get_ylim(), forcing, modes)
    for curve in curves:
        axes.plot(
            curve.x,
            curve.y,
            color="black",
            linewidth=1.0,
            linestyle=(0, (4, 1.5)) if curve.is_upper else "-",
            path_effects=style.halo() if over else None,
            zorder=3.0 if over else 0.9,
        )
    across, up = axes.get_xlim(), axes.get_ylim()
    for curve, at in name_places(curves, across, up, style.room(axes)):
        end = r"\mathrm{max}" if curve.is_upper else r"\mathrm{min}"
        axes.text(
            curve.x[at],
            curve.y[at],
            rf"${{{forcing.symbol}}}_{{{end}}}({curve.mode})$",
            rotation=_slope(curve, at),
            rotation_mode="anchor",
            transform_rotates_text=True,
            ha="center",
            va="center",
            fontsize=7.5,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 0.4},
            zorder=4.0,
            clip_on=True,
        )


def name_places(
    curves: Sequence[WindowEnd],
    across: tuple[float, float],
    up: tuple[float, float],
    inches: Sequence[float],
) -> Iterator[tuple[WindowEnd, int]]:
    """Yield the curves that have room for a name, each with the sample at which it stands.

    The view has the ranges `across` and `up`, and a width and height in inches.  Names stand apart
    from each other and from other curves, if possible.
    """
    low, size = np.array([across, up]).T[0], np.ptp([across, up], axis=1)
    points = [(np.stack([c.x, c.y], axis=1) - low) / size * inches for c in curves]
    names = np.full((1, 2), np.inf)
    for i, curve in enumerate(curves):
        inside = (curve.x >= across[0]) & (curve.x <= across[1])
        seen = np.flatnonzero(inside & (curve.y > up[0]) & (curve.y < up[1]))
        if seen.size < SHORTEST:
            continue
        near = sorted(PLACES, key=lambda part: abs(part - NAMED_AT[curve.is_upper]))
        places = np.clip(seen[(np.array(near) * seen.size).astype(int)], 1, len(curve.x) - 2)
        others = np.concatenate([*points[:i], *points[i + 1 :], np.full((1, 2), np.inf)])
        free = sum(
            np.minimum(np.hypot(*(points[i][places, np.newaxis] - taken).T).min(axis=0), enough)
            for taken, enough in ((names, FROM_NAMES), (others, FROM_CURVES))
        )
        at = int(places[np.argmax(free)])
        names = np.concatenate([names, points[i][[at]]])
        yield curve, at


def _slope(curve: WindowEnd, at: int) -> float:
    """Angle of a curve in degrees of data space; the text turns with the scale of the axes."""
    run = curve.x[at + 1] - curve.x[at - 1]
    return float(np.degrees(np.arctan2(curve.y[at + 1] - curve.y[at - 1], run)))
