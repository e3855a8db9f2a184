"""Tools of analyses of records: parameters per realization, flights, CF variables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis.record_flights import base_motion, course
from vibrosweep.analysis.requirements import differing, require
from vibrosweep.arrays import Array
from vibrosweep.errors import DataError
from vibrosweep.model.measures import Status

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


def completed(sweep: xr.Dataset) -> NDArray[np.bool_]:
    """Return for each realization whether all its particles were followed to the end."""
    if "status" not in sweep.variables:
        return np.ones(sweep.sizes["realization"], np.bool_)
    return np.asarray(per_realization(sweep, "status") == Status.COMPLETED)


def variable(
    dims: Sequence[str], values: object, long_name: str, units: str = "1", **attributes: object
) -> xr.Variable:
    """Return a variable with its CF attributes."""
    return xr.Variable(dims, values, {"long_name": long_name, "units": units, **attributes})


def table(dim: str, **columns: tuple[Any, ...]) -> xr.Dataset:
    """Return a dataset along one dim, each column with values, a long name and, if any, units."""
    return xr.Dataset({name: variable(dim, *column) for name, column in columns.items()})


def equal_parts(
    sweep: xr.Dataset, parameter: str, bins: int, analysis: str, fewest: int = 1
) -> tuple[list[NDArray[np.bool_]], dict[str, xr.Variable]]:
    """Bins of a parameter that hold equally many realizations: the members of each, and its ends.

    The ends are coordinates along the dim ``part``.  Raises a DataError that names the `analysis`
    if the parameter takes too few values for the `fewest` bins.  Realizations without results, as
    behind a mask, belong to no bin.
    """
    values = per_realization(sweep, parameter)
    held = np.isfinite(values)
    if "status" in sweep.variables:
        held &= sweep["status"].values != Status.REFUSED
    levels = np.linspace(0.0, 1.0, bins + 1)
    edges = np.unique(np.quantile(values[held], levels)) if held.any() else np.empty(0)
    if edges.size <= fewest:
        raise DataError(f"{analysis} needs {differing(parameter)}")
    part = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, edges.size - 2)
    units = str(sweep[parameter].attrs.get("units", "1"))
    ends = {
        f"{parameter}_low": variable("part", edges[:-1], f"lower end, {parameter}", units),
        f"{parameter}_high": variable("part", edges[1:], f"upper end, {parameter}", units),
    }
    return [held & (part == i) for i in range(edges.size - 1)], ends


def flights(record: xr.Dataset, realization: int, analysis: str) -> Flights:
    """Flights of one realization of a record, including those that begin at the launches.

    Raises a DataError that names the `analysis` where the record lacks a variable.
    """
    require(record, analysis, *FLIGHTS)
    one = record.isel(realization=realization)
    rows = course(one, base_motion(one, analysis), float(one["duration"]))
    chosen = np.flatnonzero(rows.flies)
    order = chosen[np.argsort(rows.start.ravel()[chosen], kind="stable")]
    fields = (rows.start, rows.end, rows.velocity, rows.height)
    particle = order // rows.start.shape[1]
    return Flights(particle, *(values.ravel()[order] for values in fields))
