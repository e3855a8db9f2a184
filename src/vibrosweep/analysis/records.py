"""What analyses of single landings share: parameters per realization, flights, CF variables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis.requirements import require

__all__ = ["FLIGHTS", "Array", "Flights", "flights", "per_realization", "variable"]

Array = NDArray[np.float64]

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
    """Flights of all particles of one realization, in the order of their beginnings.

    Attributes
    ----------
    particle
        Whose flight it is.
    start, end
        s; a flight in progress at the end of the observation ends there.
    velocity
        Speed at its beginning, m s-1.
    """

    particle: NDArray[np.int64]
    start: Array
    end: Array
    velocity: Array


def per_realization(dataset: xr.Dataset, name: str) -> Array:
    """Values of a parameter, one per realization, whether or not it differs between them."""
    values = np.asarray(dataset[name].values, dtype=np.float64)
    return np.broadcast_to(values, (dataset.sizes["realization"],))


def variable(
    dims: Sequence[str],
    values: object,
    long_name: str,
    units: str = "1",
    **attributes: object,
) -> xr.Variable:
    """One variable with its CF attributes."""
    return xr.Variable(tuple(dims), values, {"long_name": long_name, "units": units, **attributes})


def flights(record: xr.Dataset, realization: int, analysis: str) -> Flights:
    """Flights of one realization of a record, the first ones from the launch among them.

    Parameters
    ----------
    record
        Record of every landing, as `simulate` returns it.
    realization
        Which, by position.
    analysis
        What the user asked for, as an error message names it.

    Raises
    ------
    DataError
        The record lacks a variable.
    """
    require(record, analysis, *FLIGHTS)
    one = record.isel(realization=realization)
    landing = one["landing_time"].values
    particles = landing.shape[0]
    column = np.ones((particles, 1))
    gravity = per_realization(record, "gravity")[realization]
    speed = per_realization(record, "launch_velocity")[realization]
    launch = np.broadcast_to(one["launch_time"].values, (particles,))[:, np.newaxis]
    start = np.concatenate([launch, one["liftoff_time"].values], axis=1)
    velocity = np.concatenate([speed * column, one["rebound_velocity"].values], axis=1)
    end = np.concatenate([landing, np.nan * column], axis=1)
    end = np.where(np.isnan(end), start + 2.0 * velocity / gravity, end)
    until = per_realization(record, "duration")[realization]
    flies = (start < until) & (velocity > 0.0)  # False where the particle rests for good
    particle = np.broadcast_to(np.arange(particles)[:, np.newaxis], start.shape)[flies]
    order = np.argsort(start[flies], kind="stable")
    return Flights(
        particle[order],
        start[flies][order],
        np.minimum(end[flies][order], until),
        velocity[flies][order],
    )
