"""Curves of bifurcations from a result of `vibrosweep.boundaries`, to draw over a plane."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from vibrosweep.errors import DataError
from vibrosweep.explore.labels import meanings
from vibrosweep.explore.points import Border, Points
from vibrosweep.store.reading import load_dataset, read_kind

if TYPE_CHECKING:
    import xarray as xr

BOUNDARIES: Final = "boundaries"
DASHES: Final = {"saddle node": "solid", "period doubling": "dashed", "corner": "solid"}
# Events at which rounding decides whether the orbit is admissible
TIES: Final = ("grazing", "rest", "grazing at landing")


def with_borders(points: Points, path: Path) -> Points:
    """Return the points with the curves from a file of boundaries.

    Raises a DataError if the file holds something else, or curves of another scene.
    """
    kind = read_kind(path)
    if kind.name != BOUNDARIES:
        raise DataError(f"{path}: is a result of {kind.command}; give one of vibrosweep boundaries")
    found = load_dataset(path)
    scene = points.base_choice.scene
    differs = "but that of the result is"
    for name, expected in (
        ("base", scene.base),
        ("rebound", scene.rebound),
        ("waveform", scene.waveform.text),
        ("restitution_law", scene.restitution_law),
    ):
        if found.attrs[name] != expected:
            raise DataError(f"{path}: its {name} is {found.attrs[name]!r}, {differs} {expected!r}")
    for name in ("frequency", "gravity"):
        values = points.columns[name].values if name in points.columns else scene.inputs[name]
        if np.any(np.asarray(values) != float(found[name])):
            raise DataError(
                f"{path}: its {name} is {float(found[name]):g}, but the result has another"
            )
    borders = tuple(_border(found.isel(curve=i)) for i in range(found.sizes["curve"]))
    return replace(points, borders=borders)


def _border(curve: xr.Dataset) -> Border:
    meaning = meanings(curve["bifurcation"].attrs)[int(curve["bifurcation"])]
    admissible = (curve["admissible"].values == 1) | (meaning in TIES)
    names = ("restitution", str(curve.attrs["forcing"]))
    values = {name: np.where(admissible, curve[name].values, np.nan) for name in names}
    p, q = int(curve["cycle_impacts"]), int(curve["cycle_periods"])
    name = f"{p} in {q} period{'s' if q > 1 else ''}: {meaning}"
    return Border(name, DASHES.get(meaning, "dotdash"), values)
