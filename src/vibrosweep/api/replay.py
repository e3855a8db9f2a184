"""Realizations of a sweep, followed again landing by landing."""

from __future__ import annotations

import tomllib
import warnings
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.errors import DataError, OtherKernelsWarning, ParameterError
from vibrosweep.kernels._jit import sources_digest
from vibrosweep.mistakes import PYTHON, Mistakes
from vibrosweep.model.forcing import FORCINGS, INPUTS, inputs_of
from vibrosweep.model.measures import MEASURES
from vibrosweep.model.parameters import NOISE, STREAM
from vibrosweep.model.restitution_laws import speed_mistakes
from vibrosweep.model.status import Status
from vibrosweep.runs.result import KERNELS, attributes_of_scene
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import checked
from vibrosweep.store.arranged import REALIZATION, require_dataset
from vibrosweep.store.kinds import KIND, SWEEP
from vibrosweep.store.rows import flat

SAME_TIME: Final = 1e-9  # forcing periods; a landing may fall on the beginning of the window
ATTRIBUTES: Final = ("base", "rebound", "waveform", "restitution_law")


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
    spec = checked(data, "", None, Mistakes(dialect=PYTHON, given=keywords))
    scene, forcing = spec.scene, str(result.attrs["forcing"])
    result = _with_results(result)
    held = [n for n in INPUTS if n in result.variables and n not in FORCINGS.keys() - {forcing}]
    sampled = spec.design.sampled
    stated = {*scene.given, *sampled} - {*FORCINGS, *NOISE} | {*scene.noise(sampled)}
    names = inputs_of([forcing, *held, *stated], scene.base)
    names = (*names, STREAM) if not NOISE.keys().isdisjoint(names) else names
    particles = result["launch_time"].size if "launch_time" in result else scene.particles
    lost = [name for name in names if name not in result.variables]
    lost += [] if particles == scene.particles else ["launch_time"]
    lost += speed_mistakes(scene.restitution_law, names)
    lost += [] if STREAM in names or "noise_seed" not in result.attrs else NOISE
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
    size = result.sizes[REALIZATION]
    values = {
        name: np.array(np.broadcast_to(result[name].values, size), dtype=np.float64)
        for name in names
    }
    physical = ((name, values[name]) for name in names if name in INPUTS)
    if wrong := [name for name, given in physical if not INPUTS[name].accepts(given).all()]:
        raise DataError(
            f"{', '.join(wrong)}: changed in the dataset to values that are not allowed"
        )
    same = attributes_of_scene(scene, names)
    if wrong := [n for n in ATTRIBUTES if result.attrs.get(n, same[n]) != same[n]]:
        raise DataError(f"{', '.join(wrong)}: the attributes differ from those of the sweep file")
    fixed = scene.inputs
    return scene, {
        name: given
        for name, given in values.items()
        if result[name].ndim or fixed.get(name) != given[0]
    }


def _with_results(result: xr.Dataset) -> xr.Dataset:
    """Return a sweep along one dim, without the realizations that a mask hides."""
    masked = "status" in result and result["status"].dtype.kind == "f"
    result = flat(result)
    if not masked:
        return result
    kept = np.flatnonzero(result["status"].values != Status.REFUSED)
    if not kept.size:
        raise DataError("the mask hides every realization of the dataset: there is none to follow")
    return result.isel({REALIZATION: kept})


def require_same_counts(result: xr.Dataset, record: Mapping[str, NDArray[Any]]) -> None:
    """Raise a DataError if realizations landed more or fewer times than in their sweep.

    They do if the dataset combines sweeps of different scenes, of which it states one.  Landings
    of other kernels may differ; then nothing is compared.
    """
    if result.attrs.get(KERNELS) != sources_digest() or "impact_count" not in result:
        return
    result = _with_results(result)
    count, size = record["impact_count"], result.sizes[REALIZATION]
    if len(count) != size:
        return
    times = record["landing_time"].ravel()
    times = times[~np.isnan(times)]
    owner = np.repeat(np.arange(count.size) // count.shape[1], count.ravel())
    windows = result["transient"].values if "transient" in result else -np.inf
    begin = np.broadcast_to(windows, size)
    blur = SAME_TIME / np.broadcast_to(result["frequency"].values, size)
    fewest, most = (
        np.bincount(owner[times >= (begin + apart)[owner]], minlength=size)
        for apart in (blur, -blur)
    )
    stored, status = result["impact_count"].values, result["status"].values
    wrong = (status == Status.COMPLETED) & ((stored < fewest) | (stored > most))
    if wrong.any():
        raise DataError(
            f"{np.count_nonzero(wrong)} of {size} realizations do not land as often as in their "
            f"sweep: the dataset states the scene of other realizations, as after xarray.concat; "
            f"follow those of each sweep alone"
        )
