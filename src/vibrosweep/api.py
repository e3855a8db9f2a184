"""The public functions: physical parameters or a sweep file in, `xarray.Dataset` out."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from numbers import Integral
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from vibrosweep.engine.asked import record_observation
from vibrosweep.engine.landings import record_landings, require_room
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import DataError, ExistingOutputError, ParameterError
from vibrosweep.model.forcing import (
    FORCINGS,
    INPUTS,
    completed,
    differing,
    forcing_of,
    inputs_of,
    only_parameters,
    refuse_large,
)
from vibrosweep.model.measures import RECORD, Measures
from vibrosweep.model.mount import OF_MOUNT, require_mount
from vibrosweep.model.parameters import BASES, LAWS, PARAMETERS, refuse_masked
from vibrosweep.model.times import Periods, Time, amount, in_seconds, one_time, unit_of
from vibrosweep.runs.driver import available_threads, run_sweep
from vibrosweep.runs.finished import is_of, origin
from vibrosweep.runs.result import LAUNCH_TIME, TIMES, coordinate_attributes, periods_given
from vibrosweep.spec.sweep import read_spec
from vibrosweep.store.disk import check_output
from vibrosweep.store.kinds import SWEEP, kind_of
from vibrosweep.store.reading import reading
from vibrosweep.store.rundir import replaces

__all__ = ["open_record", "open_sweep", "run", "simulate"]


def simulate(
    *,
    restitution: ArrayLike = PARAMETERS["restitution"].default,
    amplitude: ArrayLike | None = None,
    base_velocity: ArrayLike | None = None,
    base_displacement: ArrayLike | None = None,
    base_acceleration: ArrayLike | None = None,
    frequency: ArrayLike = PARAMETERS["frequency"].default,
    phase: ArrayLike = PARAMETERS["phase"].default,
    gravity: ArrayLike = PARAMETERS["gravity"].default,
    launch_velocity: ArrayLike = PARAMETERS["launch_velocity"].default,
    launch_time: ArrayLike = 0.0,
    duration: float | None = None,
    duration_periods: float | None = None,
    contact_time: ArrayLike = PARAMETERS["contact_time"].default,
    mass_ratio: ArrayLike | None = None,
    particle_mass: ArrayLike | None = None,
    base_mass: ArrayLike | None = None,
    mount_frequency: ArrayLike | None = None,
    mount_damping: ArrayLike | None = None,
    base: str = BASES[0],
    rebound: str = "rest",
    impact_budget: int = Measures.impact_budget,
    threads: int | None = None,
) -> xr.Dataset:
    """Every landing of a small scene.

    Parameters
    ----------
    restitution, frequency, phase, gravity, launch_velocity, contact_time
        Physical parameters (1, Hz, rad, m s-2, m s-1, s): a number, or a 1-D array with one entry
        per realization; arrays are broadcast together.
    amplitude, base_velocity, base_displacement, base_acceleration
        The forcing, as a physical parameter in one of four ways: amplitude A of the kick (m s-1),
        or peak velocity V0 (m s-1), displacement B (m) or acceleration Gamma (in units of gravity)
        of the base; A = (1 + e) V0, V0 = 2 pi f B, Gamma = 2 pi f V0 / g.  Without any of them the
        amplitude of Table 1.
    launch_time
        When particles leave the base, in s: a number, or a 1-D array with one entry per particle.
    duration, duration_periods
        Landings up to this time are recorded: in s, 12 by default, or in forcing periods of each
        realization.
    base
        ``"high-bounce"``, a base that stays at height zero and kicks, ``"moving"``, or
        ``"sprung"``, a moving base of finite mass, which recoils.
    mass_ratio, particle_mass, base_mass, mount_frequency, mount_damping
        Of a sprung base, as physical parameters: the mass of one particle in units of that of the
        base, or both masses (kg); natural frequency (Hz) and damping ratio (0.05 by default) of its
        mount.
    rebound
        ``"rest"`` or ``"reflect"``; the latter over a high-bounce base only.
    impact_budget
        Landings after which a particle is given up, rounded up to a multiple of 6; its status says
        so.
    threads
        Number of threads, by default all processors; the result does not depend on it.

    Returns
    -------
    xarray.Dataset
        Dims (realization, particle, impact): ``landing_time`` and ``liftoff_time`` (s),
        ``rebound_velocity`` (m s-1), ``rested``; dims (realization, particle): ``impact_count``,
        ``status``.  NaN past the last landing, and for the lift-off of a particle at rest for good.

    Raises
    ------
    ParameterError
        A parameter is of the wrong kind or outside its range, two contradict each other, or the
        record would be too large.
    """
    asked = {
        "restitution": restitution,
        "amplitude": amplitude,
        "base_velocity": base_velocity,
        "base_displacement": base_displacement,
        "base_acceleration": base_acceleration,
        "frequency": frequency,
        "phase": phase,
        "gravity": gravity,
        "launch_velocity": launch_velocity,
        "contact_time": contact_time,
        "mass_ratio": mass_ratio,
        "particle_mass": particle_mass,
        "base_mass": base_mass,
        "mount_frequency": mount_frequency,
        "mount_damping": mount_damping,
    }
    optional = {*FORCINGS, *OF_MOUNT}
    given = {n: v for n, v in asked.items() if v is not None or n not in optional}
    forcing = forcing_of(given)
    launch = _numbers("launch_time", launch_time, "s")
    _require(np.all(np.isfinite(launch)), "launch_time", launch_time, "finite, in s")
    for name, value, known in (("base", base, BASES), ("rebound", rebound, LAWS)):
        _require(
            isinstance(value, str) and value in known, name, value, f"one of {', '.join(known)}"
        )
    require_mount(base, given)
    values = {
        name: _checked(name, given.get(name, INPUTS[name].default))
        for name in inputs_of(given, base)
    }
    end = _end(duration, duration_periods)
    _require_whole("impact_budget", impact_budget)
    require_room(max(v.size for v in values.values()), launch.size)
    quantities = completed(_broadcast(values))
    refuse_large(quantities, forcing)
    parameters = only_parameters(quantities)
    observation = record_observation(
        launch.size, tuple(launch.ravel().tolist()), end, rebound, impact_budget, base
    )
    with Workers(_threads(threads)) as workers:
        found = record_landings(parameters, observation, workers)
    dataset = xr.Dataset(
        {name: (v.dims, found[name], v.attributes) for name, v in RECORD.items()},
        attrs={"base": base, "rebound": rebound, "forcing": forcing, **periods_given(end)},
    )
    quantities["duration"] = in_seconds(end, quantities["frequency"])
    several = parameters["frequency"].size > 1
    varied = differing([n for n, v in values.items() if v.ndim and several], forcing)
    if isinstance(end, Periods) and "frequency" in varied:
        varied = (*varied, "duration")
    return dataset.assign_coords(_coordinates(quantities, np.atleast_1d(launch), varied))


def _end(duration: float | None, duration_periods: float | None) -> Time:
    """Return the end of an observation that is a number above 0."""
    end = one_time("duration", duration, duration_periods, 12.0)
    name = "duration_periods" if isinstance(end, Periods) else "duration"
    length = _numbers(name, amount(end), unit_of(end))
    positive = length.ndim == 0 and 0 < length < np.inf
    _require(positive, name, amount(end), f"a finite number greater than 0 {unit_of(end)}")
    return Periods(float(length)) if isinstance(end, Periods) else float(length)


def run(
    spec: str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    threads: int | None = None,
    chunk: int | None = None,
    force: bool = False,
) -> xr.Dataset:
    """Compute a sweep file and open the result; a run that was ended early is continued.

    Parameters
    ----------
    spec
        Path of the sweep file (TOML).
    output
        Path of the result.  One that exists is opened if it is that of this very sweep, and
        otherwise kept, unless `force`.
    threads
        Number of threads, by default all processors; the result does not depend on it.
    chunk
        Realizations in a chunk, by default some seconds of work; the result does not depend on it.
    force
        Whether an existing output is replaced, and an unfinished run thrown away.

    Raises
    ------
    SpecError, TableError, OutputError, ParameterError
        The sweep file or its table holds mistakes, or the output cannot be written.
    RunError
        Another run or an unfinished one stands in the way, or chunks failed; the same call again
        continues with those that are missing.
    """
    path = Path(output)
    checked = read_spec(spec)
    if chunk is not None:
        _require_whole("chunk", chunk)
    try:
        check_output(path, force=force or replaces(path), inputs=(checked.source, checked.table))
    except ExistingOutputError as error:
        if is_of(checked, path):
            return open_sweep(path)
        raise ExistingOutputError(path, origin(checked, path)) from error
    run_sweep(checked, path, threads=_threads(threads), chunk=chunk, force=force)
    return open_sweep(path)


def open_sweep(path: str | os.PathLike[str]) -> xr.Dataset:
    """Open the result of a sweep, lazily; the same as ``xarray.open_dataset(path)``.

    Raises
    ------
    DataError
        There is no such file, or it is not a result.
    """
    return _open(path, None)


def open_record(path: str | os.PathLike[str]) -> xr.Dataset:
    """Open every landing of the scene that a sweep recorded (``[record]`` in its file).

    Raises
    ------
    DataError
        There is no such file, or it holds no record.
    """
    if not has_record(path):
        raise DataError(
            f"{path}: holds no record of landings; add a [record] section to the sweep file and "
            f"run it again"
        )
    return _open(path, "record")


def has_record(path: str | os.PathLike[str]) -> bool:
    """Whether a result holds every landing of a scene.

    Raises
    ------
    DataError
        There is no such file, or it is not a result.
    """
    with reading(path), h5netcdf.File(Path(path), "r", phony_dims="access") as file:
        return "record" in file.groups


def _open(path: str | os.PathLike[str], group: str | None) -> xr.Dataset:
    with reading(path):
        # without phony_dims a foreign file makes h5netcdf warn
        dataset = xr.open_dataset(path, engine="h5netcdf", group=group, phony_dims="access")
        kind = kind_of(path, dataset.attrs) if group is None else SWEEP
    needed = {*PARAMETERS, "landing_time" if group else "impact_count"}
    if not needed <= dataset.variables.keys():
        dataset.close()
        if kind is not SWEEP:
            raise DataError(
                f"{path}: is a result of {kind.command}; open it with xarray.open_dataset"
            )
        raise DataError(f"{path}: is not a result of vibrosweep run; check the path")
    return dataset.rename({d: str(d).removeprefix(f"{group}_") for d in dataset.dims})


def _require(condition: object, name: str, value: object, allowed: str) -> None:
    if not condition:
        raise ParameterError(f"{name} = {value!r}: must be {allowed}")


def _require_whole(name: str, value: object) -> None:
    """A count: an int or a numpy integer."""
    whole = isinstance(value, Integral) and not isinstance(value, bool)
    _require(whole and value > 0, name, value, "a whole number, at least 1")  # type: ignore[operator]


def _numbers(name: str, value: object, units: str) -> NDArray[np.float64]:
    """A number or 1-D array of such."""
    refuse_masked(name, value)
    try:
        array = np.asarray(value)
    except ValueError:
        array = np.empty((0, 0), object)
    numeric = array.dtype.kind in "iuf" and array.ndim < 2 and array.size > 0
    unit = "" if units == "1" else f" in {units}"
    _require(numeric, name, value, f"a number{unit} or a 1-D array of numbers")
    return array.astype(np.float64)


def _checked(name: str, value: object) -> NDArray[np.float64]:
    parameter = INPUTS[name]
    array = _numbers(name, value, parameter.units)
    bad = array[~parameter.accepts(array)]
    if bad.size:
        raise ParameterError(f"{name} = {float(bad.flat[0])!r}: must be {parameter.allowed}")
    return array


def _broadcast(values: Mapping[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
    try:
        shape = np.broadcast_shapes((1,), *(v.shape for v in values.values()))
    except ValueError as error:
        lengths = {name: v.size for name, v in values.items() if v.ndim}
        raise ParameterError(
            f"arrays of realizations must have one length, or length 1: {lengths}"
        ) from error
    # copies: a read-only array would compile the kernels once more
    return {name: np.array(np.broadcast_to(v, shape)) for name, v in values.items()}


def _coordinates(
    quantities: Mapping[str, NDArray[np.float64]],
    launch: NDArray[np.float64],
    varied: Collection[str],
) -> dict[str, Any]:
    coordinates: dict[str, Any] = {
        name: (
            ("realization",) if name in varied else (),
            v if name in varied else v[0],
            TIMES[name] if name in TIMES else coordinate_attributes(INPUTS[name]),
        )
        for name, v in quantities.items()
    }
    return coordinates | {"launch_time": (("particle",), launch, LAUNCH_TIME)}


def _threads(threads: int | None) -> int:
    if threads is None:
        return available_threads()
    _require_whole("threads", threads)
    return threads
