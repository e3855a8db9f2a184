"""Heights of particles with the instants at which two of them are at one height."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.axes import Axes

from vibrosweep.figures import height_time, style

if TYPE_CHECKING:
    import xarray as xr


@style.styled
def heights_and_crossings(record: xr.Dataset, found: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw heights against time and a circle on every crossing that was found in a record."""
    axes = height_time(record, ax=ax)
    axes.plot(
        found["time"].values,
        found["height"].values,
        linestyle="none",
        marker="o",
        markersize=6.0,
        markerfacecolor="none",
        markeredgecolor="black",
        markeredgewidth=0.8,
        label="crossing",
        zorder=3,
    )
    style.head(axes, "", columns=5)
    return axes
