"""Figure of the time for which particles move irregularly before they rest."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.axes import Axes

from study.arrays import Array
from vibrosweep.figures import style


@style.styled
def times_to_rest(
    contact_time: Array, mean_time: Mapping[str, Array], followed: float, *, ax: Axes | None = None
) -> Axes:
    """Draw mean times until the first rest against the contact time, a curve for each law.

    All times are in s; particles were followed for `followed`, beyond which means are extrapolated
    from the few that rested.
    """
    axes = style.axes_on(ax, style.MEDIUM, 2.8)
    for (law, each), colour, marker in zip(mean_time.items(), style.OKABE_ITO, "os", strict=False):
        axes.plot(contact_time, each, marker=marker, color=colour, label=f"law {law}")
    axes.axhline(
        followed, color="black", linestyle=(0, (5, 2)), linewidth=0.8, label="time followed"
    )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(r"contact time $\tau_c$ (s)")
    axes.set_ylabel("mean time until a rest (s)")
    style.head(axes, "", columns=3)
    return axes
