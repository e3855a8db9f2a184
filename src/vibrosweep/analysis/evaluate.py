"""Conditions evaluated at points of the plane of restitution and forcing, in batches."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis.conditions import Condition, Locked
from vibrosweep.arrays import Array
from vibrosweep.engine.measure import find_orbits, measure, orbit_variables
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.fixed import (
    ABSENT,
    ATTRACTS,
    REPELS,
    FixedOrbits,
    empty_fixed,
    end_errors,
    find_fixed,
    may_push_back,
)
from vibrosweep.kernels.impact import base_of
from vibrosweep.kernels.settle import Orbits
from vibrosweep.model.measures import VARIABLES
from vibrosweep.model.parameters import (
    HIGH_BOUNCE,
    Dimensionless,
    Launches,
    dimensionless,
    launches,
    taken,
)
from vibrosweep.model.restitution_laws import CONSTANT
from vibrosweep.model.shapes import SINE
from vibrosweep.scene.scene import Scene

Codes = NDArray[np.int64]
States = NDArray[np.float64]
Points = dict[str, Array]  # restitution, and the forcing by its name, each of shape (point,)

STATES: Final = 3  # of a fixed orbit
# Codes of `locked` for which an orbit attracts; they include `HOLDS`, a code of other conditions
HOLDING: Final = frozenset(
    straight + STATES * turned
    for straight in (ABSENT, ATTRACTS, REPELS)
    for turned in (ABSENT, ATTRACTS, REPELS)
    if ATTRACTS in (straight, turned)
)
TRAJECTORIES_AT_A_TIME: Final = 1 << 18
FIXED_PER_TASK: Final = 256


def _dataset(scene: Scene, parameters: dict[str, Array], measured: dict[str, Any]) -> xr.Dataset:
    """Dataset that a condition takes: variables, parameters as coordinates, number of particles."""
    return xr.Dataset(
        {name: (VARIABLES[name].dims, v) for name, v in measured.items() if name in VARIABLES},
        coords={name: ("realization", values) for name, values in parameters.items()},
        attrs={"particles": scene.particles},
    )


def locked(scene: Scene, condition: Locked, points: Points, workers: Workers) -> Codes:
    """Code of the states of the fixed orbits at each point, shape (point,).

    An orbit is absent, attracting or repelling.  Under the law `reflect` there may be two orbits,
    one of them reflected at every impact, and the code combines both states.  Along the
    forcing each orbit is first absent, then attracting, then repelling, so that no code occurs in
    two intervals: between two points of the same code nothing changes.
    """
    problem = dimensionless(scene.parameters(points), scene.duration)

    def state(sign: float) -> Codes:
        return fixed_orbits(scene, condition.k, sign, problem, workers).state.astype(np.int64)

    straight = state(1.0)
    return straight + STATES * state(-1.0) if may_push_back(scene.rebound) else straight


def fixed_orbits(
    scene: Scene, k: int, sign: float, problem: Dimensionless, workers: Workers
) -> FixedOrbits:
    """Fixed orbits of k periods of each problem, without noise; `sign` as in `find_fixed`."""
    found, base = empty_fixed(problem.kick.size), base_of(*scene.mechanics)
    modes = np.full(problem.kick.size, k)
    workers.run(
        lambda first, last: find_fixed(first, last, base, problem, modes, sign, found),
        modes.size,
        FIXED_PER_TASK,
        found,
    )
    return found


def law_errors(scene: Scene, condition: Locked, points: Points) -> Array:
    """Relative error that a law of restitution adds to the end of a window at each point."""
    found = np.zeros(points["restitution"].size)
    if scene.restitution_law == CONSTANT or not found.size:
        return found
    problem = dimensionless(scene.parameters(points), scene.duration)
    end_errors(base_of(*scene.mechanics), problem, condition.k, found)
    return np.asarray(found / problem.kick)


def launched(scene: Scene, condition: Condition, points: Points, workers: Workers) -> Codes:
    """Code of a condition for the scene's launches at each point; shape (point,)."""
    held = [
        condition_codes(scene, condition, scene.parameters(piece), workers)
        for piece in in_pieces(points, scene.particles)
    ]
    return np.concatenate(held)


