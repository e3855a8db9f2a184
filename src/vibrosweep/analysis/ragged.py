"""Records without empty places: contiguous ragged arrays of the CF conventions, and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis.requirements import require
from vibrosweep.model.measures import RECORD

__all__ = ["rectangle"]

LANDING: Final = "landing"
OF_TRAJECTORIES: Final = ("realization_index", "particle_index")
MOST_WASTED: Final = 2.0  # places for each landing


def ragged_variables(
    found: Mapping[str, NDArray[Any]], realizations: int, particles: int
) -> dict[str, xr.Variable]:
    """Return the variables of a ragged record, whose landings stand one after the other."""
    places = np.divmod(np.arange(realizations * particles), particles)
    variables = {
        name: xr.Variable(
            LANDING if "impact" in v.dims else "trajectory", found[name].ravel(), v.attributes
        )
        for name, v in RECORD.items()
    }
    variables["impact_count"].attrs["sample_dimension"] = LANDING
    words = ("position of the realization", "number of the particle")
    return variables | {
        name: xr.Variable("trajectory", place, {"long_name": text, "units": "1"})
        for name, place, text in zip(OF_TRAJECTORIES, places, words, strict=True)
    }


def wasted(count: NDArray[np.int64]) -> str:
    """Say how many places of a rectangle are empty where that is more than half; else empty."""
    places, landings = count.size * int(count.max(initial=0)), int(count.sum())
    if places <= MOST_WASTED * landings:
        return ""
    return (
        f"{1.0 - landings / places:.0%} of the {places} places are empty, since particles land "
        f"{landings / count.size:.3g} times on average and {count.max()} at most: ragged=True "
        f"leaves them out"
    )


def rectangle(record: xr.Dataset) -> xr.Dataset:
    """Return a ragged record as a rectangle, in which every particle has as many places.

    Parameters
    ----------
    record
        Result of ``simulate(..., ragged=True)``.

    Returns
    -------
    xarray.Dataset
        As of `simulate`, with the dims (realization, particle, impact).

    Raises
    ------
    DataError
        The dataset is no ragged record.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> scene = {"launch_time": [0.0, 0.125], "amplitude": [1.2, 2.0]}
    >>> vs.rectangle(vs.simulate(**scene, ragged=True)).equals(vs.simulate(**scene))
    True
    """
    require(record, "rectangle", *RECORD, *OF_TRAJECTORIES, source="simulate(..., ragged=True)")
    shape = tuple(int(record[name].values[-1]) + 1 for name in OF_TRAJECTORIES)
    count = record["impact_count"].values
    there = np.arange(count.max(initial=0)) < count[:, np.newaxis]
    own: dict[str, Any] = {}
    for name, variable in RECORD.items():
        values = record[name].values
        if "impact" in variable.dims:
            empty = np.nan if values.dtype.kind == "f" else 0
            full = np.full(there.shape, empty, values.dtype)
            full[there] = values
            values = full
        own[name] = (variable.dims, values.reshape(*shape, *values.shape[1:]), variable.attributes)
    kept = record.drop_vars([*RECORD, *OF_TRAJECTORIES])
    return kept.assign(own)
