"""Figures of a ball on a floor: restitution over speed, and flights with their residuals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from vibrosweep.figures import style
from vibrosweep.figures.canvas import Panels

if TYPE_CHECKING:
    import xarray as xr


@style.styled
def restitution_by_speed(found: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw each bounce with its error, and the restitution that all of them show."""
    axes = style.axes_on(ax, style.MEDIUM, 3.3)
    used = found["bounce_used"].values > 0
    speed, e = found["bounce_speed"].values, found["bounce_restitution"].values
    error = found["bounce_error"].values
    for chosen, color, name in (
        (used, style.OKABE_ITO[0], "bounce, error of the measurement"),
        (~used, style.GREY, "odd bounce, left out"),
    ):
        if chosen.any():
            axes.errorbar(
                *(speed[chosen], e[chosen], error[chosen]),
                linestyle="none",
                marker="o",
                markersize=3.0,
                elinewidth=0.7,
                color=color,
                label=name,
            )
    line = np.linspace(speed[used].min(), speed[used].max(), 50)
    slope = float(found["slope"]) if found.attrs["dependence"] != "constant" else 0.0
    middle = float(found["restitution"]) + slope * (line - float(found["speed"]))
    low, high = found["restitution_quantile"].values[[0, 3]] - float(found["restitution"])
    axes.fill_between(
        line, middle + low, middle + high, color=style.OKABE_ITO[1], alpha=0.3, label="95 %"
    )
    axes.plot(line, middle, color=style.OKABE_ITO[1], label="restitution")
    unit = "m/s" if found.attrs["speed_known"] else "relative"
    axes.set(xlabel=f"impact speed ({unit})", ylabel="restitution $e$")
    style.head(axes, "")
    return axes


@style.styled
def film_of_drop(found: xr.Dataset, *, ax: Sequence[Axes] | Panels | None = None) -> Panels:
    """Draw the heights of the first film in flight, and their residuals, on two axes."""
    panels = style.panels_on(ax, style.PAGE, 4.0, [[0], [1]], height_ratios=(2.0, 1.0))
    first = found["sample_drop"].values == found["sample_drop"].values.min()
    time = found["sample_time"].values[first]
    panels[0].plot(
        time,
        found["sample_height"].values[first],
        "o",
        markersize=2.2,
        color=style.OKABE_ITO[6],
        label="tracked position",
    )
    panels[0].plot(
        time,
        found["sample_fitted"].values[first],
        ".",
        markersize=1.5,
        color=style.OKABE_ITO[0],
        label="fitted flight",
    )
    panels[0].set(ylabel="height (unit of the file)")
    style.head(panels[0], str(found["drop"].values[found["sample_drop"].values.min()]))
    panels[1].plot(time, found["sample_residual"].values[first], ".", color=style.GREY)
    panels[1].axhline(0.0, color="black", linewidth=0.5)
    panels[1].set(xlabel="time $t$ (s)", ylabel="residual", xlim=panels[0].get_xlim())
    return panels
