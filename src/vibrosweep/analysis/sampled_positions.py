"""Heights of particles and of the base at any times, from a record of landings."""

from __future__ import annotations

from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from vibrosweep.analysis.base_motion import BaseMotion
from vibrosweep.analysis.record_flights import base_motion, course
from vibrosweep.analysis.records import FLIGHTS, variable
from vibrosweep.analysis.requirements import require
from vibrosweep.arrays import Array
from vibrosweep.errors import DataError, ParameterError
from vibrosweep.model.measures import Status
from vibrosweep.model.parameters import as_numbers
from vibrosweep.store.arranged import arranged

__all__ = ["positions"]

OF_SCENE: Final = ("base", "rebound", "waveform", "restitution_law")  # attributes that are kept


def positions(record: xr.Dataset, times: ArrayLike) -> xr.Dataset:
    """Height of every particle and of the base at any times.

    Between landings a particle follows its parabola, and while it rests it follows the base:
    nothing is interpolated.  Uses are films, spectra and comparison with a camera.

    Parameters
    ----------
    record
        Record of every landing, as `simulate` and `open_record` return it.
    times
        One-dimensional, in s, in any order, up to the end of the record.

    Returns
    -------
    xarray.Dataset
        Dims ``realization``, ``particle`` and ``time``: ``height`` (m); dims ``realization`` and
        ``time``: ``base_height`` (m), which is 0 over base ``"high-bounce"``.  The height of a
        particle is NaN before its launch, and after it was given up (`Status`).

    Raises
    ------
    ParameterError
        A time is not finite, or there is more than one dimension.
    DataError
        The record lacks a variable, or ends before one of the times.

    Examples
    --------
    >>> import numpy as np, vibrosweep as vs
    >>> film = vs.positions(vs.simulate(launch_time=[0.0, 0.125]), np.arange(0.0, 12.0, 1 / 240))
    >>> film.height.dims, float(film.height.sel(time=0.5).isel(particle=0, realization=0))
    (('realization', 'particle', 'time'), 1.27375)
    """
    instants = as_numbers("times", times)
    if instants.ndim != 1 or not np.all(np.isfinite(instants)):
        raise ParameterError("times: a list of finite times in s is expected")
    record = arranged(record)
    require(record, "positions", *FLIGHTS, "rested", "status")
    end = float(record["duration"].min())
    if np.any(instants > end):
        raise DataError(
            f"positions: the record ends at {end:g} s, and the last of the times is "
            f"{float(instants.max()):g} s; simulate it with a longer duration"
        )
    heights, levels = [], []
    for realization in range(record.sizes["realization"]):
        one = record.isel(realization=realization)
        base = base_motion(one, "positions")
        levels.append(base.height(instants))
        heights.append(_heights(one, base, levels[-1], instants))
    dims = ("realization", "particle", "time")
    kept = {n: c for n, c in record.coords.items() if set(c.dims) <= {"realization", "particle"}}
    return xr.Dataset(
        {
            "height": variable(dims, np.array(heights), "height of the particle", "m"),
            "base_height": variable(dims[::2], np.array(levels), "height of the base", "m"),
        },
        {**kept, "time": variable(("time",), instants, "time", "s")},
        {name: record.attrs[name] for name in OF_SCENE if name in record.attrs},
    )


def _heights(one: xr.Dataset, base: BaseMotion, levels: Array, times: Array) -> Array:
    """Height of each particle of one realization, (particle, time), where the base is at `levels`.

    After the landing of its latest flight a particle stays on the base until its next flight.
    """
    flights, gravity = course(one, base, np.inf), float(one["gravity"])
    followed = one["status"].values == Status.COMPLETED
    heights = np.full((followed.size, times.size), np.nan)
    for particle in np.flatnonzero(one["status"].values != Status.REFUSED):
        height = heights[particle]
        start = flights.start[particle]
        flight = np.searchsorted(start, times, side="right") - 1  # NaN come last
        last = np.count_nonzero(np.isfinite(start)) - 1
        since = times - start[flight]
        velocity, low = flights.velocity[particle, flight], flights.height[particle, flight]
        flies = (flight >= 0) & (times < flights.end[particle, flight])
        stays = (flight >= 0) & ~flies & (followed[particle] | (flight < last))
        height[stays] = levels[stays]
        height[flies] = (low + since * (velocity - 0.5 * gravity * since))[flies]
    return heights
