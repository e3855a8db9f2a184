"""Tools of analyses that call the engine: axes, variables, states that orbits continue from."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep import theory
from vibrosweep.abilities import refusal
from vibrosweep.arrays import Array
from vibrosweep.engine.measure import find_orbits
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.settle import Orbits
from vibrosweep.mistakes import ABSENT, Mistake, Word
from vibrosweep.model.forcing import FORCINGS, INPUTS, differing
from vibrosweep.model.measures import Variable
from vibrosweep.model.parameters import (
    HIGH_BOUNCE,
    STREAM,
    Dimensionless,
    Launches,
    Periods,
    dimensionless,
    in_seconds,
    launches,
    taken,
)
from vibrosweep.model.restitution_laws import CONSTANT
from vibrosweep.model.shapes import SINE
from vibrosweep.runs.result import attributes_of, attributes_of_scene, remarks
from vibrosweep.scene.design import GRID, open_design
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import Sweep
from vibrosweep.system import physical_memory

States = NDArray[np.float64]
Flags = tuple[tuple[int, str], ...]  # codes and their meanings

# Forcings that every result holds
KEPT: Final = ("amplitude", "base_acceleration")
# Observation in multiples of the time in which an orbit locked to one period recurs: orbits near
# the ends of their windows, and longer cycles, take longer
SETTLING: Final = 4.0
LONGEST: Final = 1e5  # forcing periods


def settling(spec: Sweep, restitution: float) -> Scene:
    """Return the scene of a sweep; if it states no duration, with one in which orbits settle.

    This duration is `SETTLING` times that after which an orbit locked to one period returns bit for
    bit at this restitution, but at most `LONGEST`, since it grows without bound as the restitution
    approaches 1.  A law of restitution is evaluated at the impact speed of that orbit, g / 2 f.
    """
    scene = spec.scene
    if "duration" in spec.stated:
        return scene
    if scene.restitution_law != CONSTANT:
        speed = scene.inputs["gravity"] / (2.0 * scene.inputs["frequency"])
        law = scene.restitution_law, scene.inputs["restitution_speed"]
        restitution = float(theory.restitution_at(speed, restitution, *law))
    periods = SETTLING * float(theory.recognition_periods(restitution, base=scene.base))
    return replace(scene, duration=Periods(float(np.ceil(min(periods, LONGEST)))))


OBSERVATION: Final = "observation: "  # begins the last of the remarks on a result, if it is there


def remarks_on(sweep: Sweep, observation: str = "", *, launched: bool = True) -> str:
    """Remarks on the scene of an analysis and on its observation, in one text."""
    found = remarks(sweep, open_design(sweep), launched=launched)
    found[OBSERVATION.partition(":")[0]] = observation
    return "; ".join(f"{about}: {text}" for about, text in found.items() if text)


def attributes(
    sweep: Sweep, scene: Scene, observation: str = "", *, launched: bool = True, **others: Any
) -> dict[str, Any]:
    """Attributes of a result: its sweep, its scene apart from the inputs, remarks, and others."""
    return {
        "title": sweep.title,
        "particles": scene.particles,
        "launch": scene.launch if isinstance(scene.launch, str) else np.asarray(scene.launch),
        "impact_budget": scene.measures.impact_budget,
        **attributes_of_scene(scene),
        **others,
        "notes": remarks_on(sweep, observation, launched=launched),
        "sweep_file": sweep.text,
    }


def meaning(long_name: str, units: str = "1") -> dict[str, str]:
    """Attributes of a variable: its meaning and its units."""
    return {"units": units, "long_name": long_name}


def coded(dims: Sequence[str], codes: object, long_name: str, flags: Flags) -> tuple[Any, ...]:
    """Variable of codes: its dims, values and attributes, with the meaning of each code."""
    variable = Variable("", tuple(dims), "int8", "1", long_name, flags=flags)
    return variable.dims, np.asarray(codes, np.int8), variable.attributes


def shared(scene: Scene, varied: Collection[str]) -> dict[str, Any]:
    """Variables without dimensions: times, and parameters that all realizations share."""
    values = {name: np.array([INPUTS[name].low]) for name in varied if name not in scene.inputs}
    found = scene.quantities(values)
    differ = {*differing(varied, scene.forcing(varied)), STREAM}
    differ |= FORCINGS.keys() - {*KEPT, scene.forcing(varied)}
    fixed: dict[str, Any] = {
        name: ((), values[0], attributes_of(name))
        for name, values in found.items()
        if name not in differ
    }
    for name, time in scene.times.items():
        fixed[name] = ((), in_seconds(time, found["frequency"])[0], attributes_of(name))
    return fixed


def require_ability(analysis: str, scene: Scene, varied: Collection[str] = ()) -> None:
    """Raise a ParameterError if an analysis cannot take a scene whose inputs `varied` vary."""
    wrong = refusal(
        scene.base,
        restitution=scene.restitution_law,
        waveform=scene.waveform.name,
        analysis=analysis,
        noise=scene.noise(varied),
    )
    if wrong:
        raise ParameterError(f"{analysis}: {wrong}")


def grid_axes(
    spec: Sweep,
    purpose: str,
    needed: str,
    allowed: tuple[str, ...] = (),
    points: Mapping[str, int] | None = None,
) -> dict[str, Array]:
    """Axes of a sweep's grid, ascending, by the names of parameters.

    With `points`, the ranges of a random design become axes of that many evenly spaced values.
    Raises a SpecError that names the purpose unless the design is a grid with the axis `needed` and
    no others than those `allowed`.
    """
    axes = {name: np.sort(values) for name, values in spec.design.axes.items()}
    ranges = spec.design.sampled if points and not axes else {}
    axes |= {n: np.linspace(*one.ends, (points or {}).get(n, 2)) for n, one in ranges.items()}
    other = [name for name in axes if name not in (needed, *allowed)]
    if needed not in axes or other or not (ranges or spec.design.name == GRID):
        also = f" and, if need be, of {' or '.join(allowed)}" if allowed else " and no other"
        grid = Word('design = "grid" with an axis of', "a list of values for")
        key = f"sample.{other[0] if other else needed}"
        raise spec.refusal(Mistake(key, (f"{purpose} need ", grid, f" {needed}{also}"), ABSENT))
    return axes


def require_memory(what: str, count: int, bytes_each: int) -> None:
    """Raise a ParameterError if `count` things do not fit into this machine's memory."""
    available = physical_memory()
    if count * bytes_each > available:
        raise ParameterError(
            f"{count} {what} need {count * bytes_each / 2**30:.3g} GiB of memory, but this machine "
            f"has {available / 2**30:.3g} GiB: take fewer of them"
        )


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
