"""Every landing of a small scene, or of re-simulated realizations of a sweep."""

from __future__ import annotations

import tomllib
import warnings
from collections.abc import Mapping
from typing import Any, Final, Unpack

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.api.keyword_types import BatchKeywords, completed
from vibrosweep.arrays import Array
from vibrosweep.engine.landings import (
    BYTES_IN_MEMORY,
    Form,
    impacts,
    launch_times,
    record_landings,
    require_room,
)
from vibrosweep.engine.measure import measure_all
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import (
    DataError,
    OtherKernelsWarning,
    ParameterError,
    ShortObservationWarning,
)
from vibrosweep.kernels._jit import sources_digest
from vibrosweep.mistakes import PYTHON, Mistakes
from vibrosweep.model.forcing import (
    ACCELERATION,
    FORCINGS,
    INPUTS,
    inputs_of,
    only_parameters,
    refuse_extreme,
)
from vibrosweep.model.measures import (
    ALWAYS,
    IMPACTS,
    MEASURES,
    RECORD,
    Status,
    ragged_columns,
    wasted,
)
from vibrosweep.model.parameters import NOISE, STREAM
from vibrosweep.model.restitution_laws import VISCOELASTIC, speed_mistakes
from vibrosweep.runs.driver import thread_count
from vibrosweep.runs.result import (
    KERNELS,
    LAUNCH_TIME,
    NEVER_REPEATS,
    attributes_of,
    attributes_of_scene,
    long_launch,
    short_observation,
    still_base,
    strong_forcing,
)
from vibrosweep.scene.keys import SECTIONS
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import batch, checked
from vibrosweep.store.arranged import REALIZATION, flat, require_dataset
from vibrosweep.store.reading import KIND, SWEEP

__all__ = ["simulate"]


