"""Realizations of a sweep, followed again landing by landing."""

from __future__ import annotations

import tomllib
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from vibrosweep.arrays import Array
from vibrosweep.errors import DataError, OtherKernelsWarning, ParameterError
from vibrosweep.kernels._jit import sources_digest
from vibrosweep.mistakes import PYTHON, Mistakes
from vibrosweep.model.forcing import INPUTS, inputs_of
from vibrosweep.model.measures import MEASURES
from vibrosweep.model.mount import MASSES
from vibrosweep.model.parameters import NOISE, STREAM
from vibrosweep.runs.result import KERNELS
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import checked
from vibrosweep.store.kinds import KIND, SWEEP
from vibrosweep.store.rows import require_dataset


def replayed(result: xr.Dataset, keywords: Mapping[str, Any]) -> tuple[Scene, dict[str, Array]]:
    """Return the scene of a sweep and the parameters that vary, as `batch` does for keywords.

    Raises a ParameterError for keywords other than measures, a SpecError for measures that cannot
    be computed, and a DataError for anything but a dataset of a sweep, or realizations of it, with
    all its inputs; issues an `OtherKernelsWarning` if another version of the code computed it.
    """
    require_dataset(result)
    keywords = {name: value for name, value in keywords.items() if value is not None}
    if others := keywords.keys() - MEASURES.keys():
        raise ParameterError(
            f"{', '.join(sorted(others))}: cannot be given beside a result, whose realizations are "
            f"followed as in its sweep; give keywords alone for other scenes"
        )
    if result.attrs.get(KIND) != SWEEP.name or "sweep_file" not in result.attrs:
        raise DataError(
            "the dataset is not a result of vibrosweep.sweep, run or open_sweep, or has lost its "
            "attributes: give such a result, or realizations of it: found.isel(realization=7)"
        )
    data = tomllib.loads(str(result.attrs["sweep_file"]))
    data["measure"] = {**data.get("measure", {}), **keywords}
    scene = checked(data, "", None, Mistakes(dialect=PYTHON, given=keywords)).scene
    masses = [name for name in MASSES if name in result.variables]
    noise = [name for name in NOISE if name in result.variables]
    names = inputs_of([str(result.attrs["forcing"]), *masses, *noise], scene.base)
    names = (*names, STREAM) if noise else names
    particles = result["launch_time"].size if "launch_time" in result else scene.particles
    lost = [name for name in names if name not in result.variables]
    lost += [] if particles == scene.particles else ["launch_time"]
    if lost:
        raise DataError(
            f"{', '.join(lost)}: incomplete in the dataset; select realizations only, and select "
            f"particles from the result of simulate"
        )
    if result.attrs.get(KERNELS) != sources_digest():
        warnings.warn(
            "another version of vibrosweep or numba has computed this result: landings may differ "
            "from it in the last bits, and completely after many impacts of an irregular motion",
            OtherKernelsWarning,
            stacklevel=3,
        )
    spread = xr.broadcast(*(result[name] for name in names))
    values = {
        name: np.array(one.values, dtype=np.float64).ravel()
        for name, one in zip(names, spread, strict=True)
    }
    physical = ((name, values[name]) for name in names if name in INPUTS)
    if wrong := [name for name, given in physical if not INPUTS[name].accepts(given).all()]:
        raise DataError(
            f"{', '.join(wrong)}: changed in the dataset to values that are not allowed"
        )
    fixed = scene.inputs
    return scene, {
        name: given
        for name, given in values.items()
        if result[name].ndim or fixed.get(name) != given[0]
    }
