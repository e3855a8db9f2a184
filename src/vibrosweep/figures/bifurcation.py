"""Bifurcation diagram: an observable along the forcing, and the Lyapunov exponent under it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes

from vibrosweep.arrays import Array
from vibrosweep.figures import data, style
from vibrosweep.figures.canvas import Panels
from vibrosweep.model.measures import Regime

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["NEEDS", "bifurcation_diagram"]

NEEDS: Final = data.Needs(("direction", "lyapunov_largest", "regime"))
# Larger dots for the downward direction, under the upward ones, so that both stay visible
ORDER: Final = (("down", style.OKABE_ITO[1], 1.6), ("up", style.OKABE_ITO[0], 0.7))


@style.styled
def bifurcation_diagram(
    diagram: xr.Dataset, *, ax: Sequence[Axes] | Panels | None = None
) -> Panels:
    """Draw the impacts of all particles along the forcing, up and down, above their exponents.

    The axis is the forcing as given.  An orbit with rests has the exponent minus infinity,
    drawn at the lower edge.  The head of the figure states the share of unsettled orbits, whose
    impacts need not belong to an attractor.

    Parameters
    ----------
    diagram
        Result of `vibrosweep.bifurcation`.
    ax
        Two axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    numpy.ndarray of matplotlib.axes.Axes
        The axes of the impacts and of the exponents.

    Raises
    ------
    DataError
        The dataset lacks a variable.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import bifurcation_diagram
    >>> found = vs.bifurcation(amplitude=[0.6, 0.7, 0.8], samples=4, duration_periods=2000)
    >>> len(bifurcation_diagram(found))
    2
    """
    NEEDS.check("bifurcation_diagram", diagram)
    layout = {"sharex": True, "height_ratios": (2.0, 1.0)}
    upper, lower = panels = style.panels_on(ax, style.PAGE, 5.0, [[0], [1]], **layout)
    name, along = str(diagram.attrs["observable"]), str(diagram.attrs["forcing"])
    words = along.removeprefix("base_")
    for direction, colour, size in ORDER:
        values = diagram[name].sel(direction=direction)
        x, y = np.broadcast_arrays(
            diagram[along].values[:, np.newaxis], values.values.reshape(values.shape[0], -1)
        )
        upper.scatter(x, y, s=size, color=colour, linewidths=0.0, rasterized=True)
        upper.plot([], [], ".", color=colour, markersize=6.0, label=f"{words} {direction}")
    _exponents(lower, diagram, diagram[along].values)
    upper.set_ylabel(data.label(diagram, name))
    lower.set_xlabel(data.label(diagram, along))
    if upper.get_position().x0 != lower.get_position().x0:  # a user has put them side by side
        upper.set_xlabel(data.label(diagram, along))
    lower.set_ylabel("largest Lyapunov\nexponent per impact")
    drawn = {along, "amplitude", "base_acceleration"}
    head = data.conditions(diagram.drop_vars(drawn, errors="ignore"))
    unsettled = np.mean(diagram["regime"].values == Regime.UNSETTLED)
    style.head(upper, f"{head}, {unsettled:.2g} of the orbits unsettled" if unsettled else head)
    return panels


def _exponents(axes: Axes, diagram: xr.Dataset, x: Array) -> None:
    exponents = diagram["lyapunov_largest"]
    known = exponents.values[np.isfinite(exponents.values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (-1.0, 0.0)
    floor = low - 0.25 * max(high - low, 0.1)
    for direction, colour, size in ORDER:
        values = exponents.sel(direction=direction).values
        values = np.where(values == -np.inf, floor, values)
        for particle in range(values.shape[1]):
            axes.plot(x, values[:, particle], ".", color=colour, markersize=size + 0.8)
    axes.axhline(0.0, color=style.GREY, linewidth=0.7, zorder=0.5)
    axes.set_ylim(floor - 0.03 * (high - floor), max(high, 0.0) + 0.08 * (high - floor))
    if np.any(exponents.values == -np.inf):
        axes.text(0.005, 0.06, data.MINUS_INFINITY, transform=axes.transAxes, fontsize=7.5)