@completed(by=BatchKeywords)
def simulate(
    result: xr.Dataset | None = None,
    /,
    *,
    ragged: bool = False,
    threads: int | None = None,
    **keywords: Unpack[BatchKeywords],
) -> xr.Dataset:
    """Compute every landing of a small scene, or of realizations of a sweep.

    Parameters
    ----------
    result
        Instead of a scene, realizations of a sweep that `vibrosweep.sweep` or `open_sweep` returns:
        ``simulate(found.isel(realization=7))`` repeats the trajectories of the sweep, bit for bit
        on the same model of processor.  The only other keywords are then those of measures.
    ragged
        True to store landings one after the other along a single dim, without empty places (a
        contiguous ragged array of the CF conventions); `vibrosweep.rectangle` converts it back.
    threads
        Number of threads, by default all processors; the result does not depend on it.
    **keywords
        The scene and its measures, as for `vibrosweep.sweep`, except that a physical parameter is a
        number, or a list or 1-D array with one entry per realization; these are broadcast together.
        In addition, or with another meaning:

        launch_time
            Launch times in s: a number, or a list with one entry per particle; instead of
            ``particles`` and ``launch``.
        duration, duration_periods
            Landings up to this time are recorded: in s, 12 by default, or in forcing periods of
            each realization.
        noise_stream
            Stream of random numbers of each realization: a whole number, or a list with one entry
            per realization; by default their indices.
        impact_budget
            Number of landings after which a particle is abandoned, rounded up to a multiple of 6;
            its status says so.
        transient, transient_periods
            Beginning of the window of measures such as ``regimes`` and ``lyapunov``, which give the
            regime, the cycle and the exponents of each particle; landings are recorded from the
            launch on.

    Returns
    -------
    xarray.Dataset
        ==================================  =============================  =========================
        variable                            dims                           meaning
        ==================================  =============================  =========================
        ``landing_time`` (s)                realization, particle, impact  NaN past the last
                                                                           landing, as all of these
        ``liftoff_time`` (s)                realization, particle, impact  NaN too if the particle
                                                                           rests for good, or until
                                                                           more than a forcing
                                                                           period past the end
        ``rebound_velocity`` (m s-1)        realization, particle, impact  absolute velocity at
                                                                           lift-off
        ``rested``                          realization, particle, impact  whether the particle
                                                                           rested after the landing
        ``impact_phase`` (turns)            realization, particle, impact  phase of the forcing at
                                                                           the landing
        ``arrival_speed`` (m s-1)           realization, particle, impact  before the landing
        ``impact_count``, ``status``        realization, particle          landings; status of the
                                                                           computation
        ``regime``, ``cycle_periods``, ...  realization, particle          measures, as in a sweep
        ==================================  =============================  =========================

        The attribute ``notes`` says if particles were abandoned, if more than half of the
        places are empty, if the base is driven more strongly than any shaker could, and if
        the observation is too short for the regimes.  If `ragged`, the dim landing replaces
        (realization, particle, impact), and trajectory replaces (realization, particle),
        with ``realization_index`` and ``particle_index``.  Parameters that differ between
        realizations are coordinates, the others variables without dims.

    Raises
    ------
    SpecError
        Keywords are unknown, contradict each other, or have values that are not allowed; all
        mistakes are listed.
    ParameterError
        The forcing or the masses make a parameter too large, the record is too large, or keywords
        other than measures are given with a result.
    DataError
        The dataset is not a result of a sweep, or parts of it are missing.

    Warns
    -----
    OtherKernelsWarning
        The code that computed the result differs from the code that repeats it now.
    ShortObservationWarning
        Regimes are measured, and orbits may be called unsettled because the observation is too
        short.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.simulate(restitution=0.9, amplitude=1.2, launch_time=[0.0, 0.125])
    >>> found.landing_time.sel(particle=1).values[0, :2].round(6)
    array([1.144368, 2.254512])
    >>> orbit = vs.simulate(launch_time=0.125, duration_periods=2000, regimes=True)
    >>> orbit.cycle_periods.item(), float(orbit.impact_phase[0, 0, -1].round(6))
    (1, 0.432982)
    """
    if result is None:
        scene, arrays = batch(keywords, *SECTIONS["measure"])
    else:
        scene, arrays = replayed(result, keywords)
    chosen = {key: bool(keywords.get(key)) for key in MEASURES}
    chosen["impact_speed"] |= scene.restitution_law == VISCOELASTIC
    measured, scene = scene.with_measures(**chosen, observables=()), scene.recorded()
    asked = {v.name: v for v in measured.measures.variables if v not in ALWAYS}
    recorded = {**RECORD, **IMPACTS, **asked}
    require_room(max((v.size for v in arrays.values()), default=1), scene.particles)
    quantities = scene.timed(arrays)
    forcing, frequency = scene.forcing(), quantities["frequency"]
    refuse_extreme(quantities, forcing, scene.restitution_law)
    parameters = only_parameters(quantities)
    with Workers(thread_count(threads)) as workers:
        found = record_landings(parameters, scene, workers, Form(ragged, BYTES_IN_MEMORY))
        if result is not None:
            require_same_counts(result, found)
        found |= impacts(found, parameters, scene)
        if any(chosen.values()):
            found = measure_all(parameters, measured, workers) | found
    varied = scene.varying(arrays)
    fixed = {n: ((), v[0], attributes_of(n)) for n, v in quantities.items() if n not in varied}
    along: dict[str, Any] = {
        n: ("realization", v, attributes_of(n)) for n, v in quantities.items() if n in varied
    }
    if "frequency" not in varied or not isinstance(scene.launch, str):
        times = launch_times(scene.launch, scene.particles, float(frequency[0]))
        along["launch_time"] = ("particle", times, LAUNCH_TIME)
    variables: dict[str, Any] = {n: (v.dims, found[n], v.attributes) for n, v in recorded.items()}
    if ragged:
        variables = ragged_columns(found, recorded, scene.particles)
    remarks = [
        "" if result is not None or keywords.get("base") is not None else still_base(forcing),
        strong_forcing(float(quantities[ACCELERATION].max()), forcing),
        long_launch(
            float(quantities["launch_velocity"].max()),
            float(frequency.max()),
            float(quantities["gravity"].min()),
        ),
        _spent(scene, found["status"]),
        "" if ragged else wasted(found["impact_count"], "ragged=True"),
        _short(measured, quantities),
    ]
    note = "; ".join(filter(None, remarks))
    return xr.Dataset(
        variables | fixed,
        along,
        attributes_of_scene(scene, arrays) | ({"notes": note} if note else {}),
    )


def _spent(scene: Scene, status: Array) -> str:
    """Return a remark if particles were abandoned before the end of the observation."""
    spent = int(np.count_nonzero(status == Status.BUDGET_EXCEEDED))
    if not spent:
        return ""
    return (
        f"{spent} of {status.size} particles were abandoned after {scene.budget} landings: raise "
        f"impact_budget, or shorten the duration"
    )


def _short(scene: Scene, quantities: Mapping[str, Array]) -> str:
    """Warn and return a remark if the observation is too short for the requested regimes."""
    if not scene.measures.regimes:
        return ""
    if scene.noise(quantities):
        return NEVER_REPEATS
    ends = float(quantities["restitution"].max()), float(quantities["frequency"].min())
    if note := short_observation(scene, *ends):
        warnings.warn(note, ShortObservationWarning, stacklevel=3)
    return note


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
            f"{', '.join(sorted(others))}: cannot be given together with a result, whose "
            f"realizations are re-simulated as in its sweep; give keywords alone for other scenes"
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
        raise DataError("the mask hides all realizations of the dataset: there is none to simulate")
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
            f"simulate those of each sweep separately"
        )
