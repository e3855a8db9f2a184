"""Distribution of the smallest separation over realizations, and its dependence on parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis.basin_shape import share_interval
from vibrosweep.analysis.records import completed, equal_parts, table, variable
from vibrosweep.analysis.requirements import require
from vibrosweep.arrays import Array
from vibrosweep.errors import DataError, ParameterError, require_one_of
from vibrosweep.model.measures import UNDETERMINED, VARIABLES
from vibrosweep.store.arranged import flat, require_datasets

__all__ = ["QUANTILES", "compare_separations", "separation_against", "separation_distribution"]

QUANTILES: Final = (0.05, 0.25, 0.5, 0.75, 0.95)
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
        In [0, 1]; the quantile q is the least separation that a share q of them does not exceed.

    Returns
    -------
    xarray.Dataset
        ``separation_quantile`` (quantile) in s; ``separation`` (rank) in s, sorted, and
        ``cumulative_fraction`` (rank), the fraction of realizations with at most that separation.
        Scalars: ``zero_fraction``, ``collision_free_fraction`` with the ends of its Wilson 95 %
        interval, and the number ``known`` of realizations in which the separation is defined.
        Separations of realizations that did not complete are left out: later landings might have
        been closer.

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
    sweep = _checked(sweep, "separation_distribution", measure, quantiles)
    values = sweep[measure].values
    rank = np.sort(values[np.isfinite(values)])
    share = np.arange(1, rank.size + 1) / max(rank.size, 1)
    found = table(
        "rank",
        separation=(rank, VARIABLES[measure].long_name, "s"),
        cumulative_fraction=(share, "fraction of realizations with at most this separation"),
    )
    parts = [_statistics(values, sweep["collision_free"].values, quantiles)]
    return xr.merge([found, _parts(parts, measure, quantiles).squeeze("part", drop=True)])


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
        Name of a parameter that differs between realizations, such as ``"restitution"``.
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
    sweep = _checked(sweep, "separation_against", measure, quantiles)
    require(sweep, "separation_against", parameter)
    parts, ends = equal_parts(sweep, parameter, bins, "separation_against")
    dt, free = sweep[measure].values, sweep["collision_free"].values
    found = [_statistics(dt[part], free[part], quantiles) for part in parts]
    return _parts(found, measure, quantiles).assign_coords(ends)


def compare_separations(
    sweeps: Sequence[xr.Dataset], *, measure: str = "dt_min", quantiles: Sequence[float] = QUANTILES
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
        A sweep lacks a variable or its number of particles.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import compare_separations
    >>> asked = {"amplitude": (0.2, 3.5), "realizations": 50, "separation": True}
    >>> found = compare_separations([vs.sweep(**asked, particles=n) for n in (2, 5)])
    >>> found.particles.values.tolist()
    [2, 5]
    """
    require_datasets(sweeps)
    sweeps = [_checked(sweep, "compare_separations", measure, quantiles) for sweep in sweeps]
    for sweep in sweeps:
        if "particles" not in sweep.attrs:
            raise DataError(
                "compare_separations needs the number of particles, which the dataset does not "
                "state: open the result of vibrosweep run"
            )
    parts = [_statistics(s[measure].values, s["collision_free"].values, quantiles) for s in sweeps]
    particles = np.array([int(s.attrs["particles"]) for s in sweeps])
    durations = np.array([_duration(s) for s in sweeps])
    comment = "NaN where it differs between realizations"
    return _parts(parts, measure, quantiles).assign_coords(
        particles=variable("part", particles, "particles"),
        duration=variable("part", durations, "end of the observation", "s", comment=comment),
    )


def _duration(sweep: xr.Dataset) -> float:
    values = np.unique(sweep["duration"].values)
    values = values[~np.isnan(values)]
    return float(values[0]) if values.size == 1 else np.nan


def _checked(
    sweep: xr.Dataset, analysis: str, measure: str, quantiles: Sequence[float]
) -> xr.Dataset:
    """Return a sweep along one dim; raise an error if an argument is wrong or data are missing."""
    sweep = flat(sweep)
    require_one_of("measure", measure, MEASURES)
    levels = np.asarray(quantiles)
    numeric = levels.ndim == 1 and levels.dtype.kind in "iuf"
    if not (numeric and np.all((levels >= 0.0) & (levels <= 1.0))):
        raise ParameterError(
            f"quantiles = {quantiles!r}: must be a list of numbers, at least 0 and at most 1"
        )
    require(sweep, analysis, measure, "collision_free", "duration")
    known = np.where(completed(sweep), sweep[measure].values, np.nan)
    return sweep.assign({measure: (("realization",), known, sweep[measure].attrs)})


def _statistics(dt: Array, free: NDArray[np.int8], quantiles: Sequence[float]) -> Array:
    """Number known, zero fraction, collision-free fraction and its interval, then quantiles."""
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
    count = np.count_nonzero(decided == 1)
    low, high = share_interval(np.asarray(count), decided.size).values()
    return np.array([known.size, zero, count / decided.size, low, high, *at])


def _parts(parts: Sequence[Array], measure: str, quantiles: Sequence[float]) -> xr.Dataset:
    """Dataset of the `_statistics` of parts of the realizations."""
    statistics = np.array(parts)
    known, zero, free, free_low, free_high = statistics[:, :5].T
    words = f"quantile of: {VARIABLES[measure].long_name}"
    found = table(
        "part",
        known=(known.astype(np.int64), "realizations with a separation"),
        zero_fraction=(zero, "fraction with separation zero"),
        collision_free_fraction=(free, "fraction in which no two particles share the base"),
        collision_free_low=(free_low, "lower end of its Wilson 95 % interval"),
        collision_free_high=(free_high, "upper end of its Wilson 95 % interval"),
    )
    return found.assign(
        separation_quantile=variable(("part", "quantile"), statistics[:, 5:], words, "s")
    ).assign_coords(quantile=variable("quantile", np.asarray(quantiles), "quantile"))
