"""First time at which two particles are on the base together."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis.datasets import per_realization, require, table
from vibrosweep.arrays import Array
from vibrosweep.store.arranged import arranged

__all__ = ["first_shared_base"]

NOBODY = -1


def first_shared_base(record: xr.Dataset) -> xr.Dataset:
    """First time at which two particles share the base, and which ones.

    A particle is on the base from its landing to its lift-off, and at least for the contact time.
    A stay that begins at the instant at which another ends does not share the base with it.

    Parameters
    ----------
    record
        Record of every landing, as `simulate` returns it.

    Returns
    -------
    xarray.Dataset
        Dim ``realization``: ``first_shared_time`` (s; NaN where it never happens within the
        observation), ``occupant`` and ``newcomer``, the numbers of the particles, or -1.

    Raises
    ------
    DataError
        The record lacks a variable.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import first_shared_base
    >>> found = first_shared_base(vs.simulate(launch_time=[0.3, 0.3]))
    >>> found.first_shared_time.item() == 0.3 + 2 * 5.0 / 9.81
    True
    """
    record = arranged(record)
    require(record, "first_shared_base", "landing_time", "liftoff_time", "contact_time")
    contact = per_realization(record, "contact_time")
    landing, liftoff = record["landing_time"].values, record["liftoff_time"].values
    found = [_first(*one) for one in zip(landing, liftoff, contact, strict=True)]
    times = [one[0] for one in found]
    return table(
        "realization",
        first_shared_time=(times, "first time at which two particles share the base", "s"),
        occupant=([one[1] for one in found], "particle that was on the base"),
        newcomer=([one[2] for one in found], "particle that landed beside it"),
    )


def _first(landing: Array, liftoff: Array, contact_time: float) -> tuple[float, int, int]:
    """Time, occupant and newcomer; arrays of shape (particle, impact)."""
    known = np.isfinite(landing)
    # a particle without a lift-off stays on the base
    leaves = np.where(np.isnan(liftoff), np.inf, np.maximum(liftoff, landing + contact_time))
    order = np.argsort(landing[known], kind="stable")
    who, begin, end = np.nonzero(known)[0][order], landing[known][order], leaves[known][order]
    # stays of one particle do not overlap: one that has not yet ended is another particle's
    latest = np.maximum.accumulate(end)[:-1]
    sharing = np.flatnonzero((begin[1:] < latest) & _another(who, end))
    if not sharing.size:
        return np.nan, NOBODY, NOBODY
    k = int(sharing[0]) + 1
    return float(begin[k]), int(who[int(np.argmax(end[:k]))]), int(who[k])


def _another(who: NDArray[np.int64], end: Array) -> NDArray[np.bool_]:
    """Return whether the latest end before each stay but the first is that of another particle.

    After a flight of exactly one contact time, rounding may make it the particle's own.
    """
    holder = np.zeros(who.size, np.int64)
    new = np.flatnonzero(end[1:] > np.maximum.accumulate(end)[:-1]) + 1
    holder[new] = new
    return np.asarray(who[np.maximum.accumulate(holder)[:-1]] != who[1:])