def in_pieces(points: Points, trajectories: int) -> Iterator[Points]:
    """Yield the points, each with that many trajectories, in pieces that take little memory."""
    size = max(1, TRAJECTORIES_AT_A_TIME // trajectories)
    for start in range(0, points["restitution"].size, size):
        yield {name: values[start : start + size] for name, values in points.items()}


def condition_codes(
    scene: Scene, condition: Condition, parameters: dict[str, Array], workers: Workers
) -> Codes:
    """Code of a condition for the scene's launches in each realization."""
    measured = measure(parameters, scene.only(**condition.measures), workers)
    return condition.judge(_dataset(scene, parameters, measured))


def lift_off_speeds(scene: Scene, problem: Dimensionless, phase: Array, speed: Array) -> Array:
    """Absolute speed of states whose speed is relative to the base, in units of g / (2 f).

    Phase in turns and speed are those of lift-off; the problem's arrays must broadcast with them.
    """
    if scene.base == HIGH_BOUNCE:
        return speed
    alpha, shape = problem.kick / (1.0 + problem.restitution), scene.waveform
    w = np.sin(2.0 * np.pi * phase) if shape == SINE else shape.velocity(phase)
    return np.asarray(speed + alpha * w)


def launch_states(scene: Scene, parameters: dict[str, Array]) -> States:
    """States of the scene's launches: phase of the forcing in turns, and speed at lift-off.

    Shape (point, particle, 2).  The speed is relative to the base, in units of g / (2 f).  The
    parameters are those of `Scene.parameters`, of shape (point,).
    """
    problem = dimensionless(parameters, scene.duration)
    problem = taken(problem, (slice(None), np.newaxis))
    launch = launches(scene.launch, scene.particles, parameters["frequency"])
    phase = launch.phase + problem.phase
    phase -= np.rint(phase)
    at_rest = lift_off_speeds(scene, problem, phase, np.zeros_like(phase))
    return np.stack([phase, problem.launch_flight - at_rest], axis=-1)


def batch_from(
    scene: Scene, parameters: dict[str, Array], states: States
) -> tuple[Dimensionless, Launches]:
    """Problem and launches of particles that continue from given states.

    Each particle becomes a realization.  Parameters and states are those of `launch_states`.
    """
    phase, speed = np.ascontiguousarray(states.reshape(-1, 2).T)
    repeated = {name: np.repeat(values, states.shape[1]) for name, values in parameters.items()}
    repeated["phase"] = np.zeros_like(phase)  # phases of the states are those of the forcing
    problem = dimensionless(repeated, scene.duration, scene.measures.transient)
    problem = problem._replace(launch_flight=lift_off_speeds(scene, problem, phase, speed))
    return problem, Launches(np.zeros((phase.size, 1)), phase[:, np.newaxis])


def reached(orbits: Orbits, particles: int) -> States:
    """States that orbits have reached, as `launch_states`."""
    return np.stack([orbits.phase, orbits.flight], axis=-1).reshape(-1, particles, 2)


def settle_from(
    scene: Scene, parameters: dict[str, Array], states: States, workers: Workers
) -> Orbits:
    """Orbits that particles settle on from given states, ordered by point, then by particle.

    The arguments are those of `batch_from`.
    """
    problem, launch = batch_from(scene, parameters, states)
    alone = replace(scene.only(), particles=1, launch=(0.0,))
    return find_orbits(problem, launch, alone, workers)


def continued(
    scene: Scene, condition: Condition, points: Points, states: States, workers: Workers
) -> tuple[Codes, States]:
    """Code of a condition for orbits continued from given states, and their final states.

    Raises a ParameterError for a condition on launches, which a continued orbit does not have.
    """
    parameters = scene.parameters(points)
    orbits = settle_from(scene, parameters, states, workers)
    measured = orbit_variables(orbits, parameters["frequency"])
    del measured["recurrent_from"]  # counts from the last point, not from the launch
    lacking = [name for name in condition.variables if name not in measured]
    if lacking:
        raise ParameterError(
            f"condition {condition.name} reads {lacking[0]}, which depends on the launches: it "
            f"cannot be continued along the forcing; leave continuation out"
        )
    held = condition.judge(_dataset(scene, parameters, measured))
    return held, reached(orbits, scene.particles)
