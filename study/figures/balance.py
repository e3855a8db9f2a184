"""Energy without excitation, and the balance of kick and loss."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from vibrosweep.figures import style

if TYPE_CHECKING:
    import xarray as xr


@style.styled
def energy_decay(
    record: xr.Dataset, *, ax: Sequence[Axes] | NDArray[np.object_] | None = None
) -> NDArray[np.object_]:
    """Draw the energy after each impact, of the first particle, against number and time."""
    one = record.isel(realization=0, particle=0)
    speed = one["rebound_velocity"].values
    energy = (speed / float(one["launch_velocity"])) ** 2
    left, right = panels = style.panels_on(ax, style.PAGE, 2.6, [[0, 1]], sharey=True)
    number = np.arange(1, energy.size + 1)
    for axes, x, label in (
        (left, number, "impact"),
        (right, one["landing_time"].values, "time (s)"),
    ):
        axes.semilogy(x, energy, color=style.OKABE_ITO[0], marker="o", markersize=2.0)
        axes.set_xlabel(label)
    left.xaxis.set_major_locator(MaxNLocator(integer=True))
    # the exponential in time that has the slope of the first flights
    time = one["landing_time"].values
    rate = np.log(energy[1] / energy[0]) / (time[1] - time[0])
    right.semilogy(
        time,
        energy[0] * np.exp(rate * (time - time[0])),
        color=style.OKABE_ITO[1],
        linestyle=(0, (5, 2)),
        label="exponential of the first flights",
    )
    style.head(right, "")
    left.set_ylabel("energy over that of the launch")
    return panels


@style.styled
def balance_against_rests(balance: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw the relative imbalance of each particle against its share of landings with a rest.

    From the result of `study.records.energy_balance`.
    """
    count = balance["balanced_impacts"].values.ravel()
    some = count > 0
    rests = balance["rests"].values.ravel()[some] / count[some]
    relative = (balance["balance"].values / balance["mean_loss"].values).ravel()[some]
    axes = style.axes_on(ax, style.MEDIUM, 2.8)
    axes.set_yscale("symlog", linthresh=0.1)
    for chosen, colour, name in (
        (rests == 0.0, style.OKABE_ITO[0], "no rests"),
        (rests > 0.0, style.OKABE_ITO[1], "with rests"),
    ):
        axes.plot(
            rests[chosen],
            relative[chosen],
            linestyle="none",
            marker="o",
            markersize=3.0,
            markeredgewidth=0.0,
            alpha=0.6,
            color=colour,
            label=name,
        )
    axes.axhline(0.0, color="black", linewidth=0.6)
    axes.set_xlabel("share of landings that end in a rest")
    axes.set_ylabel(r"$(\langle U \rangle - (1-e)\langle v \rangle) / (1-e)\langle v \rangle$")
    style.head(axes, "")
    return axes
