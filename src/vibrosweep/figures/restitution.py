"""Maximum rebound height against restitution, one point per realization of a sweep."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.colors import LogNorm

from vibrosweep import theory
from vibrosweep.analysis.datasets import completed
from vibrosweep.analysis.records import has_closed_forms, moves, recoils
from vibrosweep.arrays import Array
from vibrosweep.figures import data, style
from vibrosweep.store.rows import flat

if TYPE_CHECKING:
    import xarray as xr

NEEDS: Final = data.Needs(
    (
        "restitution",
        "amplitude",
        "frequency",
        "gravity",
        "launch_velocity",
        "rebound_height_max",
        "flight_height_max",
    ),
    varied=("restitution",),
)

CELLS: Final = 160
LARGEST_DOT: Final = 14.0
# Of two plateaus closer than this fraction of the axis only one is drawn
LABEL_GAP: Final = 0.06


@style.styled
def height_against_restitution(sweep: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw the maximum rebound height against restitution, with the closed-form plateaus.

    Filled dots are the maximum over rebounds.  Where the launch was higher than every rebound, an
    open circle shows the maximum that includes the launch.  The plateaus H_k = g k^2 / (8 f^2) are
    the heights of the locked orbits of mode k.  Over a moving base the apexes of stable locked
    orbits lie in the shaded band from H_k to H_k + (2 s_m / pi^2) H_1 (`vibrosweep.theory`); over a
    base of finite mass neither is drawn.  If frequency or gravity differ between realizations,
    heights have the unit H_1, and the plateaus lie at k^2.  More than 20,000 realizations are
    counted in cells, without circles.  Realizations that did not complete are left out, and the
    head of the figure says how many.

    Parameters
    ----------
    sweep
        Result of a sweep in which the restitution varies.  If the amplitude varies too, it
        colours the dots.
    ax
        Axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    DataError
        The dataset lacks a variable, or the restitution does not vary.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import height_against_restitution
    >>> sweep = vs.sweep(restitution=(0.8, 0.98), realizations=50)
    >>> height_against_restitution(sweep).get_xlabel()
    'restitution $e$'
    """
    sweep = flat(sweep)
    NEEDS.check("height_against_restitution", sweep)
    unit, one_height = _height_unit(sweep)
    restitution = data.quantity(sweep, "restitution")
    rebound = data.measured(sweep, "rebound_height_max") / unit
    flight = data.measured(sweep, "flight_height_max") / unit
    axes = style.axes_on(ax, style.MEDIUM, 3.3)
    heights = np.concatenate([rebound, flight])
    top = 1.06 * float(np.max(heights, where=np.isfinite(heights), initial=0.0)) or one_height
    # over a moving base a particle may stay below the mean level of the base
    lowest = 1.06 * float(np.min(heights, where=np.isfinite(heights), initial=0.0))
    axes.set(xlim=_span(restitution), ylim=(lowest - 0.02 * top, top))
    if restitution.size > style.MANY:
        _draw_density(axes, restitution, rebound)
    else:
        _draw_dots(axes, sweep, restitution, rebound)
        _draw_launches(axes, restitution, rebound, flight)
    if not moves(sweep):
        _draw_launch_height(axes, sweep, unit)
    elif has_closed_forms(sweep):
        _draw_bands(axes, one_height, top)
    if not recoils(sweep):
        _draw_plateaus(axes, one_height, top)
    in_metres = r"rebound height $H_{\mathrm{max}}$ (m)"
    in_units = r"rebound height $H_{\mathrm{max}} / H_1$, $H_1 = g / 8 f^2$"
    axes.set_xlabel(data.label(sweep, "restitution"))
    axes.set_ylabel(in_metres if unit.ndim == 0 else in_units)
    style.head(axes, _remark(sweep, rebound))
    legend = axes.get_legend()
    for handle in legend.legend_handles if legend else ():
        if isinstance(handle, PathCollection):  # dots of many realizations are too small to see
            handle.set_sizes([LARGEST_DOT])
    return axes


def plateaus(one_height: float, top: float) -> tuple[Array, Array]:
    """Return modes k and heights of the distinguishable plateaus below ``top``."""
    modes = np.arange(1, min(int(np.sqrt(top / one_height)), 1000) + 1, dtype=np.float64)
    heights = one_height * modes**2
    kept: list[int] = []
    for i, height in enumerate(heights):
        if height <= top and (not kept or height - heights[kept[-1]] >= LABEL_GAP * top):
            kept.append(i)
    return modes[kept], heights[kept]


def _height_unit(sweep: xr.Dataset) -> tuple[Array, float]:
    """Return the unit of height of each realization, and the height of mode 1 in that unit."""
    frequency, gravity = (data.quantity(sweep, name) for name in ("frequency", "gravity"))
    heights = theory.locked_height(1, frequency, gravity)
    if data.varies(sweep, "frequency") or data.varies(sweep, "gravity"):
        return heights, 1.0
    return np.ones(()), float(heights[0])


