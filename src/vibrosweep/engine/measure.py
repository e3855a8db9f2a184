"""Measure a batch of realizations: from arrays of parameters to arrays of variables."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.engine.in_units import (
    Measured,
    height_unit,
    order_in_units,
    separations_in_units,
    statistics_in_units,
    units_of,
)
from vibrosweep.engine.observable_values import observable_values
from vibrosweep.engine.orbits import orbit_variables
from vibrosweep.engine.trajectories import base_in, follow, statistics
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import RunError
from vibrosweep.kernels.bases import lifts, lowest
from vibrosweep.kernels.shape_types import motion
from vibrosweep.kernels.trust import Trust
from vibrosweep.model.parameters import (
    SPRUNG,
    Dimensionless,
    Launches,
    dimensionless,
    launches,
    representable,
)
from vibrosweep.model.shapes import Waveform
from vibrosweep.model.status import Status
from vibrosweep.model.times import in_seconds
from vibrosweep.scene.scene import Scene


def measure(parameters: Mapping[str, Array], scene: Scene, workers: Workers) -> Measured:
    """Advance a batch of realizations and measure them.

    `parameters` holds every parameter of `vibrosweep.model.parameters.PARAMETERS`, and for a sprung
    base those of the mount, each of shape (realization,).  Returns arrays of this shape, or for
    measures per particle of shape (realization, particle), named as in `vibrosweep.model.measures`.
    Raises a ParameterError for more forcing periods than can be counted exactly, and a RunError if
    a variable is missing or incomplete.
    """
    if scene.base == SPRUNG:
        from vibrosweep.engine.coupled import measure_coupled  # slow to import: it declares kernels

        found = measure_coupled(parameters, scene, workers)
    else:
        found = _measure_apart(parameters, scene, workers)
    names = [variable.name for variable in scene.measures.variables]
    if missing := [name for name in names if name not in found]:
        raise RunError(
            f"{', '.join(missing)}: not computed over base = {scene.base}; this is a fault of "
            f"vibrosweep: please report it"
        )
    return {name: found[name] for name in names}


def _measure_apart(parameters: Mapping[str, Array], scene: Scene, workers: Workers) -> Measured:
    """Measure realizations whose particles do not act on each other."""
    measures = scene.measures
    problem = dimensionless(parameters, scene.duration, measures.transient)
    frequency = parameters["frequency"]
    launch = launches(scene.launch, scene.particles, frequency)
    found = follow(problem, launch, measures.tolerance * frequency, scene, workers)
    base = base_in(scene, problem)
    ground = lowest(base, problem)
    waveform = None if ground is None else scene.waveform
    heights = _launch_heights(parameters, problem, launch, waveform)
    sums, each = found.realizations, found.trajectories
    of_base = lifts(base, problem), ground
    measured = statistics_in_units(scene, parameters, sums, each, heights, *of_base)
    if found.orbits is not None:
        measured |= orbit_variables(found.orbits, frequency)
    if found.separations is not None:
        measured |= separations_in_units(found.separations, frequency)
    if found.order is not None:
        measured |= order_in_units(found.order, frequency)
    if found.bounds is not None:
        measured |= _error_bounds(found.bounds, scene, parameters)
    return measured | observable_values(
        parameters,
        scene,
        each,
        lambda observer: statistics(problem, launch, scene, workers, observer=observer),
    )


def measure_all(parameters: Mapping[str, Array], scene: Scene, workers: Workers) -> Measured:
    """Measure a batch as `measure` does, also if some of its realizations cannot be computed.

    Their floats are NaN, their counts and flags undetermined, and their status gives the reason.
    """
    launch = () if isinstance(scene.launch, str) else scene.launch
    usable = representable(parameters, (scene.duration, scene.measures.transient, *launch))
    every = bool(usable.all())
    kept = parameters if every else {name: values[usable] for name, values in parameters.items()}
    found = measure(kept, scene, workers) if usable.any() else {}
    known = usable.copy()
    if found:  # landings are counted while they are found
        known[usable] = found["status"] != Status.REFUSED
    if known.all():
        return found
    sizes = {"realization": usable.size, "particle": scene.particles}
    sizes |= {along: len(values) for along, values in scene.measures.observable_dims.items()}
    all_found = {
        v.name: np.full([sizes[d] for d in v.dims], v.blank, v.dtype)
        for v in scene.measures.variables
    }
    for name, values in found.items():
        all_found[name][known] = values[known[usable]]
    return all_found


def _launch_heights(
    parameters: Mapping[str, Array],
    problem: Dimensionless,
    launch: Launches,
    waveform: Waveform | None,
) -> Array:
    """Return the heights in m that launches reach, shape (realization, particle).

    `waveform` is None in the high-bounce limit, where all launches of a realization reach the same
    height; the shape is then (realization, 1).
    """
    with np.errstate(over="ignore"):
        thrown = parameters["launch_velocity"] ** 2 / (2.0 * parameters["gravity"])
        if waveform is None:
            return np.asarray(thrown[:, np.newaxis])
        velocity, level = motion(waveform, launch.phase + problem.phase[:, np.newaxis])
        # for kick = (1 + e) a the base has the velocity a w in g / (2 f) and the height
        # (2 / pi) a 2 pi W in g / (8 f^2); it pushes a slower particle, which then does not fly
        scale = (2.0 / np.pi) * (problem.kick / (1.0 + problem.restitution))
        speed = 0.5 * np.pi * scale[:, np.newaxis] * velocity
        flies = problem.launch_flight[:, np.newaxis] >= speed
        base = (height_unit(parameters) * scale)[:, np.newaxis] * level
        return np.where(flies, thrown[:, np.newaxis] + base, base)


def _error_bounds(bounds: Trust, scene: Scene, parameters: Mapping[str, Array]) -> Measured:
    frequency, particles = parameters["frequency"], scene.particles
    until = bounds.until.reshape(-1, particles) / frequency[:, np.newaxis]
    end = in_seconds(scene.duration, frequency)
    velocity = units_of(parameters).velocity
    return {
        "trusted_until": np.where(until == np.inf, end[:, np.newaxis], until),
        "landing_time_error": bounds.landing_error.reshape(-1, particles).max(axis=1) / frequency,
        "rebound_velocity_error": bounds.flight_error.reshape(-1, particles).max(axis=1) * velocity,
    }
