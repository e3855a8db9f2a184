"""Periodic orbits, stable and unstable: in the plane of states, along a parameter, over a plane."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes

from vibrosweep.analysis.orbits import cycle_name
from vibrosweep.arrays import Array
from vibrosweep.errors import DataError
from vibrosweep.figures import data, style
from vibrosweep.figures.basins import basins_of_attraction
from vibrosweep.figures.cells import between
from vibrosweep.figures.paint import paint_grid
from vibrosweep.model.parameters import OF_RESTITUTION

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["NEEDS", "periodic_orbits"]

NEEDS: Final = data.Needs(
    ("cycle_impacts", "cycle_periods", "stable", "admissible", "impact_phase", "rebound_velocity")
)
# Parameters that set the orbits and the basins alike
SHARED: Final = (
    "restitution",
    "amplitude",
    "frequency",
    "gravity",
    "contact_time",
    *OF_RESTITUTION,
)
ORBIT_DIMS: Final = frozenset(("orbit", "impact", "impacts", "periods", "multiplier"))


@style.styled
def periodic_orbits(
    orbits: xr.Dataset, *, basins: xr.Dataset | None = None, ax: Axes | None = None
) -> Axes:
    """Draw periodic orbits: filled where they are stable, hollow where they are not.

    For one realization the figure shows their impacts by phase and speed at lift-off; along one
    axis of a grid their speeds; over two axes the number of stable orbits.  Orbits that no
    particle can follow are left out.

    Parameters
    ----------
    orbits
        Result of `vibrosweep.orbits`.
    basins
        Result of `vibrosweep.basins` in the same scene with the same parameters, apart from the
        phase of the base; the impacts are drawn over it, each at the time of launch that has its
        phase.
    ax
        Axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    DataError
        The dataset lacks a variable, has other dims, or several points while basins are given, or
        contradicts the basins.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import periodic_orbits
    >>> found = vs.orbits(amplitude=1.2, impacts=2, periods=2)
    >>> periodic_orbits(found).get_xlabel()
    'phase of the impact, turns'
    """
    NEEDS.check("periodic_orbits", orbits)
    varied = [str(dim) for dim in orbits["stable"].dims if dim not in ORBIT_DIMS]
    if "realization" in varied or len(varied) > 2 or (varied and basins is not None):
        raise DataError(
            f"figure periodic_orbits draws one realization, or a grid of one or two axes; over "
            f"basins only one realization: choose with .isel() along {', '.join(varied)}"
        )
    if basins is not None:
        data.require_same_scene("periodic_orbits", orbits, basins, SHARED)
        axes = basins_of_attraction(basins, ax=ax)
        _draw_over(axes, orbits, _launch_times(orbits, basins))
        style.beside(axes, data.conditions(basins))
        return axes
    axes = style.axes_on(ax, style.PAGE, 3.6)
    if len(varied) == 2:
        _draw_numbers(axes, orbits, varied)
        style.head(axes, data.conditions(orbits))
    else:
        (along,) = varied or ("impact_phase",)
        _draw_points(axes, orbits, np.broadcast_to(*_aligned(orbits, along)))
        data.name_axes(axes, orbits, along, "rebound_velocity")
        style.beside(axes, data.conditions(orbits))
    return axes


def _aligned(orbits: xr.Dataset, along: str) -> tuple[Array, tuple[int, ...]]:
    values, shape = orbits[along].values, orbits["rebound_velocity"].shape
    return values.reshape(values.shape + (1,) * (len(shape) - values.ndim)), shape


def _launch_times(orbits: xr.Dataset, basins: xr.Dataset) -> Array:
    """Times at which the base has the phases of the impacts, in the period from the first cell."""
    first, frequency = between(np.sort(basins["launch_time"].values))[0], float(basins["frequency"])
    turns = orbits["impact_phase"].values - float(basins["phase"]) / (2.0 * np.pi)
    return np.asarray(first + np.mod(turns - frequency * first, 1.0) / frequency)


def _draw_over(axes: Axes, orbits: xr.Dataset, across: Array) -> None:
    """Draw all impacts of the admissible orbits, in black and white."""
    admissible = orbits["admissible"].values == 1
    stable, speed = orbits["stable"].values == 1, orbits["rebound_velocity"].values
    low, high = axes.get_ylim()
    for chosen, marker, size, face, edge, name in (
        (admissible & ~stable, "o", 3.0, "white", "black", "unstable orbit"),
        (admissible & stable, "D", 5.0, "black", "white", "stable orbit"),
    ):
        axes.plot(
            across[chosen].ravel(),
            speed[chosen].ravel(),
            marker,
            markersize=size,
            markerfacecolor=face,
            markeredgecolor=edge,
            markeredgewidth=0.7,
            zorder=3.0,
            label=name if chosen.any() else None,
        )
    axes.set_ylim(low, high)


def _draw_points(axes: Axes, orbits: xr.Dataset, across: Array) -> None:
    """Draw all impacts of the admissible orbits, in one colour for each (p, q)."""
    admissible = orbits["admissible"].values == 1
    stable, speed = orbits["stable"].values == 1, orbits["rebound_velocity"].values
    p, q = orbits["cycle_impacts"].values, orbits["cycle_periods"].values
    kinds = sorted({(int(a), int(b)) for a, b in zip(p[admissible], q[admissible], strict=True)})
    colours = style.colours(len(kinds))
    many = int(admissible.sum()) > style.MANY // 10
    size = 1.2 if many else 4.5
    for kind, colour in zip(kinds, colours, strict=True):
        of_kind = admissible & (p == kind[0]) & (q == kind[1])
        for chosen, filled in ((of_kind & ~stable, False), (of_kind & stable, True)):
            axes.plot(
                across[chosen].ravel(),
                speed[chosen].ravel(),
                "o",
                markersize=size,
                markeredgewidth=0.3 if many else 0.8,
                markeredgecolor=colour,
                markerfacecolor=colour if filled else "white",
                rasterized=many,
                zorder=3.0 + filled,
            )
        axes.plot([], [], "o", color=colour, markersize=4.5, label=cycle_name(*kind))
    for name, face in (("stable", "0.3"), ("unstable", "white")):
        axes.plot([], [], "o", markeredgecolor="0.3", markerfacecolor=face, label=name)


def _draw_numbers(axes: Axes, orbits: xr.Dataset, plane: list[str]) -> None:
    """Draw the number of stable admissible orbits at each point of a plane."""
    across, up = plane
    attracting = (orbits["stable"] == 1) & (orbits["admissible"] == 1)
    number = attracting.sum("orbit")
    most = max(1, int(number.max()))
    scale = {"vmin": -0.5, "vmax": most + 0.5}
    drawn = paint_grid(axes, number, across, up, cmap=style.SEQUENTIAL_MAP, **scale)
    data.name_axes(axes, orbits, across, up)
    axes.figure.colorbar(drawn, ax=axes, label="stable orbits")
