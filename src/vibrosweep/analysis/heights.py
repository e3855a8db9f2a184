"""Rebound heights against restitution, and the plateaus of the locked orbits (Fig. 3)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep import theory
from vibrosweep.analysis.datasets import (
    completed,
    equal_parts,
    per_realization,
    require,
    table,
    variable,
)
from vibrosweep.analysis.records import moves, require_scene
from vibrosweep.arrays import Array
from vibrosweep.store.rows import flat

__all__ = ["heights_against_restitution"]


def heights_against_restitution(
    sweep: xr.Dataset, *, bins: int = 9, tolerance: float = 1e-6
) -> xr.Dataset:
    """Rebound heights against restitution, and the share that lies on a plateau g k^2 / (8 f^2).

    Over a moving base the highest point of a locked orbit depends on restitution and amplitude
    (`vibrosweep.theory.locked_apex`), and so does the plateau of each realization.

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
        rebound height (m), ``plateau_fraction`` of the heights.  Dim ``realization``: ``mode``, the
        k of the plateau, 0 on none, -1 if there is no height (an incomplete realization has none,
        since its measures cover only a part).  Scalars: ``relative_change``, the change of the
        median maximum height from the lowest to the highest bin, relative to the lowest;
        ``rank_correlation`` (Spearman) of maximum height and restitution, and its ``p_value``;
        ``plateau_deviation``, the largest relative distance of a height on a plateau from it.

    Raises
    ------
    DataError
        The sweep lacks a variable, or its restitutions do not fill two bins.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import heights_against_restitution
    >>> sweep = vs.sweep(restitution=(0.8, 0.98), realizations=50,
    ...                  duration=1000.0, transient=900.0)
    >>> found = heights_against_restitution(sweep, bins=3)
    >>> found.plateau_fraction.dims, sorted(set(found["mode"].values.tolist()))
    (('part',), [0, 1])
    """
    from scipy.stats import spearmanr

    names = ("restitution", "frequency", "gravity", "rebound_height_max", "rebound_height_mean")
    sweep = flat(sweep)
    require_scene(sweep, "heights_against_restitution")
    require(sweep, "heights_against_restitution", *names)
    known = np.isfinite(sweep["rebound_height_max"].values) & completed(sweep)
    highest, mean = (np.where(known, sweep[name].values, np.nan) for name in names[3:])
    mode, distance = _nearest_plateau(sweep, np.where(known, highest, 0.0))
    on = known & (mode > 0.0) & (distance <= tolerance)
    parts, ends = equal_parts(sweep, "restitution", bins, "heights_against_restitution", fewest=2)
    parts = [known & part for part in parts]
    medians = [np.array([_reduced(np.median, h[p]) for p in parts]) for h in (highest, mean)]
    on_plateaus = [_reduced(np.mean, on[p]) for p in parts]
    change = medians[0][-1] / medians[0][0] - 1.0
    correlation = spearmanr(per_realization(sweep, "restitution")[known], highest[known])
    deviation = float(np.max(distance[on], initial=0.0))
    of_parts = table(
        "part",
        height_max_median=(medians[0], "median maximum rebound height", "m"),
        height_mean_median=(medians[1], "median mean rebound height", "m"),
        plateau_fraction=(on_plateaus, "fraction of heights on a plateau"),
    )
    return of_parts.assign(
        mode=variable(
            "realization",
            np.where(on, mode, np.where(known, 0.0, -1.0)).astype(np.int64),
            "mode of the plateau",
            comment="0 on no plateau, -1 if there is no height",
        ),
        relative_change=variable((), change, "change of the median maximum height"),
        rank_correlation=variable(
            (), float(correlation.statistic), "rank correlation of height and restitution"
        ),
        p_value=variable((), float(correlation.pvalue), "its p-value"),
        plateau_deviation=variable((), deviation, "largest distance from a plateau"),
    ).assign_coords(ends)


def _reduced(function: Callable[[Any], Any], values: NDArray[Any]) -> float:
    """Mean or median of values, NaN if there are none."""
    return float(function(values)) if values.size else np.nan


def _nearest_plateau(sweep: xr.Dataset, height: Array) -> tuple[Array, Array]:
    """Mode of the plateau nearest to each height, 0 if there is none, and the relative distance."""
    frequency, gravity = (per_realization(sweep, name) for name in ("frequency", "gravity"))
    squares = height / theory.locked_height(1, frequency, gravity)
    if not moves(sweep):
        mode = np.rint(np.sqrt(squares))
        with np.errstate(divide="ignore", invalid="ignore"):
            return mode, np.abs(squares / mode**2 - 1.0)
    require(sweep, "heights_against_restitution", "amplitude")
    e, amplitude = (per_realization(sweep, name) for name in ("restitution", "amplitude"))
    mode, distance = np.zeros_like(height), np.full_like(height, np.inf)
    # locked particles leave the base above its mean level, and rise from there by `locked_height`
    highest = np.sqrt(np.max(squares, initial=0.0))
    for k in range(1, int(highest) + 1):
        apart = np.abs(height / theory.locked_apex(k, e, amplitude, frequency, gravity) - 1.0)
        nearer = apart < distance  # False where there is no such orbit
        mode, distance = np.where(nearer, k, mode), np.where(nearer, apart, distance)
    return mode, distance
