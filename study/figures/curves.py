"""Figures of single claims: crossings, times to rest, errors of the scheme, decay of offsets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from study.arrays import Array
from vibrosweep import theory
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


@style.styled
def times_to_rest(
    contact_time: Array, mean_time: Mapping[str, Array], simulated: float, *, ax: Axes | None = None
) -> Axes:
    """Draw mean times until the first rest against the contact time, a curve for each law.

    All times are in s; particles were simulated for `simulated`, beyond which means are
    extrapolated from the few that rested.
    """
    axes = style.axes_on(ax, style.MEDIUM, 2.8)
    for (law, each), colour, marker in zip(mean_time.items(), style.OKABE_ITO, "os", strict=False):
        axes.plot(contact_time, each, marker=marker, color=colour, label=f"law {law}")
    axes.axhline(
        simulated, color="black", linestyle=(0, (5, 2)), linewidth=0.8, label="time simulated"
    )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(r"contact time $\tau_c$ (s)")
    axes.set_ylabel("mean time until a rest (s)")
    style.head(axes, "", columns=3)
    return axes


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


@style.styled
def decay_per_impact(restitution: float, measured: xr.Dataset, *, ax: Axes | None = None) -> Axes:
    """Draw the modulus of the leading multiplier of mode 1 at 1 Hz against the amplitude.

    `measured` has the dim ``amplitude`` (m s-1) and the variable ``modulus_fitted``.
    """
    low, high = (float(end(1, restitution)) for end in (theory.amplitude_min, theory.amplitude_max))
    amplitude = np.linspace(low, 1.15 * high, 600)
    modulus = np.abs(theory.multipliers(1, restitution, amplitude)).max(axis=-1)
    axes = style.axes_on(ax, style.MEDIUM, 2.9)
    axes.plot(amplitude, modulus, color=style.OKABE_ITO[0], label="full multipliers")
    axes.axhline(
        restitution,
        color=style.OKABE_ITO[1],
        linestyle=(0, (5, 2)),
        label="linearised update: $e$",
    )
    axes.plot(
        measured["amplitude"].values,
        measured["modulus_fitted"].values,
        linestyle="none",
        marker="o",
        markersize=5.0,
        markerfacecolor="none",
        markeredgecolor="black",
        label="measured",
    )
    axes.axhline(1.0, color="black", linewidth=0.6, label="no change")
    axes.axvline(high, color=style.GREY, linewidth=0.6)
    axes.annotate(
        r"$A_{\mathrm{max}}$",
        (high, restitution),
        xytext=(-4, 6),
        textcoords="offset points",
        ha="right",
    )
    axes.set(xlim=(low, 1.15 * high), ylim=(restitution - 0.02, 1.1))
    axes.set_xlabel("amplitude $A$ (m s$^{-1}$)")
    axes.set_ylabel("change per impact")
    style.head(axes, "", columns=2)
    return axes
