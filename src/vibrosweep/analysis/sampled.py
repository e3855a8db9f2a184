"""Edges of a condition in an existing dataset, no more precise than its samples allow."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError

from vibrosweep.analysis.conditions import Condition, Locked, named
from vibrosweep.analysis.requirements import require
from vibrosweep.errors import DataError, ParameterError

__all__ = ["sampled_edges"]

Array = NDArray[np.float64]

PLANE: Final = ("restitution", "amplitude")


def sampled_edges(dataset: xr.Dataset, condition: str | Condition) -> xr.Dataset:
    """Brackets of the edges of a condition between neighbouring realizations.

    The samples are triangulated in the plane of restitution and amplitude, each scaled by its
    range.  Wherever the condition holds at one end of a side of a triangle and not at the other, an
    edge crosses that side.  Where it crosses is not known, and nothing is said between samples that
    agree: an edge may cross there twice.

    Parameters
    ----------
    dataset
        Result of a sweep in which nothing but restitution and amplitude varies.
    condition
        A name as in `conditions.NAMES` without ``locked(k)``, or a condition of one's own.

    Returns
    -------
    xarray.Dataset
        Dim edge: ``restitution_inside`` and ``amplitude_inside``, where the condition holds, and
        ``restitution_outside`` and ``amplitude_outside``, where it does not.  Dim realization:
        ``holds``, with restitution and amplitude as coordinates.

    Raises
    ------
    DataError
        The dataset lacks a variable that the condition reads, varies something else, or has fewer
        than three realizations that are not on a line.
    """
    chosen = named(condition) if isinstance(condition, str) else condition
    if isinstance(chosen, Locked):
        raise ParameterError(
            f"condition {chosen.name} is about an orbit, not about what a sweep measured: use "
            f"find_windows"
        )
    require(dataset, f"condition {chosen.name}", *PLANE)
    varied = [name for name in dataset.coords if dataset[name].dims == ("realization",)]
    other = [str(name) for name in varied if name not in (*PLANE, "realization")]
    if other or len(varied) < len(PLANE):
        wrong = f"{other[0]} varies too" if other else "they do not both vary"
        raise DataError(f"edges in the plane of restitution and amplitude: {wrong}")
    holds = chosen.judge(dataset)
    points = np.stack([np.asarray(dataset[name].values, np.float64) for name in PLANE], axis=-1)
    sides = _sides(points)
    sides = sides[holds[sides[:, 0]] != holds[sides[:, 1]]]
    inside = np.where(holds[sides[:, 0]], sides[:, 0], sides[:, 1])
    outside = np.where(holds[sides[:, 0]], sides[:, 1], sides[:, 0])
    return _dataset(dataset, chosen, points, holds, inside, outside)


def _sides(points: Array) -> NDArray[np.int64]:
    """Sides of the triangles, each once; shape (side, 2)."""
    try:
        triangles = Delaunay(points / np.ptp(points, axis=0)).simplices
    except (QhullError, ValueError) as error:
        raise DataError(
            "edges between samples need at least three realizations that are not on a line"
        ) from error
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    return np.asarray(np.unique(np.sort(sides, axis=1), axis=0), dtype=np.int64)


def _dataset(
    dataset: xr.Dataset,
    condition: Condition,
    points: Array,
    holds: NDArray[np.bool_],
    inside: NDArray[np.int64],
    outside: NDArray[np.int64],
) -> xr.Dataset:
    data: dict[str, Any] = {}
    for end, rows in (("inside", inside), ("outside", outside)):
        for column, name in enumerate(PLANE):
            words = {"units": dataset[name].attrs["units"], "long_name": f"{name} {end} the edge"}
            data[f"{name}_{end}"] = ("edge", points[rows, column], words)
    flags = {"flag_values": np.array([0, 1], np.int8), "flag_meanings": "fails holds"}
    words = {"long_name": f"condition {condition.name}", **flags}
    data["holds"] = ("realization", holds.astype(np.int8), words)
    coordinates = {
        name: dataset[name] for name in (*PLANE, "frequency", "gravity") if name in dataset.coords
    }
    title = f"Edges of the condition {condition.name} between samples"
    kept = {"rebound": dataset.attrs["rebound"]} if "rebound" in dataset.attrs else {}
    return xr.Dataset(data, coordinates, {"title": title, "condition": condition.name, **kept})
