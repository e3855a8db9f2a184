"""Tools of analyses of records: parameters per realization, flights, CF variables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis.record_flights import base_motion, course
from vibrosweep.analysis.requirements import require
from vibrosweep.arrays import Array
from vibrosweep.errors import DataError

FLIGHTS = (
    "landing_time",
    "liftoff_time",
    "rebound_velocity",
    "launch_time",
    "launch_velocity",
    "gravity",
    "duration",
)


class Flights(NamedTuple):
    """Flights of all particles of one realization, in the order of their starts."""

    particle: NDArray[np.int64]  # number of the particle
    # start, end: s; a flight in progress at the end of the observation ends there
    start: Array
    end: Array
    velocity: Array  # at the start, m s-1
    height: Array  # of the base at the start, m


def per_realization(dataset: xr.Dataset, name: str) -> Array:
    """Return the values of a variable or parameter, one per realization, even if all are equal.

    Raises a DataError for a variable with several numbers per realization.
    """
    one = dataset[name]
    if one.dims not in ((), ("realization",)) or one.dtype.kind not in "iufb":
        particle = ", or a particle, as sweep.isel(particle=0)" if "particle" in one.dims else ""
        raise DataError(
            f"{name} holds {one.dtype} along {', '.join(map(str, one.dims)) or 'nothing'}: choose "
            f"a variable with one number for each realization{particle}"
        )
    values = np.asarray(one.values, dtype=np.float64)
    return np.broadcast_to(values, (dataset.sizes["realization"],))


def variable(
    dims: Sequence[str],
    values: object,
    long_name: str,
    units: str = "1",
    **attributes: object,
) -> xr.Variable:
    """Return a variable with its CF attributes."""
    return xr.Variable(tuple(dims), values, {"long_name": long_name, "units": units, **attributes})


def flights(record: xr.Dataset, realization: int, analysis: str) -> Flights:
    """Flights of one realization of a record, including those that begin at the launches.

    Raises a DataError that names the `analysis` where the record lacks a variable.
    """
    require(record, analysis, *FLIGHTS)
    one = record.isel(realization=realization)
    rows = course(one, base_motion(one, analysis), float(one["duration"]))
    particle = np.broadcast_to(np.arange(len(rows.start))[:, np.newaxis], rows.start.shape)
    chosen = np.flatnonzero(rows.flies)
    order = chosen[np.argsort(rows.start.ravel()[chosen], kind="stable")]
    fields = (rows.start, rows.end, rows.velocity, rows.height)
    return Flights(particle.ravel()[order], *(values.ravel()[order] for values in fields))
