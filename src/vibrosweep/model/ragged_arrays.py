"""Records without empty places: contiguous ragged arrays of the CF conventions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.model.measures import RECORD, Variable

IN_FILE: Final = "record"  # the group of a result file that holds a record
LANDING: Final = "landing"
SAMPLES: Final = "sample_dimension"
# Dims of a rectangle, and those of a ragged record in their place
RAGGED_DIMS: Final[Mapping[tuple[str, ...], tuple[str, ...]]] = {
    RECORD["landing_time"].dims: (LANDING,),
    RECORD["impact_count"].dims: ("trajectory",),
}
# Variables that say which trajectory is which, with their meaning
OF_TRAJECTORIES: Final[Mapping[str, str]] = {
    "realization_index": "position of the realization",
    "particle_index": "number of the particle",
}
MOST_WASTED: Final = 2.0  # places for each landing

Column = tuple[tuple[str, ...], NDArray[Any], dict[str, Any]]  # dims, values, attributes


def ragged_columns(
    found: Mapping[str, NDArray[Any]],
    variables: Mapping[str, Variable],
    particles: int,
    prefix: str = "",
) -> dict[str, Column]:
    """Return the columns of a ragged record, whose landings stand one after the other.

    The attribute of the counts that names the dimension of landings begins with `prefix`.
    """
    places = np.divmod(np.arange(found["impact_count"].size), particles)
    of_trajectories = RAGGED_DIMS[RECORD["impact_count"].dims]
    columns: dict[str, Column] = {
        name: (of_trajectories, place, {"long_name": text, "units": "1"})
        for (name, text), place in zip(OF_TRAJECTORIES.items(), places, strict=True)
    }
    for name, variable in variables.items():
        dims, attributes = RAGGED_DIMS.get(variable.dims, variable.dims), {**variable.attributes}
        if name == "impact_count":
            attributes[SAMPLES] = f"{prefix}{LANDING}"
        columns[name] = dims, found[name].ravel(), attributes
    return columns


def whole(count: NDArray[np.int64], *of_landings: NDArray[Any]) -> bool:
    """Tell whether ragged arrays hold as many landings as the counts of their trajectories say."""
    total = int(count.sum())
    return bool((count >= 0).all()) and all(values.shape == (total,) for values in of_landings)


def padded(values: NDArray[Any], count: NDArray[np.int64]) -> NDArray[Any]:
    """Return a ragged array as a rectangle of shape (trajectory, impact), empty past the last."""
    there = np.arange(count.max(initial=0)) < count[:, np.newaxis]
    full = np.full(there.shape, np.nan if values.dtype.kind == "f" else 0, values.dtype)
    full[there] = values
    return full


def wasted(count: NDArray[np.int64], remedy: str) -> str:
    """Return a remark if more than half of the places of a rectangle are empty, else ""."""
    places, landings = count.size * int(count.max(initial=0)), int(count.sum())
    if places <= MOST_WASTED * landings:
        return ""
    return (
        f"{1.0 - landings / places:.0%} of the {places} places are empty, since particles land "
        f"{landings / count.size:.3g} times on average and {count.max()} at most: {remedy} "
        f"leaves them out"
    )
