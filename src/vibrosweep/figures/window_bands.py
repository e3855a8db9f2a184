"""Computed stability windows, with the closed forms of locked orbits over them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, to_rgb
from matplotlib.typing import ColorType

from vibrosweep.analysis.records import base_name, has_closed_forms
from vibrosweep.arrays import Array
from vibrosweep.figures import data, style
from vibrosweep.figures.canvas import Panels
from vibrosweep.figures.cells import between
from vibrosweep.figures.window_curves import MODES, Forcing, draw_windows
from vibrosweep.model.forcing import FORCINGS
from vibrosweep.model.measures import UNDETERMINED

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["NEEDS", "stability_windows"]

NEEDS: Final = ("window_ends", "restitution", "scan", "frequency", "gravity")
PANEL_HEIGHT: Final = 3.2
LEGEND_LINE: Final = 0.18
NONE_FOUND: Final = ": no window found"
BAND: Final[Mapping[str, Any]] = {"linewidth": 0.0, "alpha": 0.45, "zorder": 1.0}


@style.styled
def stability_windows(
    windows: xr.Dataset, *, ax: Axes | Sequence[Axes] | Panels | None = None
) -> Panels:
    """Draw the intervals of the forcing in which conditions hold against restitution.

    All locked orbits share the first panel; every other condition has a panel.  Where orbits were
    continued along the forcing, both directions are drawn over each other, and a window that
    appears in only one of them is hysteretic.  A window may continue beyond a bar that reaches the
    end of the scan, or that ends at grey points, where the condition is undetermined.  Curves are
    the closed forms of locked orbits without reflection: the orbit exists above the solid curve and
    is stable up to the dashed one.

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
    needs = data.Needs((f"{symbol}_min", f"{symbol}_max", *NEEDS))
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
    shown = [(name, direction) for name in names for direction in directions]
    top = 0.0
    colours = style.colours(len(shown))
    for (name, direction), colour in zip(shown, colours, strict=True):
        chosen = windows.sel(condition=name, direction=direction)
        label = name.replace("_", " ") + ("" if len(directions) == 1 else f", {direction}")
        top = max(top, _bands(axes, chosen, scan, colour, label))
    _undetermined(axes, windows.sel(condition=names, direction=directions))
    if len(directions) == 2 and top > 0.0:
        axes.plot([], [], "s", color=_over(*colours), label="in both directions")
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


def _over(lower: ColorType, upper: ColorType) -> Array:
    """Colour of a band that is drawn over another one on white."""
    mixed = np.ones(3)
    for colour in (lower, upper):
        mixed += BAND["alpha"] * (np.array(to_rgb(colour)) - mixed)
    return mixed


def _bands(axes: Axes, chosen: xr.Dataset, scan: Array, colour: ColorType, label: str) -> float:
    """Draw a bar for each window, as wide as the distance between restitutions.

    A window that reaches an end of the scan is drawn up to it.  Returns the highest end, or 0.
    """
    edges = between(chosen["restitution"].values)
    exists = chosen["window_ends"].values >= 0
    symbol = FORCINGS[_scanned(chosen)].symbol
    lower, upper = (chosen[f"{symbol}_{end}"].values for end in ("min", "max"))
    lower = np.where(exists & np.isnan(lower), scan[0], lower)
    upper = np.where(exists & np.isnan(upper), scan[-1], upper)
    if not exists.any():
        label += NONE_FOUND
    for window, (low, high) in enumerate(zip(lower.T, upper.T, strict=True)):
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
    return float(np.max(upper, initial=0.0, where=exists))


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
