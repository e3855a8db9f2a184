"""Instants at which two particles in flight are at the same height (Eq. 18), in closed form."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis.datasets import per_realization, table, variable
from vibrosweep.analysis.records import Flights, flights
from vibrosweep.store.arranged import arranged

__all__ = ["crossings"]


def crossings(record: xr.Dataset, *, realization: int = 0) -> xr.Dataset:
    """Every crossing of two particles of one realization while both are in flight.

    Both fall with the same acceleration: where two flights overlap, y_i - y_j is linear in time.
    With d = s_j - s_i >= 0 between their beginnings and x the time since the later one,

        y_i - y_j = h_i - h_j + v_i d - g d^2 / 2 + (v_i - g d - v_j) x,

    where h are the heights of the base at the lift-offs, 0 over the high-bounce base.  The
    difference has at most one root, unless the flights coincide.

    Parameters
    ----------
    record
        Record of every landing, as `simulate` returns it.
    realization
        Its position in the record.

    Returns
    -------
    xarray.Dataset
        Dim ``crossing``, in the order of time: ``time`` (s), ``height`` (m), ``first`` and
        ``second`` particle.  Scalars: ``flight_overlaps`` (pairs of flights that overlap in time),
        ``flights_alike`` (pairs of flights at equal heights throughout), ``pairs`` of particles and
        ``pairs_crossing``.

    Raises
    ------
    DataError
        The record lacks a variable.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import crossings
    >>> found = crossings(vs.simulate(launch_time=[0.0, 0.125]))
    >>> found.time.dims, int(found.pairs)
    (('crossing',), 1)
    """
    record = arranged(record)
    flown = flights(record, realization, "crossings")
    gravity = float(per_realization(record, "gravity")[realization])
    i, j = _overlapping(flown)
    apart = flown.start[j] - flown.start[i]
    offset = apart * (flown.velocity[i] - 0.5 * gravity * apart)
    offset += flown.height[i] - flown.height[j]
    slope = flown.velocity[i] - gravity * apart - flown.velocity[j]
    with np.errstate(invalid="ignore", divide="ignore"):
        since = -offset / slope
    together = np.minimum(flown.end[i], flown.end[j]) - flown.start[j]
    crosses = (since > 0.0) & (since < together)
    alike = (slope == 0.0) & (offset == 0.0)
    first, second = flown.particle[i], flown.particle[j]
    particles = record.sizes["particle"]
    low, high = np.minimum(first, second)[crosses], np.maximum(first, second)[crosses]
    meeting = np.unique(low * particles + high)
    time = flown.start[j] + since
    height = flown.height[j] + since * (flown.velocity[j] - 0.5 * gravity * since)
    chosen = np.flatnonzero(crosses)
    chosen = chosen[np.argsort(time[chosen], kind="stable")]
    counts = {
        "flight_overlaps": (i.size, "pairs of flights that are in the air together"),
        "flights_alike": (int(np.count_nonzero(alike)), "pairs of flights that are the same"),
        "pairs": (particles * (particles - 1) // 2, "pairs of particles"),
        "pairs_crossing": (meeting.size, "pairs of particles that cross"),
    }
    return table(
        "crossing",
        time=(time[chosen], "time of crossing", "s"),
        height=(height[chosen], "height of crossing", "m"),
        first=(first[chosen], "particle whose flight began earlier"),
        second=(second[chosen], "particle whose flight began later"),
    ).assign({name: variable((), *count) for name, count in counts.items()})


def _overlapping(flown: Flights) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of flights of different particles in the air together, the earlier one first."""
    index = np.arange(flown.start.size)
    beyond = np.searchsorted(flown.start, flown.end, side="left")
    count = np.maximum(beyond - index - 1, 0)
    i = np.repeat(index, count)
    j = i + 1 + (np.arange(i.size) - np.repeat(np.cumsum(count) - count, count))
    other = flown.particle[i] != flown.particle[j]
    return i[other], j[other]