def _span(values: Array) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    margin = 0.03 * (high - low)
    return low - margin, high + margin


def _draw_dots(axes: Axes, sweep: xr.Dataset, restitution: Array, height: Array) -> None:
    """Draw a dot per realization, coloured by the forcing if that varies."""
    name = data.drawn_forcing(sweep)
    known = np.isfinite(height)  # the legend takes the colour of the first dot
    forcing = (data.quantity(sweep, name) if name else data.kick(sweep))[known]
    coloured = np.ptp(forcing) > 0.0 if forcing.size else False
    dots = axes.scatter(
        restitution[known],
        height[known],
        s=float(np.clip(4000.0 / restitution.size, 1.5, LARGEST_DOT)),
        c=forcing if coloured else style.OKABE_ITO[0],
        cmap=style.SEQUENTIAL_MAP if coloured else None,
        linewidths=0,
        rasterized=restitution.size > 5000,
        label="rebounds",
        zorder=2.5,
    )
    if coloured:
        words = data.label(sweep, name) if name else "kick $2 f A / g$"
        figure = axes.get_figure(root=True)
        engine = figure.get_layout_engine() if figure else None
        # some layout engines themselves place the bar beyond the names of the plateaus
        moved = engine is not None and not engine.colorbar_gridspec
        axes.figure.colorbar(dots, ax=axes, label=words, pad=0.02 if moved else 0.1, aspect=30)


def _draw_density(axes: Axes, restitution: Array, height: Array) -> None:
    known = np.isfinite(height)
    counts, x_edges, y_edges = np.histogram2d(
        restitution[known],
        height[known],
        bins=CELLS,
        range=(axes.get_xlim(), axes.get_ylim()),
    )
    mesh = axes.pcolormesh(
        x_edges,
        y_edges,
        np.ma.masked_equal(counts.T, 0.0),
        cmap=style.DENSITY_MAP,
        norm=LogNorm(1.0, max(counts.max(), 2.0)),
        rasterized=True,
    )
    axes.figure.colorbar(mesh, ax=axes, label="realizations per cell", pad=0.02, aspect=30)


def _draw_launches(axes: Axes, restitution: Array, rebound: Array, flight: Array) -> None:
    """Draw the maximum that includes the launch, where it differs from that of the rebounds."""
    differs = np.isfinite(flight) & ~(flight <= rebound)
    if np.any(differs):
        axes.scatter(
            restitution[differs],
            flight[differs],
            s=10.0,
            facecolors="none",
            edgecolors=style.GREY,
            linewidths=0.5,
            label="launch counted",
            zorder=2.2,
        )


def _draw_launch_height(axes: Axes, sweep: xr.Dataset, unit: Array) -> None:
    velocity, gravity = data.quantity(sweep, "launch_velocity"), data.quantity(sweep, "gravity")
    heights = np.unique(data.merged(velocity**2 / (2.0 * gravity * unit)))
    if heights.size == 1:
        axes.axhline(
            float(heights[0]),
            color=style.OKABE_ITO[1],
            linestyle=style.DASHED,
            linewidth=1.0,
            label="launch $v_0^2 / 2g$",
            zorder=2.3,
        )


def _draw_plateaus(axes: Axes, one_height: float, top: float) -> None:
    """Draw the heights of locked orbits as lines, named on the right-hand side."""
    modes, heights = plateaus(one_height, top)
    for height in heights:
        axes.axhline(float(height), color="black", alpha=0.45, linewidth=0.6, zorder=1.5)
    if modes.size:
        style.name_levels(axes, heights, [f"$H_{{{int(k)}}}$" for k in modes])


def _draw_bands(axes: Axes, one_height: float, top: float) -> None:
    """Shade the range of the apexes of stable locked orbits over a moving base."""
    e = np.linspace(max(axes.get_xlim()[0], 0.0), min(axes.get_xlim()[1], 1.0), 101)
    highest = theory.amplitude_max(1, e, 1.0, 2.0, base="moving")
    above = theory.locked_apex(1, e, highest, 1.0, 2.0) / theory.locked_height(1, 1.0, 2.0) - 1.0
    for height in plateaus(one_height, top)[1]:
        upper = height + above * one_height  # all bands are as wide as that of mode 1
        axes.fill_between(e, height, upper, color="0.9", linewidth=0.0, zorder=0.8)


def _remark(sweep: xr.Dataset, height: Array) -> str:
    unknown = int(np.count_nonzero(completed(sweep) & ~np.isfinite(height)))
    absent = f"no rebound in {unknown} of {height.size} realizations" if unknown else ""
    return data.joined(data.conditions(sweep), absent, data.incomplete(sweep, "realizations"))
