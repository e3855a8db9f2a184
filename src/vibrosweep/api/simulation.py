"""Every landing of a small scene."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from vibrosweep.engine.asked import record_observation
from vibrosweep.engine.landings import record_landings, require_room
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
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
from vibrosweep.model.parameters import BASES, HIGH_BOUNCE, LAWS, PARAMETERS, refuse_masked
from vibrosweep.model.times import Periods, Time, amount, in_seconds, one_time, unit_of
from vibrosweep.runs.driver import count, thread_count
from vibrosweep.runs.result import LAUNCH_TIME, attributes_of, periods_given

__all__ = ["simulate"]


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
    base: str = HIGH_BOUNCE,
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
        ``status``.  NaN past the last landing, and for the lift-off of a particle that rests for
        good, or for a forcing period past the end.
        Parameters that differ between realizations are coordinates, the others variables without
        dims.

    Raises
    ------
    ParameterError
        A parameter is of the wrong kind or outside its range, two contradict each other, or the
        record would be too large.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.simulate(restitution=0.9, amplitude=1.2, launch_time=[0.0, 0.125])
    >>> found.landing_time.sel(particle=1).values[0, :2].round(6)
    array([1.144368, 2.254512])
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
    budget = count("impact_budget", impact_budget)
    require_room(max(v.size for v in values.values()), launch.size)
    quantities = completed(_broadcast(values))
    refuse_large(quantities, forcing)
    parameters = only_parameters(quantities)
    observation = record_observation(
        launch.size, tuple(launch.ravel().tolist()), end, rebound, budget, base
    )
    with Workers(thread_count(threads)) as workers:
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
    fixed = {n: ((), v[0], attributes_of(n)) for n, v in quantities.items() if n not in varied}
    along = {n: ("realization", v, attributes_of(n)) for n, v in quantities.items() if n in varied}
    launches = {"launch_time": ("particle", np.atleast_1d(launch), LAUNCH_TIME)}
    return dataset.assign(fixed).assign_coords(along | launches)


def _end(duration: float | None, duration_periods: float | None) -> Time:
    """Return the end of an observation that is a number above 0."""
    end = one_time("duration", duration, duration_periods, 12.0)
    name = "duration_periods" if isinstance(end, Periods) else "duration"
    length = _numbers(name, amount(end), unit_of(end))
    positive = length.ndim == 0 and 0 < length < np.inf
    _require(positive, name, amount(end), f"a finite number greater than 0 {unit_of(end)}")
    return Periods(float(length)) if isinstance(end, Periods) else float(length)


def _require(condition: object, name: str, value: object, allowed: str) -> None:
    if not condition:
        raise ParameterError(f"{name} = {value!r}: must be {allowed}")


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
