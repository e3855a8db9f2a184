"""Rebound heights against restitution, and the plateaus of the locked orbits (Fig. 3)."""

from __future__ import annotations

import numpy as np
import xarray as xr

from vibrosweep.analysis.records import per_realization, variable
from vibrosweep.analysis.requirements import require
from vibrosweep.errors import DataError
from vibrosweep.model import theory

__all__ = ["heights_against_restitution"]


def heights_against_restitution(
    sweep: xr.Dataset, *, bins: int = 9, tolerance: float = 1e-6
) -> xr.Dataset:
    """Rebound heights against restitution, and how many lie on a plateau g k^2 / (8 f^2).

    Parameters
    ----------
    sweep
        Result of a sweep in which the restitution differs.  With a long transient its heights are
        those of the steady motion.
    bins
        Bins of equally many realizations.
    tolerance
        Relative distance up to which a height lies on a plateau.

    Returns
    -------
    xarray.Dataset
        Dim ``part``: ``restitution_low``, ``restitution_high``, medians of the maximum and the mean
        rebound height (m), ``plateau_fraction``.  Dim ``realization``: ``mode``, the k of the
        plateau, or 0.  Scalars: ``relative_change``, the change of the median maximum height from
        the lowest to the highest bin, relative to the lowest; ``rank_correlation`` (Spearman) of
        maximum height and restitution, and its ``p_value``; ``plateau_deviation``, the largest
        relative distance of those on a plateau from it.

    Raises
    ------
    DataError
        The sweep lacks a variable, or its restitutions do not fill two bins.
    """
    from scipy.stats import spearmanr

    names = ("restitution", "frequency", "gravity", "rebound_height_max", "rebound_height_mean")
    require(sweep, "heights_against_restitution", *names)
    e, frequency, gravity = (per_realization(sweep, name) for name in names[:3])
    highest, mean = (sweep[name].values for name in names[3:])
    ratio = highest / theory.locked_height(1, frequency, gravity)
    known = np.isfinite(ratio)
    mode = np.where(known, np.rint(np.sqrt(np.where(known, ratio, 0.0))), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.abs(ratio / mode**2 - 1.0)
    on = known & (mode > 0.0) & (distance <= tolerance)
    edges = np.unique(np.quantile(e, np.linspace(0.0, 1.0, bins + 1)))
    if edges.size < 3:
        raise DataError(
            "heights_against_restitution needs realizations that differ in restitution: sample "
            "it, for example restitution = [low, high], in the [sample] section of the sweep file"
        )
    part = np.clip(np.searchsorted(edges, e, side="right") - 1, 0, edges.size - 2)
    parts = [part == i for i in range(edges.size - 1)]
    medians = [np.array([np.nanmedian(h[p]) for p in parts]) for h in (highest, mean)]
    correlation = spearmanr(e[known], highest[known])
    dims = ("part",)
    return xr.Dataset(
        {
            "height_max_median": variable(dims, medians[0], "median maximum rebound height", "m"),
            "height_mean_median": variable(dims, medians[1], "median mean rebound height", "m"),
            "plateau_fraction": variable(
                dims, [float(np.mean(on[p])) for p in parts], "fraction on a plateau"
            ),
            "mode": variable(
                ("realization",), np.where(on, mode, 0.0).astype(np.int64), "mode of the plateau"
            ),
            "relative_change": variable(
                (), medians[0][-1] / medians[0][0] - 1.0, "change of the median maximum height"
            ),
            "rank_correlation": variable(
                (), float(correlation.statistic), "rank correlation of height and restitution"
            ),
            "p_value": variable((), float(correlation.pvalue), "its p-value"),
            "plateau_deviation": variable(
                (), float(np.max(distance[on], initial=0.0)), "largest distance from a plateau"
            ),
        },
        coords={
            "restitution_low": variable(dims, edges[:-1], "lower end, restitution"),
            "restitution_high": variable(dims, edges[1:], "upper end, restitution"),
        },
    )
