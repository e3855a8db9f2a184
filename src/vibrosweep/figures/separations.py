"""Distributions of the smallest separation, and its decay inside a slot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from vibrosweep.analysis.datasets import require
from vibrosweep.arrays import Array
from vibrosweep.errors import DataError
from vibrosweep.figures import data, style

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "NEEDS",
    "NEEDS_FOR_CHANCE",
    "separation_distributions",
    "separations_over_chance",
]

# Left edges, at which smaller values are drawn: of separations (s), and of ratios to chance
EDGE: Final = 1e-9
EDGE_OF_CHANCE: Final = 1e-3
MEANINGLESS: Final = "a realization in which no particle rests or is locked, as chance assumes"


class _NeedsForChance(data.Needs):
    """Requirements of the comparison with chance, which some realization must allow."""

    def lacking(self, dataset: xr.Dataset) -> str | None:
        from vibrosweep.analysis.separations import separations_against_chance

        if reason := super().lacking(dataset):
            return reason
        ratio = separations_against_chance(dataset)["dt_min_over_chance"].values
        return None if np.isfinite(ratio).any() else MEANINGLESS


NEEDS: Final = data.Needs(
    ("dt_min", "collision_free", "contact_time", "duration"), known=("dt_min",)
)
NEEDS_FOR_CHANCE: Final = _NeedsForChance(
    (
        "dt_min",
        "particle_impact_count",
        "rest_count",
        "at_rest_count",
        "frequency",
        "duration",
        "transient",
    ),
    known=("dt_min",),
)


@style.styled
def separation_distributions(
    found: Sequence[xr.Dataset],
    names: Sequence[str],
    contact_time: ArrayLike,
    *,
    ax: Axes | None = None,
) -> Axes:
    """Draw empirical distributions of the smallest separation.

    Parameters
    ----------
    found
        Result of `vibrosweep.analysis.separation_distribution` for each curve.
    names
        Names of the curves.
    contact_time
        Contact time in s, marked by a line; several are marked by a band from the least to the
        greatest.
    ax
        Axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    DataError
        A dataset is not a result of `separation_distribution`.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import separation_distributions
    >>> sweep = vs.sweep(amplitude=(0.2, 3.5), realizations=50, particles=2, separation=True)
    >>> axes = separation_distributions([vs.separations(sweep)], ["two particles"], 1e-4)
    >>> axes.get_xscale()
    'log'
    """
    for one in found:
        needed = ("separation", "cumulative_fraction")
        require(one, "separation_distributions", *needed, source="separation_distribution")
    curves = [(one["separation"].values, one["cumulative_fraction"].values) for one in found]
    ends = (EDGE, max(1.0, *(float(values.max(initial=0.0)) for values, _ in curves)))
    axes = _distributions(ax, curves, names, ends, linewidth=1.2)
    least, greatest = float(np.min(contact_time)), float(np.max(contact_time))
    if least < greatest:
        axes.axvspan(least, greatest, color="0.9", zorder=0.5)
    else:
        axes.axvline(least, color="black", linestyle=style.DASHED, linewidth=0.8)
    axes.annotate(
        r"$\tau_c$",
        (least, 0.03),
        xytext=(3, 0),
        textcoords="offset points",
        path_effects=style.halo(),
    )
    axes.set_xlabel(r"smallest separation $\Delta t_{\mathrm{min}}$ (s)")
    style.head(axes, "")
    return axes


def _distributions(
    ax: Axes | None,
    curves: Sequence[tuple[Array, Array]],
    labels: Sequence[str],
    ends: tuple[float, float],
    linewidth: float | None = None,
) -> Axes:
    """Draw the fractions at sorted values; values below the left end are drawn there."""
    axes, (left, right) = style.axes_on(ax, style.MEDIUM, 2.9), ends
    drawn = zip(curves, labels, style.colours(len(labels)), strict=True)
    for (values, fraction), label, colour in drawn:
        axes.step(
            np.concatenate([[left], np.maximum(values, left), [right]]),
            np.concatenate([[0.0 if values.size else np.nan], fraction, [1.0]]),
            where="post",
            color=colour,
            linewidth=linewidth,
            label=label,
        )
    axes.set(xscale="log", xlim=ends, ylim=(0.0, 1.02))
    axes.set_ylabel("fraction of realizations\nwith at most this")
    return axes


@style.styled
def separations_over_chance(
    found: Sequence[xr.Dataset], names: Sequence[str], *, ax: Axes | None = None
) -> Axes:
    """Draw distributions of the smallest separation relative to its mean for chance landings.

    The black curve is the distribution for chance.  Realizations in which the ratio has no meaning
    are left out; the legend says how many remain.

    Parameters
    ----------
    found
        Result of `vibrosweep.analysis.order_against_chance` or `separations_against_chance` for
        each curve.
    names
        Names of the curves.
    ax
        Axes to draw on; by default those of a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    DataError
        A dataset is not a result of these analyses, or the ratio has no meaning in any realization.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import separations_against_chance
    >>> from vibrosweep.figures import separations_over_chance
    >>> sweep = vs.sweep(amplitude=(4.0, 9.0), rebound="reflect", realizations=50, particles=5,
    ...                  separation=True, per_particle=True)
    >>> axes = separations_over_chance([separations_against_chance(sweep)], ["five particles"])
    >>> axes.get_xscale()
    'log'
    """
    for one in found:
        name = "dt_min_over_chance"
        require(one, "separations_over_chance", name, source="separations_against_chance")
    ratios = [one["dt_min_over_chance"].values for one in found]
    known = [np.sort(ratio[np.isfinite(ratio)]) for ratio in ratios]
    largest = [float(z[-1]) for z in known if z.size]
    if not largest:
        raise DataError(f"figure separations_over_chance needs {MEANINGLESS}")
    ends = (EDGE_OF_CHANCE, max(10.0, *largest))
    curves = [(z, np.arange(1, z.size + 1) / max(z.size, 1)) for z in known]
    labels = [
        f"{name}: {z.size} of {ratio.size} realizations"
        for name, z, ratio in zip(names, known, ratios, strict=True)
    ]
    axes = _distributions(ax, curves, labels, ends)
    z = np.geomspace(*ends, 200)
    axes.plot(z, -np.expm1(-z), color="black", linewidth=1.2, label="chance: $1 - e^{-z}$")
    axes.set_xlabel(r"$z = \Lambda\,\Delta t_{\mathrm{min}}$")
    style.head(axes, "", columns=1)
    return axes
