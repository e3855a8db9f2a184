"""Every landing of a small scene."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any, Unpack

import numpy as np
import xarray as xr

from vibrosweep.api.keyword_types import BatchKeywords, completed
from vibrosweep.api.replay import replayed
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
from vibrosweep.errors import ShortObservationWarning
from vibrosweep.model.forcing import ACCELERATION, only_parameters, refuse_extreme
from vibrosweep.model.measures import IMPACTS, MEASURES, RECORD, Variable
from vibrosweep.model.ragged_arrays import ragged_columns, wasted
from vibrosweep.model.restitution_laws import VISCOELASTIC
from vibrosweep.model.status import Status
from vibrosweep.runs.driver import thread_count
from vibrosweep.runs.notes import NEVER_REPEATS, short_observation, strong_forcing
from vibrosweep.runs.result import LAUNCH_TIME, attributes_of, attributes_of_scene
from vibrosweep.scene.keys import SECTIONS
from vibrosweep.scene.keywords import batch
from vibrosweep.scene.scene import Scene

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
    """Every landing of a small scene, or of realizations of a sweep.

    Parameters
    ----------
    result
        Instead of a scene, realizations of a sweep that `vibrosweep.sweep` or `open_sweep` returns:
        ``simulate(found.isel(realization=7))`` repeats the trajectories of the sweep, bit for bit
        on the same model of processor.  The only keywords are then those of measures.
    ragged
        True to store landings one after the other along a single dim, a contiguous ragged array of
        the CF conventions, which leaves no places empty; `vibrosweep.rectangle` converts it back.
    threads
        Number of threads, by default all processors; the result does not depend on it.
    **keywords
        The scene, as for `vibrosweep.sweep`:

        restitution, frequency, phase, gravity, launch_velocity, contact_time
            Physical parameters (1, Hz, rad, m s-2, m s-1, s): a number, or a list or 1-D array with
            one entry per realization; these are broadcast together.
        amplitude, base_velocity, base_displacement, base_acceleration
            The forcing, as a physical parameter in one of four ways: amplitude A of the kick
            (m s-1), or peak velocity V0 (m s-1), displacement B (m) or acceleration Gamma (in units
            of gravity) of the base; A = (1 + e) V0, V0 = 2 pi f B, Gamma = 2 pi f V0 / g.  By
            default the amplitude of Table 1.
        launch_time
            Launch times in s: a number, or a list with one entry per particle.
        particles, launch
            Instead of `launch_time`, the number of particles, and ``"staggered"`` launches
            (particle j at j / (particles * frequency)) or a list of launch times in s.
        duration, duration_periods
            Landings up to this time are recorded: in s, 12 by default, or in forcing periods of
            each realization.
        base, rebound
            The base: ``"high-bounce"``, which stays at height zero and kicks, ``"moving"``, or
            ``"sprung"``, a moving base of finite mass, which recoils.  The law of rebound:
            ``"rest"``, or, over the high-bounce base only, ``"reflect"``.
        waveform
            Shape of the motion of the base: ``"sine"``, ``"parabolic"``, or the harmonics of its
            velocity with number, weight and phase in rad,
            ``{"harmonics": [[1, 1.0, 0.0], [2, 0.4, 1.1]]}``.
        restitution_law, restitution_speed
            Law by which the restitution depends on the impact speed, and a speed (m s-1):
            ``"constant"``; ``"plastic"``, in which it falls above the speed, where yielding begins;
            ``"viscoelastic"``, where ``restitution`` is that at the speed; or a law registered with
            `vibrosweep.register_law`.
        mass_ratio, particle_mass, base_mass, mount_frequency, mount_damping
            For the sprung base, as physical parameters: the mass of one particle in units of that
            of the base, or both masses (kg); natural frequency (Hz) and damping ratio (0.05 by
            default) of its mount.
        restitution_noise, kick_noise, drive_noise
            Standard deviations, as physical parameters: of the restitution at each impact (1); of
            the velocity of the base at each impact (m s-1); of the amplitude in each forcing
            period, in units of the amplitude (1).
        noise_seed, noise_stream
            Seed of the random numbers, 0 by default, and the stream of each realization: a whole
            number, or a list with one entry per realization; their indices by default.
        impact_budget
            Number of landings after which a particle is given up, rounded up to a multiple of 6;
            its status says so.
        regimes, lyapunov, trust, separation, per_particle, ordering, joint, impact_speed
            True to measure as `vibrosweep.sweep` does, from ``transient`` or ``transient_periods``
            on: ``regimes=True`` gives the regime of each particle and the period of its cycle,
            ``lyapunov=True`` exponents as well.
        undecided
            True to count decisions over a base of finite mass that rounding may have changed.

    Returns
    -------
    xarray.Dataset
        Dims (realization, particle, impact): ``landing_time`` and ``liftoff_time`` (s),
        ``rebound_velocity`` (m s-1), ``rested``, ``impact_phase`` (turns), ``arrival_speed``
        (m s-1); dims (realization, particle): ``impact_count``, ``status``, and the variables of
        measures, such as ``regime``, ``cycle_periods``, ``cycle_impacts`` and
        ``lyapunov_largest``, as in a sweep.  Values past the last landing are NaN, and so is the
        lift-off of a particle that rests permanently, or until a forcing period past the end.  The
        attribute ``notes`` says if particles were given up, if more than half of the places are
        empty, if the base is driven more strongly than by any shaker, and if the observation is too
        short for the regimes.  If
        `ragged`, the dim landing replaces (realization, particle, impact), and trajectory replaces
        (realization, particle), with ``realization_index`` and ``particle_index``.  Parameters that
        differ between realizations are coordinates, the others variables without dims.

    Raises
    ------
    SpecError
        Keywords are unknown, contradict each other, or have values that are not allowed; all
        mistakes are listed.
    ParameterError
        The forcing or the masses make a parameter too large, the record is too large, or keywords
        other than measures are given beside a result.
    DataError
        The dataset is not a result of a sweep, or parts of it are missing.

    Warns
    -----
    OtherKernelsWarning
        The code that computed the result differs from the one that follows it now.
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
    recorded = {**RECORD, **IMPACTS, **_variables_of(measured)}
    require_room(max((v.size for v in arrays.values()), default=1), scene.particles)
    quantities = scene.timed(arrays)
    forcing, frequency = scene.forcing(), quantities["frequency"]
    refuse_extreme(quantities, forcing, scene.restitution_law)
    parameters = only_parameters(quantities)
    with Workers(thread_count(threads)) as workers:
        found = record_landings(parameters, scene, workers, Form(ragged, BYTES_IN_MEMORY))
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
        strong_forcing(float(quantities[ACCELERATION].max()), forcing),
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
    """Return a remark if particles were given up before the end of the observation."""
    spent = int(np.count_nonzero(status == Status.BUDGET_EXCEEDED))
    if not spent:
        return ""
    return (
        f"{spent} of {status.size} particles were given up after {scene.budget} landings: raise "
        f"impact_budget, or shorten the duration"
    )


def _short(scene: Scene, quantities: Mapping[str, Array]) -> str:
    """Warn and return a remark if the observation is too short for the regimes asked for."""
    if not scene.measures.regimes:
        return ""
    if scene.noise(quantities):
        return NEVER_REPEATS
    ends = float(quantities["restitution"].max()), float(quantities["frequency"].min())
    if note := short_observation(scene, *ends):
        warnings.warn(note, ShortObservationWarning, stacklevel=3)
    return note


def _variables_of(scene: Scene) -> Mapping[str, Variable]:
    """Return the variables of the measures of a scene."""
    measures = (measure for key, measure in MEASURES.items() if getattr(scene.measures, key))
    return {variable.name: variable for measure in measures for variable in measure.variables}
