"""Records without empty places: contiguous ragged arrays of the CF conventions, and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis.requirements import require
from vibrosweep.model.measures import RECORD, Variable

__all__ = ["rectangle"]

LANDING: Final = "landing"
SAMPLES: Final = "sample_dimension"
# Dims of a rectangle, and the one dim of a ragged record in their place
RAGGED_DIM: Final[Mapping[tuple[str, ...], str]] = {
    RECORD["landing_time"].dims: LANDING,
    RECORD["impact_count"].dims: "trajectory",
}
OF_TRAJECTORIES: Final = ("realization_index", "particle_index")
MOST_WASTED: Final = 2.0  # places for each landing


def ragged_variables(
    found: Mapping[str, NDArray[Any]],
    variables: Mapping[str, Variable],
    realizations: int,
    particles: int,
) -> dict[str, xr.Variable]:
    """Return the variables of a ragged record, whose landings stand one after the other."""
    places = np.divmod(np.arange(realizations * particles), particles)
    given = {
        name: xr.Variable(RAGGED_DIM.get(v.dims, v.dims), found[name].ravel(), v.attributes)
        for name, v in variables.items()
    }
    given["impact_count"].attrs[SAMPLES] = LANDING
    words = ("position of the realization", "number of the particle")
    return given | {
        name: xr.Variable("trajectory", place, {"long_name": text, "units": "1"})
        for name, place, text in zip(OF_TRAJECTORIES, places, words, strict=True)
    }


def wasted(count: NDArray[np.int64]) -> str:
    """Return a remark if more than half of the places of a rectangle are empty, else ""."""
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
    rectangles: dict[str, Any] = {}
    for dims, ragged_dim in RAGGED_DIM.items():
        names = [n for n, one in record.data_vars.items() if one.dims == (ragged_dim,)]
        for name in (str(n) for n in names if n not in OF_TRAJECTORIES):
            values = record[name].values
            if ragged_dim == LANDING:
                empty = np.nan if values.dtype.kind == "f" else 0
                full = np.full(there.shape, empty, values.dtype)
                full[there] = values
                values = full
            attributes = {k: v for k, v in record[name].attrs.items() if k != SAMPLES}
            rectangles[name] = (dims, values.reshape(*shape, *values.shape[1:]), attributes)
    return record.drop_vars([*rectangles, *OF_TRAJECTORIES]).assign(rectangles)
