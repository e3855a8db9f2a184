"""Errors of landing times of a fixed-step scheme."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from matplotlib.axes import Axes

from vibrosweep.figures import style

if TYPE_CHECKING:
    import xarray as xr


@style.styled
def errors_in_time(
    errors: Sequence[xr.DataArray], names: Sequence[str], *, ax: Axes | None = None
) -> Axes:
    """Draw absolute errors against the exact landing times, one colour for each step.

    Errors have the dims (particle, impact), in s, and a coordinate ``landing_time`` (s).
    """
    axes = style.axes_on(ax, style.MEDIUM, 3.0)
    for one, name, colour in zip(errors, names, style.colours(len(names)), strict=True):
        axes.plot(
            one["landing_time"].values.T.ravel(),
            one.values.T.ravel(),
            linestyle="none",
            marker="o",
            markersize=2.5,
            markeredgewidth=0.0,
            color=colour,
            label=name,
        )
    axes.set_yscale("log")
    axes.set_xlabel("landing time (s)")
    axes.set_ylabel("error of landing time (s)")
    style.head(axes, "time step")
    return axes
