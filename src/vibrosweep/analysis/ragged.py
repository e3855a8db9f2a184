"""Conversion of a ragged record to a rectangle."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr

from vibrosweep.analysis.requirements import require
from vibrosweep.errors import DataError
from vibrosweep.model.measures import (
    LANDING,
    OF_TRAJECTORIES,
    RAGGED_DIMS,
    RECORD,
    SAMPLES,
    counts_agree,
    padded,
)
from vibrosweep.store.arranged import arranged

__all__ = ["rectangle"]

SOURCES: Final = "simulate(..., ragged=True), or of a sweep with ragged = true in [record]"


def rectangle(record: xr.Dataset) -> xr.Dataset:
    """Return a ragged record as a rectangle, padded to the most impacts of any particle.

    Parameters
    ----------
    record
        Result of ``simulate(..., ragged=True)``, or of `open_record` where the sweep file has
        ``ragged = true`` in its ``[record]``.

    Returns
    -------
    xarray.Dataset
        The record as `simulate` returns it without ``ragged``, with the dims (realization,
        particle, impact).

    Raises
    ------
    DataError
        The dataset is not a ragged record, or lacks landings.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> scene = {"launch_time": [0.0, 0.125], "amplitude": [1.2, 2.0]}
    >>> vs.rectangle(vs.simulate(**scene, ragged=True)).equals(vs.simulate(**scene))
    True
    """
    record = arranged(record)
    require(record, "rectangle", *RECORD, *OF_TRAJECTORIES, source=SOURCES)
    count = record["impact_count"].values
    if not counts_agree(count, record["landing_time"].values):
        landings = f"{record.sizes.get(LANDING)} landings where impact_count has {count.sum()}"
        raise DataError(f"rectangle takes whole records, and the dataset has {landings}")
    shape = tuple(int(record[name].max()) + 1 for name in OF_TRAJECTORIES)
    places = np.indices(shape).reshape(2, -1)
    held = [record[name].values for name in OF_TRAJECTORIES]
    sizes = (record.sizes.get("realization", 1), record.sizes.get("particle", shape[1]))
    if not np.array_equal(held, places) or sizes != shape:
        raise DataError(
            "rectangle takes whole records, with all realizations and particles in their order: "
            "select from the rectangle instead"
        )
    rectangles: dict[str, Any] = {}
    for dims, ragged in RAGGED_DIMS.items():
        names = [str(n) for n, one in record.data_vars.items() if one.dims == ragged]
        for name in (n for n in names if n not in OF_TRAJECTORIES):
            values = record[name].values
            values = padded(values, count) if ragged == (LANDING,) else values
            attributes = {k: v for k, v in record[name].attrs.items() if k != SAMPLES}
            rectangles[name] = (dims, values.reshape(*shape, *values.shape[1:]), attributes)
    return record.drop_vars([*rectangles, *OF_TRAJECTORIES]).assign(rectangles)


def as_rectangle(record: xr.Dataset) -> xr.Dataset:
    """Return a record as a rectangle, from either form."""
    return rectangle(record) if LANDING in record.dims else record
