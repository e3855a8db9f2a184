"""Smallest separations in units of what independent landings give."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from vibrosweep.figures import style

if TYPE_CHECKING:
    import xarray as xr


@style.styled
def distributions_of_z(found: Mapping[str, xr.Dataset], *, ax: Axes | None = None) -> Axes:
    """Draw distributions of z = Lambda dt_min and that of chance, by the names of the samples.

    From results of `vibrosweep.analysis.order_against_chance`.
    """
    axes = style.axes_on(ax, style.MEDIUM, 2.9)
    for (name, one), colour in zip(found.items(), style.colours(len(found)), strict=True):
        z = np.sort(one["dt_min_over_chance"].values)
        label = f"{name}: {z.size} realizations"
        axes.step(z, np.arange(1, z.size + 1) / z.size, where="post", color=colour, label=label)
    z = np.geomspace(1e-3, 10.0, 200)
    axes.plot(z, -np.expm1(-z), color="black", linewidth=1.2, label="chance: $1 - e^{-z}$")
    axes.set_xscale("log")
    axes.set(xlim=(1e-3, 10.0), ylim=(0.0, 1.02))
    axes.set_xlabel(r"$z = \Lambda\,\Delta t_{\mathrm{min}}$")
    axes.set_ylabel("fraction of realizations\nwith at most this")
    style.head(axes, "", columns=1)
    return axes
