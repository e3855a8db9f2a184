"""Basins of attraction: launches coloured by the attractor that they lead to."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap

from vibrosweep.analysis.basins import name_of
from vibrosweep.figures import data, style

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["NEEDS", "basins_of_attraction"]

NEEDS: Final = data.Needs(("basin", "fraction", "regime", "cycle_impacts", "cycle_periods"))
NAMED: Final = len(style.OKABE_ITO) + 1  # attractors that the legend names one by one


@style.styled
def basins_of_attraction(basins: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw the attractor that each launch leads to, with the fraction of launches in each basin.

    Parameters
    ----------
    basins
        Result of `vibrosweep.basins` with at least two launch times and two launch speeds.
    ax
        Axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    DataError
        The dataset lacks a variable.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import basins_of_attraction
    >>> found = vs.basins(launch_velocity=[3.0, 4.0, 5.0], particles=20, duration=2000.0)
    >>> basins_of_attraction(found).get_xlabel()
    'time of launch (s)'
    """
    NEEDS.check("basins_of_attraction", basins)
    axes = style.axes_on(ax, style.PAGE, 3.6)
    count = basins.sizes["attractor"]
    shown = min(count, NAMED)
    colours = [*style.OKABE_ITO, "0.75"][:shown]
    axes.pcolormesh(
        basins["launch_time"].values,
        basins["launch_velocity"].values,
        np.minimum(basins["basin"].values, NAMED - 1),
        cmap=ListedColormap(colours),
        vmin=-0.5,
        vmax=shown - 0.5,
        rasterized=True,
    )
    for i in range(shown):
        rest = i == NAMED - 1 and count > NAMED
        fraction = basins["fraction"].values[i:].sum() if rest else basins["fraction"].values[i]
        name = f"{count - i} others" if rest else name_of(basins.isel(attractor=i))
        label = f"{name}, {100.0 * float(fraction):.3g} %"
        axes.plot([], [], "s", color=colours[i], label=label, markersize=5.0)
    axes.set_xlabel(data.label(basins, "launch_time"))
    axes.set_ylabel(data.label(basins, "launch_velocity"))
    style.beside(axes, data.conditions(basins))
    return axes
