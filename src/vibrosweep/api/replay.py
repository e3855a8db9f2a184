"""Realizations of a sweep, to be followed again landing by landing."""

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


def replayed(result: xr.Dataset, keywords: Mapping[str, Any]) -> tuple[Scene, dict[str, Array]]:
    """Return the scene of a sweep, and the parameters that vary, as `batch` does of keywords.

    Raises a ParameterError where there are keywords other than measures, a SpecError for measures
    that cannot be had, a DataError where the dataset is no sweep or lacks some of it, and gives an
    `OtherKernelsWarning` where other code has computed it.
    """
    keywords = {name: value for name, value in keywords.items() if value is not None}
    if others := keywords.keys() - MEASURES.keys():
        raise ParameterError(
            f"{', '.join(sorted(others))}: not beside a result, whose realizations are followed as "
            f"its sweep followed them; give keywords alone for other scenes"
        )
    if result.attrs.get(KIND) != SWEEP.name or "sweep_file" not in result.attrs:
        raise DataError(
            "the dataset is no result of vibrosweep.sweep, run or open_sweep, or has lost its "
            "attributes: give one, or realizations of one, such as found.isel(realization=7)"
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
            f"{', '.join(lost)}: incomplete in the dataset; select realizations of the whole "
            f"result, and particles of what simulate returns"
        )
    if result.attrs.get(KERNELS) != sources_digest():
        warnings.warn(
            "other code of vibrosweep, or of numba, has computed this result: what is followed now "
            "may differ in the last bits, and after many irregular impacts altogether",
            OtherKernelsWarning,
            stacklevel=3,
        )
    spread = xr.broadcast(*(result[name] for name in names))
    values = {
        name: np.array(one.values, dtype=np.float64).ravel()
        for name, one in zip(names, spread, strict=True)
    }
    judged = ((name, values[name]) for name in names if name in INPUTS)
    if wrong := [name for name, given in judged if not INPUTS[name].accepts(given).all()]:
        raise DataError(f"{', '.join(wrong)}: changed in the dataset to what no sweep computes")
    fixed = scene.inputs
    return scene, {
        name: given
        for name, given in values.items()
        if result[name].ndim or fixed.get(name) != given[0]
    }
