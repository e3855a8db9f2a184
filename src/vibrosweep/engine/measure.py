"""Measure a batch of realizations: parameters in, measured variables out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.engine.in_units import (
    Measured,
    height_unit,
    impact_speeds,
    of_launches,
    of_particles,
    of_realizations,
    separations_in_units,
)
from vibrosweep.engine.observable_values import observable_values
from vibrosweep.engine.orbits import orbit_variables
from vibrosweep.engine.trajectories import base_in, follow, statistics
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import RunError
from vibrosweep.kernels.bases import lifts, lowest
from vibrosweep.kernels.harmonics import motion
from vibrosweep.kernels.trust import Trust
from vibrosweep.model.measures import Variable
from vibrosweep.model.parameters import (
    SPRUNG,
    Dimensionless,
    Launches,
    dimensionless,
    launches,
    representable,
)
from vibrosweep.model.shapes import Waveform
from vibrosweep.model.times import Time, in_seconds
from vibrosweep.scene.scene import Scene


def measure(parameters: Mapping[str, Array], scene: Scene, workers: Workers) -> Measured:
    """Advance a batch of realizations and measure them.

    Every parameter of `vibrosweep.model.parameters.PARAMETERS`, and those of the mount of a sprung
    base, is of shape (realization,).  Returns arrays of that shape, and of (realization, particle)
    for measures per particle, named as in `vibrosweep.model.measures`.  Raises a ParameterError
    where more forcing periods are asked for than can be counted exactly, a RunError where a result
    is not written to the end.
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
    frequency, particles = parameters["frequency"], scene.particles
    launch = launches(scene.launch, particles, frequency)
    found = follow(problem, launch, measures.tolerance * frequency, scene, workers)
    base = base_in(scene, problem)
    of_base = lifts(base, problem), lowest(base, problem)
    measured = of_realizations(found.whole, parameters, *of_base)
    moves = of_base[1] is not None
    heights = _launch_heights(parameters, problem, launch, scene.waveform if moves else None)
    highest = measured["rebound_height_max"]
    measured["flight_height_max"] = of_launches(scene, parameters, heights, highest)
    if measures.impact_speed:
        measured |= impact_speeds(found.whole, parameters, scene.restitution_law)
    if measures.per_particle and found.each is not None:
        measured |= of_particles(found.each, parameters, particles, *of_base)
    if found.orbits is not None:
        measured |= orbit_variables(found.orbits, frequency)
    if found.separations is not None:
        measured |= separations_in_units(found.separations, frequency)
    if found.bounds is not None:
        measured |= _error_bounds(found.bounds, scene, parameters)
    return measured | observable_values(
        parameters,
        scene,
        found.each,
        lambda observer: statistics(problem, launch, scene, workers, observer=observer),
    )


def measure_all(parameters: Mapping[str, Array], scene: Scene, workers: Workers) -> Measured:
    """Measure a batch; realizations that cannot be computed do not make the others fail.

    Their floats are NaN, their counts and flags undetermined, and their status gives the reason.

    Parameters and result are those of `measure`.
    """
    usable = representable(parameters, _times(scene))
    if usable.all():
        return measure(parameters, scene, workers)
    sizes = {"realization": usable.size, "particle": scene.particles}
    sizes |= {along: len(values) for along, values in scene.measures.observable_dims.items()}
    found = {v.name: _refused(v, sizes) for v in scene.measures.variables}
    if usable.any():
        kept = {name: values[usable] for name, values in parameters.items()}
        for name, values in measure(kept, scene, workers).items():
            found[name][usable] = values
    return found


def _times(scene: Scene) -> tuple[Time, ...]:
    launch = () if isinstance(scene.launch, str) else scene.launch
    return (scene.duration, scene.measures.transient, *launch)


def _refused(variable: Variable, sizes: Mapping[str, int]) -> NDArray[Any]:
    """Values of a variable for realizations that were not computed."""
    return np.full([sizes[d] for d in variable.dims], variable.blank, variable.dtype)


def _launch_heights(
    parameters: Mapping[str, Array],
    problem: Dimensionless,
    launch: Launches,
    waveform: Waveform | None,
) -> Array:
    """Heights in m that launches reach, shape (realization, particle), or 1 where all are equal.

    They are so over a base that does not move, None.
    """
    with np.errstate(over="ignore"):
        thrown = parameters["launch_velocity"] ** 2 / (2.0 * parameters["gravity"])
        if waveform is None:
            return np.asarray(thrown[:, np.newaxis])
        velocity, level = motion(waveform, launch.phase + problem.phase[:, np.newaxis])
        # the base has the speed low pi / 2 w and the height low 2 pi W; it pushes a particle that
        # is slower, which then does not fly
        low = (2.0 / np.pi) * (problem.kick / (1.0 + problem.restitution))
        flies = problem.launch_flight[:, np.newaxis] >= 0.5 * np.pi * low[:, np.newaxis] * velocity
        base = (height_unit(parameters) * low)[:, np.newaxis] * level
        return np.where(flies, thrown[:, np.newaxis] + base, base)


def _error_bounds(bounds: Trust, scene: Scene, parameters: Mapping[str, Array]) -> Measured:
    frequency, particles = parameters["frequency"], scene.particles
    until = bounds.until.reshape(-1, particles) / frequency[:, np.newaxis]
    end = in_seconds(scene.duration, frequency)
    velocity = parameters["gravity"] / (2.0 * frequency)
    return {
        "trusted_until": np.where(until == np.inf, end[:, np.newaxis], until),
        "landing_time_error": bounds.landing_error.reshape(-1, particles).max(axis=1) / frequency,
        "rebound_velocity_error": bounds.flight_error.reshape(-1, particles).max(axis=1) * velocity,
    }
