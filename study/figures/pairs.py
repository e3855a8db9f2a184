"""Separations of pairs of particles: impact by impact, and after a long time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from vibrosweep.figures import style

if TYPE_CHECKING:
    import xarray as xr

# Where zero is drawn on a logarithmic axis, s
ZERO: Final = 1e-17
PARTNERS: Final = len(style.OKABE_ITO)  # curves that colours distinguish


@style.styled
def separations_in_time(record: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw the separation of particles from the first one, at each impact number.

    Of more than `PARTNERS` only the first are drawn, and the heading says so.
    """
    one = record.isel(realization=0)
    times = one["landing_time"].values
    axes = style.axes_on(ax, style.PAGE, 2.5)
    number = np.arange(1, times.shape[1] + 1)
    partners = times.shape[0] - 1
    for i, colour in zip(range(1, partners + 1), style.OKABE_ITO, strict=False):
        launched = float(one["launch_time"][i] - one["launch_time"][0])
        axes.plot(
            number,
            times[i] - times[0],
            color=colour,
            marker="o",
            markersize=2.5,
            linewidth=0.6,
            label=f"launched {1e3 * launched:g} ms later",
        )
        axes.axhline(launched, color=colour, linestyle=(0, (5, 2)), linewidth=0.8)
    axes.plot([], [], color=style.GREY, linestyle=(0, (5, 2)), label="at the launch")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("impact $n$")
    axes.set_ylabel("separation $t_j(n) - t_i(n)$ (s)")
    rest = f"; the first {PARTNERS} of {partners} partners" if partners > PARTNERS else ""
    restitution, amplitude, frequency = (
        float(one[name]) for name in ("restitution", "amplitude", "frequency")
    )
    scene = f"$e$ = {restitution:.4g}, $A$ = {amplitude:.4g} m s$^{{-1}}$, $f$ = {frequency:.4g} Hz"
    style.head(axes, scene + rest)
    return axes


@style.styled
def fates(sweep: xr.Dataset, launched: float, *, ax: Axes | None = None) -> Axes:
    """Draw the smallest separation of pairs late in the observation against the amplitude.

    The sweep is of two particles, launched `launched` s apart, with separations, regimes and a late
    window.
    """
    dt = sweep["dt_min"].values
    amplitude = sweep["amplitude"].values
    elsewhere = (sweep["unsettled_count"] + sweep["aperiodic_count"]).values > 0
    axes = style.axes_on(ax, style.MEDIUM, 3.0)
    for chosen, colour, name in (
        (~elsewhere, style.OKABE_ITO[0], "recurrent orbits"),
        (elsewhere, style.OKABE_ITO[1], "not recurrent so far"),
    ):
        axes.plot(
            amplitude[chosen],
            np.maximum(dt[chosen], ZERO),
            linestyle="none",
            marker="o",
            markersize=3.5,
            markeredgewidth=0.0,
            alpha=0.7,
            color=colour,
            label=name,
        )
    axes.axhline(
        launched, color="black", linestyle=(0, (5, 2)), linewidth=0.8, label="at the launch"
    )
    axes.set_yscale("log")
    exponents = np.arange(-14.0, 1.0, 4.0)
    names = ["0", *(f"$10^{{{int(x)}}}$" for x in exponents)]
    axes.set_yticks([ZERO, *10.0**exponents], names)
    axes.minorticks_off()
    axes.set_xlabel("amplitude $A$ (m s$^{-1}$)")
    axes.set_ylabel("smallest separation (s)")
    style.head(axes, "")
    return axes


@style.styled
def decay_in_a_slot(found: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw the separation of two particles in one slot, and the decay that multipliers predict.

    From the result of `study.slots.decay_in_slot`.
    """
    separation = np.abs(found["separation"].values)
    positive = separation > 0.0
    number = np.arange(separation.size)
    axes = style.axes_on(ax, style.MEDIUM, 2.9)
    axes.plot(
        number[positive],
        separation[positive],
        "o",
        markersize=2.0,
        markeredgewidth=0.0,
        color=style.OKABE_ITO[0],
        label="two particles",
    )
    modulus = float(found["modulus_predicted"])
    axes.plot(
        number,
        separation[:20].max() * modulus**number,
        color=style.OKABE_ITO[1],
        linestyle=(0, (5, 2)),
        label=f"multipliers: {modulus:.4f} per cycle",
    )
    axes.set(yscale="log", xlabel="cycle", ylabel="separation (s)")
    axes.set_ylim(bottom=0.3 * separation[positive].min())
    style.head(axes, f"fitted: {float(found['modulus_fitted']):.4f} per cycle")
    return axes
