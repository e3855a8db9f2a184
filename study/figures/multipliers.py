"""Figure of the rate at which offsets from a locked orbit decay."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from vibrosweep import theory
from vibrosweep.figures import style

if TYPE_CHECKING:
    import xarray as xr


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
