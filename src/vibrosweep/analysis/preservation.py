"""Preservation of separations from one impact to the next (Eqs. 23, 24)."""

from __future__ import annotations

import numpy as np
import xarray as xr

from vibrosweep.analysis.datasets import per_realization, require, table
from vibrosweep.arrays import Array
from vibrosweep.store.arranged import arranged

__all__ = ["separation_changes"]


def separation_changes(
    record: xr.Dataset, *, since: float = 0.0, landed_before: int = 0
) -> xr.Dataset:
    """Changes of the separation of two particles from one impact to the next.

    The separation of particles i and j at impact n is t_j(n) - t_i(n); its change from n to n + 1
    is compared with the contact time, which is the resolution of the model.

    Parameters
    ----------
    record
        Record of every landing, as `simulate` returns it.
    since
        Landings from this time on, in s, are taken.
    landed_before
        Number of first impacts of each particle that are left out as well.

    Returns
    -------
    xarray.Dataset
        Dim ``realization``: ``change_max`` and ``change_median`` (s) over all pairs of particles
        and successive impacts, the ``preserved_fraction`` that changes by at most the contact time,
        and the number ``steps`` of changes; if it is 0, the others are NaN.

    Raises
    ------
    DataError
        The record lacks a variable.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import separation_changes
    >>> record = vs.simulate(launch_time=[0.125, 0.13], duration=200.0)
    >>> found = separation_changes(record, since=190.0)
    >>> found.change_max.dims, found.preserved_fraction.values
    (('realization',), array([1.]))
    """
    record = arranged(record)
    require(record, "separation_changes", "landing_time", "contact_time")
    times = record["landing_time"].values[..., landed_before:]
    times = np.where(times >= since, times, np.nan)
    contact = per_realization(record, "contact_time")
    found = [_summary(_changes(one), tau) for one, tau in zip(times, contact, strict=True)]
    largest, middle, preserved, steps = np.array(found).reshape(-1, 4).T
    return table(
        "realization",
        change_max=(largest, "largest change of a separation", "s"),
        change_median=(middle, "median change of a separation", "s"),
        preserved_fraction=(preserved, "fraction of separations preserved to the contact time"),
        steps=(steps.astype(np.int64), "separations compared"),
    )


def _changes(times: Array) -> Array:
    """Absolute changes of all pairs of one realization; times of shape (particle, impact)."""
    steps = np.diff(times, axis=1)
    pairs = [np.abs(steps[i + 1 :] - steps[i]).ravel() for i in range(times.shape[0] - 1)]
    changes = np.concatenate([np.empty(0), *pairs])
    return np.asarray(changes[np.isfinite(changes)])


def _summary(changes: Array, contact_time: float) -> tuple[float, float, float, float]:
    if not changes.size:
        return np.nan, np.nan, np.nan, 0.0
    preserved = float(np.mean(changes <= contact_time))
    return float(changes.max()), float(np.median(changes)), preserved, float(changes.size)
