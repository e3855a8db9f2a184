"""Stability windows as they were computed, with the closed forms of locked orbits over them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vibrosweep.figures import data, style
from vibrosweep.figures.data import Array
from vibrosweep.figures.windows import MODES, draw_windows

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["NEEDS", "stability_windows"]

NEEDS: Final = data.Needs(("A_min", "A_max", "restitution", "frequency", "gravity"))
PANEL_HEIGHT: Final = 3.2
BAND: Final[Mapping[str, Any]] = {"linewidth": 0.0, "alpha": 0.45, "zorder": 1.0}


@style.styled
def stability_windows(windows: xr.Dataset) -> Figure:
    """Draw the intervals of amplitude in which conditions hold against restitution.

    All locked orbits share the first panel, every other condition has its own.  Where orbits were
    continued along the amplitude, both directions are drawn over each other: where only one of
    them is seen, the window is hysteretic.  Curves are the closed forms of locked orbits: solid
    from where they exist, dashed up to where they are stable.

    Parameters
    ----------
    windows
        Result of `vibrosweep.analysis.windows.find_windows`.

    Raises
    ------
    DataError
        The dataset lacks a variable.
    """
    NEEDS.check("stability_windows", windows)
    names = [str(name) for name in windows["condition"].values]
    locked = [name for name in names if name.startswith("locked(")]
    panels = ([locked] if locked else []) + [[name] for name in names if name not in locked]
    figure = Figure(figsize=(style.MEDIUM, PANEL_HEIGHT * len(panels)), layout="constrained")
    all_axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, panel in zip(all_axes, panels, strict=True):
        _panel(axes, windows, panel, is_locked=panel is locked)
    all_axes[-1].set_xlabel("coefficient of restitution $e$")
    return figure


def _panel(axes: Axes, windows: xr.Dataset, names: list[str], *, is_locked: bool) -> None:
    e = windows["restitution"].values
    scan = windows["scan"].values
    axes.set_xlim(*_edges(e)[[0, -1]])
    colour = iter(style.OKABE_ITO)
    top = float(scan[0])
    for name in names:
        # whether a locked orbit exists and attracts does not depend on the direction
        directions = windows["direction"].values[: 1 if is_locked else None]
        for direction in directions:
            chosen = windows.sel(condition=name, direction=direction)
            label = name.replace("_", " ") + ("" if len(directions) == 1 else f", {direction}")
            _bands(axes, chosen, next(colour), label)
            top = float(np.nanmax([top, *chosen["A_max"].values.ravel()]))
    axes.set_ylim(float(scan[0]), min(float(scan[-1]), 1.05 * top) if is_locked else scan[-1])
    axes.set_ylabel("amplitude of the kick $A$ (m s$^{-1}$)")
    modes = [int(name[len("locked(") : -1]) for name in names] if is_locked else MODES
    forcing = float(windows["frequency"]), float(windows["gravity"])
    draw_windows(axes, *forcing, "A", over=True, modes=modes)
    style.head(axes, _conditions(windows))


def _bands(axes: Axes, chosen: xr.Dataset, colour: str, label: str) -> None:
    """Bars from end to end of each window, as wide as the restitutions are apart."""
    edges = _edges(chosen["restitution"].values)
    for window in range(chosen.sizes["window"]):
        low, high = (chosen[name].isel(window=window).values for name in ("A_min", "A_max"))
        axes.bar(
            edges[:-1],
            high - low,
            width=np.diff(edges),
            bottom=low,
            align="edge",
            color=colour,
            label=label if window == 0 else None,
            **BAND,
        )


def _edges(e: Array) -> Array:
    """Edges half-way between sorted values."""
    if e.size == 1:
        return np.array([e[0] - 0.01, e[0] + 0.01])
    middle = (e[1:] + e[:-1]) / 2.0
    return np.concatenate([[2.0 * e[0] - middle[0]], middle, [2.0 * e[-1] - middle[-1]]])


def _conditions(windows: xr.Dataset) -> str:
    """Return frequency and rebound law in a line."""
    law = ", reflect law" if windows.attrs.get("rebound") == "reflect" else ""
    return f"$f$ = {float(windows['frequency']):.4g} Hz{law}"
