"""Smallest separations of a sweep, from its result or from its keywords."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Unpack

import xarray as xr

from vibrosweep.analysis.separations import QUANTILES, separation_against, separation_distribution
from vibrosweep.api.given_sweep import Spec
from vibrosweep.api.keyword_types import RealizationKeywords, completed
from vibrosweep.api.sweeps import sweep
from vibrosweep.errors import ParameterError
from vibrosweep.runs.driver import count

__all__ = ["separations"]


@completed(by=RealizationKeywords)
def separations(
    spec: Spec | xr.Dataset | None = None,
    /,
    *,
    against: str | None = None,
    bins: int = 10,
    measure: str = "dt_min",
    quantiles: Sequence[float] = QUANTILES,
    threads: int | None = None,
    **keywords: Unpack[RealizationKeywords],
) -> xr.Dataset:
    """Distribution of the smallest separation between landings of different particles.

    Parameters
    ----------
    spec
        Instead of keywords: the result of a sweep with separations, or an argument of
        `vibrosweep.sweep`.
    against
        Parameter against which the distribution is given, in bins that hold equally many
        realizations; by default all realizations are taken together.
    bins
        Number of bins.
    measure
        ``"dt_min"``, over all landings, or ``"dt_min_same_index"``, over equal impact numbers.
    quantiles
        In [0, 1]; the quantile q is the least number that a share q of separations do not exceed.
    threads
        Number of threads, by default all processors; the result does not depend on it.
    **keywords
        Those of `vibrosweep.sweep`; ``separation=True`` is implied.

    Returns
    -------
    xarray.Dataset
        ``separation_quantile`` (quantile) in s, ``zero_fraction``, ``collision_free_fraction`` with
        the ends of its Wilson 95 % interval, and the number ``known`` of realizations with a
        separation: scalars, or along dim ``part``, with the ends of each bin as coordinates.
        Without `against` also ``separation`` (rank) in s, sorted, with ``cumulative_fraction``.

    Raises
    ------
    SpecError
        Keywords hold mistakes; all of them are listed.
    DataError
        The result lacks separations, or `against` does not differ between realizations.
    ParameterError
        The measure is not one of the two, or `bins` or `quantiles` are not allowed.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.separations(amplitude=(0.5, 3.5), realizations=64, particles=5)
    >>> int(found.known)
    64
    """
    bins = count("bins", bins)
    if isinstance(spec, xr.Dataset):
        if keywords:
            raise ParameterError(f"{', '.join(keywords)}: cannot be given beside a result")
        result = spec
    else:
        needed = {"separation": True} if spec is None else {}
        complete: dict[str, Any] = needed | dict(keywords)
        result = sweep(spec, threads=threads, **complete)
    if against is None:
        return separation_distribution(result, measure=measure, quantiles=quantiles)
    return separation_against(result, against, bins=bins, measure=measure, quantiles=quantiles)
