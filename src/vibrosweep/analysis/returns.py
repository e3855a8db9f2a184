"""The return map: each speed of arrival against the previous one."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis.base_motion import moves
from vibrosweep.analysis.record_flights import arrival_speeds, restitutions
from vibrosweep.analysis.records import table, variable
from vibrosweep.analysis.requirements import require
from vibrosweep.arrays import Array
from vibrosweep.store.arranged import arranged

__all__ = ["return_map", "return_points"]


def return_map(record: xr.Dataset, *, realization: int = 0, since: float = 0.0) -> xr.Dataset:
    """Pairs of successive speeds of arrival of all particles of one realization.

    Parameters
    ----------
    record
        Record of every landing, as `simulate` returns it.
    realization
        Its position in the record.
    since
        Landings from this time on, in s, are taken.

    Returns
    -------
    xarray.Dataset
        Dim ``point``: ``arrival_speed``, ``next_arrival_speed``, ``kick`` = w - e v (m s-1), where
        w is the speed of lift-off, ``landing_time`` (s), ``particle`` and ``rested``.  Under the
        law `rest` the kick is at most A in size where the particle did not rest: the points lie
        in a strip of slope e, whose half-width is A over the high-bounce base and A + 2 V0 over a
        moving one (derived in `vibrosweep.theory.liftoff_speed_bound`).

    Raises
    ------
    DataError
        The record lacks a variable.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import return_map
    >>> points = return_map(vs.simulate(launch_time=[0.0, 0.125]))
    >>> bool((abs(points.kick.where(points.rested == 0).dropna("point")) <= 1.2).all())
    True
    """
    record = arranged(record)
    needed = ("landing_time", "rebound_velocity", "launch_velocity", "restitution", "rested")
    require(record, "return_map", *needed)
    one = record.isel(realization=realization)
    before, after, known = return_points(one)
    time, leaving = one["landing_time"].values, one["rebound_velocity"].values
    known &= time >= since
    # over a moving base a particle may still be rising when it lands
    kept = restitutions(one, np.abs(before[known])) * before[known]
    rested = variable(
        "point",
        one["rested"].values[known],
        "the particle rested between the two",
        flag_values=np.array([0, 1], np.int8),
        flag_meanings="bounced rested",
    )
    return table(
        "point",
        arrival_speed=(before[known], "velocity of arrival, downwards", "m s-1"),
        next_arrival_speed=(after[known], "next velocity of arrival, downwards", "m s-1"),
        kick=(leaving[known] - kept, "kick w - e v", "m s-1"),
        landing_time=(time[known], "time of landing", "s"),
        particle=(np.nonzero(known)[0], "particle"),
    ).assign(rested=rested)


def return_points(one: xr.Dataset) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Speeds of arrival at each landing and at the next (m s-1), and where both are known.

    Each array has the shape (particle, impact).  Over the high-bounce base a flight lands as fast
    as it began, so that the next speed of arrival is known for the last landing too.
    """
    before, after = arrival_speeds(one, "return_map"), one["rebound_velocity"].values
    if moves(one):
        after = np.concatenate([before[:, 1:], np.full_like(before[:, :1], np.nan)], axis=1)
    return before, after, np.isfinite(before) & np.isfinite(after)
