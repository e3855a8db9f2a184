"""Basins of attraction: launches coloured by the attractor that they lead to."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap

from vibrosweep.analysis.basins import UNSETTLED, name_of
from vibrosweep.arrays import Array
from vibrosweep.errors import DataError
from vibrosweep.figures import data, style
from vibrosweep.figures.cells import between
from vibrosweep.figures.paint import paint_grid

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["NEEDS", "basin_shares", "basins_of_attraction"]

NEEDS: Final = data.Needs(("basin", "fraction", "regime", "cycle_impacts", "cycle_periods"))
COLOURS: Final = (*style.OKABE_ITO, "0.75")
NAMED: Final = len(COLOURS)  # attractors that the legend names one by one


@style.styled
def basins_of_attraction(basins: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw the attractor that each launch leads to, with the fraction of launches in each basin.

    Parameters
    ----------
    basins
        Result of `vibrosweep.basins`.
    ax
        Axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    DataError
        The dataset lacks a variable, or holds basins along a parameter.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import basins_of_attraction
    >>> found = vs.basins(launch_velocity=[3.0, 4.0, 5.0], particles=20, duration=2000.0)
    >>> basins_of_attraction(found).get_xlabel()
    'time of launch (s)'
    """
    NEEDS.check("basins_of_attraction", basins)
    if "along" in basins.attrs:
        along = basins.attrs["along"]
        raise DataError(
            f"figure basins_of_attraction draws basins at one value of {along}: compute them with "
            f"a single value, or draw basin_shares"
        )
    axes = style.axes_on(ax, style.PAGE, 3.6)
    names, shares = _named(basins)
    reached = basins["basin"].values
    unsettled = float((reached == UNSETTLED).mean())
    drawn = basins["basin"].clip(max=NAMED - 1)
    colours = ListedColormap(["white", *COLOURS])
    scale = {"vmin": UNSETTLED - 0.5, "vmax": NAMED - 0.5}
    paint_grid(axes, drawn, "launch_time", "launch_velocity", cmap=colours, **scale)
    for name, share, colour in zip(names, shares, COLOURS, strict=False):
        label = f"{name}, {100.0 * float(share):.3g} %"
        axes.plot([], [], "s", color=colour, label=label, markersize=5.0)
    if unsettled > 0.0:
        label = f"unsettled, {100.0 * unsettled:.3g} %"
        axes.plot([], [], "s", color="white", markeredgecolor="0.5", label=label, markersize=5.0)
    data.name_axes(axes, basins, "launch_time", "launch_velocity")
    style.beside(axes, data.conditions(basins))
    return axes


@style.styled
def basin_shares(basins: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw the share of the launches that leads to each attractor, along a parameter.

    Shares are stacked; the white remainder up to 1 is the share of unsettled launches.

    Parameters
    ----------
    basins
        Result of `vibrosweep.basins` along a parameter.
    ax
        Axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    DataError
        The dataset lacks a variable, or holds basins at one value only.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import basin_shares
    >>> found = vs.basins(amplitude=[0.6, 1.2], launch_velocity=[3.0, 5.0], duration=2000.0)
    >>> basin_shares(found).get_xlabel()
    'amplitude of the kick $A$ (m s$^{-1}$)'
    """
    NEEDS.check("basin_shares", basins)
    if "along" not in basins.attrs:
        raise DataError(
            "figure basin_shares draws basins along a parameter: compute them with a list of "
            "amplitudes or restitutions beside launch_velocity"
        )
    along = str(basins.attrs["along"])
    axes = style.axes_on(ax, style.PAGE, 3.6)
    basins = basins.sortby(along)
    names, shares = _named(basins)
    values = basins[along].values
    if values.size == 1:
        values, shares = between(values), np.repeat(shares, 2, axis=1)
    axes.stackplot(values, shares, colors=COLOURS[: len(names)], labels=names, linewidth=0.0)
    if (basins["basin"].values == UNSETTLED).any():
        axes.plot([], [], "s", color="white", markeredgecolor="0.5", label="unsettled")
    axes.set(xlim=(values[0], values[-1]), ylim=(0.0, 1.0), ylabel="share of the launches")
    axes.set_xlabel(data.label(basins, along))
    style.beside(axes, data.conditions(basins))
    return axes


def _named(basins: xr.Dataset) -> tuple[list[str], Array]:
    """Names of attractors and their fractions, shape (name, ...); the rarest share one name."""
    fraction = basins["fraction"].transpose("attractor", ...).values
    names = [name_of(basins.isel(attractor=i)) for i in range(fraction.shape[0])]
    if len(names) <= NAMED:
        return names, fraction
    kept = NAMED - 1
    shares = np.concatenate([fraction[:kept], fraction[kept:].sum(axis=0, keepdims=True)])
    return [*names[:kept], f"{len(names) - kept} others"], shares
