"""Distribution of the smallest separation over realizations, and its dependence on parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis.records import per_realization, variable
from vibrosweep.analysis.requirements import require
from vibrosweep.arrays import Array
from vibrosweep.errors import DataError, ParameterError, require_one_of
from vibrosweep.model.measures import UNDETERMINED, VARIABLES
from vibrosweep.store.rows import flat

__all__ = [
    "QUANTILES",
    "compare_separations",
    "separation_against",
    "separation_distribution",
]

QUANTILES: Final = (0.05, 0.25, 0.5, 0.75, 0.95)
CONFIDENCE: Final = 0.95
MEASURES: Final = ("dt_min", "dt_min_same_index")


def separation_distribution(
    sweep: xr.Dataset, *, measure: str = "dt_min", quantiles: Sequence[float] = QUANTILES
) -> xr.Dataset:
    """Quantiles and empirical distribution of a separation over the realizations of a sweep.

    Parameters
    ----------
    sweep
        Result of a sweep with separations.
    measure
        ``"dt_min"`` or ``"dt_min_same_index"``.
    quantiles
        In [0, 1]; that of q is the least number that a share q of separations does not exceed.

    Returns
    -------
    xarray.Dataset
        ``separation_quantile`` (quantile) in s; ``separation`` (rank) in s, sorted, and
        ``cumulative_fraction`` (rank), the fraction of realizations with at most that separation.
        Scalars: ``zero_fraction``, ``collision_free_fraction`` with the ends of its Wilson 95 %
        interval, and the number ``known`` of realizations in which the separation is defined.

    Raises
    ------
    DataError
        The sweep lacks a variable.
    ParameterError
        The measure is not one of the two.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import separation_distribution
    >>> sweep = vs.sweep(amplitude=(0.2, 3.5), realizations=50, particles=2, separation=True)
    >>> found = separation_distribution(sweep, quantiles=[0.5])
    >>> found.separation.dims, found.separation_quantile.attrs["units"]
    (('rank',), 's')
    """
    sweep = flat(sweep)
    _require_separations(sweep, "separation_distribution", measure, quantiles)
    values = sweep[measure].values
    rank = np.sort(values[np.isfinite(values)])
    found = xr.Dataset(
        {
            "separation": variable(("rank",), rank, VARIABLES[measure].long_name, "s"),
            "cumulative_fraction": variable(
                ("rank",),
                np.arange(1, rank.size + 1) / max(rank.size, 1),
                "fraction of realizations with at most this separation",
            ),
        }
    )
    parts = [_statistics(values, sweep["collision_free"].values, quantiles)]
    return xr.merge([found, _table(parts, measure, quantiles).squeeze("part", drop=True)])


def separation_against(
    sweep: xr.Dataset,
    parameter: str,
    *,
    bins: int = 10,
    measure: str = "dt_min",
    quantiles: Sequence[float] = QUANTILES,
) -> xr.Dataset:
    """Separation against a sampled parameter, in bins that hold equally many realizations.

    Parameters
    ----------
    sweep
        Result of a sweep with separations.
    parameter
        Name of a parameter that differs between realizations, as ``"restitution"``.
    bins
        Number of bins; fewer where the parameter takes fewer values.
    measure, quantiles
        As for `separation_distribution`.

    Returns
    -------
    xarray.Dataset
        Dim ``part``: the scalars and quantiles of `separation_distribution` for each bin, with
        coordinates ``{parameter}_low`` and ``{parameter}_high``, its ends.

    Raises
    ------
    DataError
        The sweep lacks a variable, or the parameter is the same in all realizations.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import separation_against
    >>> sweep = vs.sweep(amplitude=(0.2, 3.5), realizations=50, particles=2, separation=True)
    >>> separation_against(sweep, "amplitude", bins=5).separation_quantile.dims
    ('part', 'quantile')
    """
    sweep = flat(sweep)
    _require_separations(sweep, "separation_against", measure, quantiles)
    require(sweep, "separation_against", parameter)
    values = per_realization(sweep, parameter)
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, bins + 1)))
    if edges.size < 2:
        raise DataError(
            f"separation_against needs realizations that differ in {parameter}: sample it, for "
            f"example {parameter} = [low, high], in the [sample] section of the sweep file"
        )
    part = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, edges.size - 2)
    dt, free = sweep[measure].values, sweep["collision_free"].values
    parts = [_statistics(dt[part == i], free[part == i], quantiles) for i in range(edges.size - 1)]
    units = str(sweep[parameter].attrs.get("units", "1"))
    return _table(parts, measure, quantiles).assign_coords(
        {
            f"{parameter}_low": variable(("part",), edges[:-1], f"lower end, {parameter}", units),
            f"{parameter}_high": variable(("part",), edges[1:], f"upper end, {parameter}", units),
        }
    )


def compare_separations(
    sweeps: Sequence[xr.Dataset],
    *,
    measure: str = "dt_min",
    quantiles: Sequence[float] = QUANTILES,
) -> xr.Dataset:
    """Separation against the number of particles and the time of observation.

    Parameters
    ----------
    sweeps
        Results of sweeps that differ in the number of particles, in the duration, or both.
    measure, quantiles
        As for `separation_distribution`.

    Returns
    -------
    xarray.Dataset
        Dim ``part``, one for each sweep in the given order: the scalars and quantiles of
        `separation_distribution`, with coordinates ``particles`` and ``duration`` (s).

    Raises
    ------
    DataError
        A sweep lacks a variable.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import compare_separations
    >>> asked = {"amplitude": (0.2, 3.5), "realizations": 50, "separation": True}
    >>> found = compare_separations([vs.sweep(**asked, particles=n) for n in (2, 5)])
    >>> found.particles.values.tolist()
    [2, 5]
    """
    sweeps = [flat(sweep) for sweep in sweeps]
    for sweep in sweeps:
        _require_separations(sweep, "compare_separations", measure, quantiles)
        if "particles" not in sweep.attrs:
            raise DataError(
                "compare_separations needs the number of particles, which the dataset does not "
                "state: open the result of vibrosweep run"
            )
    parts = [_statistics(s[measure].values, s["collision_free"].values, quantiles) for s in sweeps]
    particles = np.array([int(s.attrs["particles"]) for s in sweeps])
    durations = np.array([_duration(s) for s in sweeps])
    return _table(parts, measure, quantiles).assign_coords(
        particles=variable(("part",), particles, "particles"),
        duration=variable(
            ("part",),
            durations,
            "end of the observation",
            "s",
            comment="NaN where it differs between realizations",
        ),
    )


def _duration(sweep: xr.Dataset) -> float:
    values = np.unique(sweep["duration"].values)
    return float(values[0]) if values.size == 1 else np.nan


def _require_separations(
    sweep: xr.Dataset, analysis: str, measure: str, quantiles: Sequence[float]
) -> None:
    require_one_of("measure", measure, MEASURES)
    levels = np.asarray(quantiles)
    numeric = levels.ndim == 1 and levels.dtype.kind in "iuf"
    if not (numeric and np.all((levels >= 0.0) & (levels <= 1.0))):
        raise ParameterError(
            f"quantiles = {quantiles!r}: must be a list of numbers, at least 0 and at most 1"
        )
    require(sweep, analysis, measure, "collision_free", "duration")


def _statistics(dt: Array, free: NDArray[np.int8], quantiles: Sequence[float]) -> Array:
    """Known, zero fraction, collision-free fraction and its interval, then the quantiles."""
    from scipy.stats import binomtest

    known = dt[np.isfinite(dt)]
    # take a separation that occurs: interpolation would fill the gap above the separation zero
    at = (
        np.quantile(known, quantiles, method="inverted_cdf")
        if known.size
        else np.full(len(quantiles), np.nan)
    )
    zero = np.mean(known == 0.0) if known.size else np.nan
    decided = free[free != UNDETERMINED]
    if not decided.size:
        return np.array([known.size, zero, np.nan, np.nan, np.nan, *at])
    count = int(np.count_nonzero(decided == 1))
    interval = binomtest(count, decided.size).proportion_ci(CONFIDENCE, method="wilson")
    fraction = count / decided.size
    return np.array([known.size, zero, fraction, interval.low, interval.high, *at])


def _table(parts: Sequence[Array], measure: str, quantiles: Sequence[float]) -> xr.Dataset:
    table = np.array(parts)
    dims = ("part",)
    ends = {"low": "lower", "high": "upper"}
    return xr.Dataset(
        {
            "known": variable(dims, table[:, 0].astype(np.int64), "realizations with a separation"),
            "zero_fraction": variable(dims, table[:, 1], "fraction with separation zero"),
            "collision_free_fraction": variable(
                dims, table[:, 2], "fraction in which no two particles share the base"
            ),
            **{
                f"collision_free_{end}": variable(
                    dims, table[:, 3 + i], f"{words} end of its Wilson 95 % interval"
                )
                for i, (end, words) in enumerate(ends.items())
            },
            "separation_quantile": variable(
                ("part", "quantile"),
                table[:, 5:],
                f"quantile of: {VARIABLES[measure].long_name}",
                "s",
            ),
        },
        coords={"quantile": variable(("quantile",), np.asarray(quantiles), "quantile")},
    )
