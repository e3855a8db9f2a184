"""Records without padding: contiguous ragged arrays of the CF conventions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.model.measures import RECORD, Variable

IN_FILE: Final = "record"  # the group of a result file that holds a record
LANDING: Final = "landing"
SAMPLES: Final = "sample_dimension"
# Dims of a rectangle, and the dims of a ragged record that replace them
RAGGED_DIMS: Final[Mapping[tuple[str, ...], tuple[str, ...]]] = {
    RECORD["landing_time"].dims: (LANDING,),
    RECORD["impact_count"].dims: ("trajectory",),
}
# Variables that identify trajectories, with their meaning
OF_TRAJECTORIES: Final[Mapping[str, str]] = {
    "realization_index": "position of the realization",
    "particle_index": "number of the particle",
}
MOST_WASTED: Final = 2.0  # places per landing

Column = tuple[tuple[str, ...], NDArray[Any], dict[str, Any]]  # dims, values, attributes


def ragged_columns(
    found: Mapping[str, NDArray[Any]],
    variables: Mapping[str, Variable],
    particles: int,
    prefix: str = "",
) -> dict[str, Column]:
    """Return the columns of a ragged record, with all landings in one list.

    An attribute of the counts names the dimension of landings, with `prefix` before it.
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


def counts_agree(count: NDArray[np.int64], *of_landings: NDArray[Any]) -> bool:
    """Return whether ragged arrays hold as many landings as the counts of trajectories say."""
    total = int(count.sum())
    return bool((count >= 0).all()) and all(values.shape == (total,) for values in of_landings)


def padded(values: NDArray[Any], count: NDArray[np.int64]) -> NDArray[Any]:
    """Return a ragged array as a padded rectangle of shape (trajectory, impact)."""
    filled = np.arange(count.max(initial=0)) < count[:, np.newaxis]
    rectangle = np.full(filled.shape, np.nan if values.dtype.kind == "f" else 0, values.dtype)
    rectangle[filled] = values
    return rectangle


def wasted(count: NDArray[np.int64], remedy: str) -> str:
    """Return a remark if more than half of the places of a rectangle are empty, else ""."""
    places, landings = count.size * int(count.max(initial=0)), int(count.sum())
    if places <= MOST_WASTED * landings:
        return ""
    return (
        f"{1.0 - landings / places:.0%} of the {places} places are empty, because particles land "
        f"{landings / count.size:.3g} times on average but up to {count.max()} times: {remedy} "
        f"leaves them out"
    )
