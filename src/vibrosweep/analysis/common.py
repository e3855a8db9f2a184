"""Tools of analyses that call the engine: axes, attributes and variables of a result."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from vibrosweep import theory
from vibrosweep.abilities import refusal
from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError
from vibrosweep.mistakes import ABSENT, Mistake, Word
from vibrosweep.model.forcing import FORCINGS, INPUTS, differing
from vibrosweep.model.measures import Variable
from vibrosweep.model.parameters import STREAM, Periods, in_seconds
from vibrosweep.model.restitution_laws import CONSTANT
from vibrosweep.runs.result import TIMES, attributes_of_scene, coordinate_attributes
from vibrosweep.scene.design import GRID
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import Sweep
from vibrosweep.system import physical_memory

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


def attributes(sweep: Sweep, scene: Scene, notes: str = "", **others: Any) -> dict[str, Any]:
    """Attributes of a result: its sweep, its scene apart from the inputs, remarks, and others."""
    return {
        "title": sweep.title,
        "particles": scene.particles,
        "launch": scene.launch if isinstance(scene.launch, str) else np.asarray(scene.launch),
        "impact_budget": scene.measures.impact_budget,
        **attributes_of_scene(scene),
        **others,
        "notes": notes,
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
        name: ((), values[0], coordinate_attributes(INPUTS[name]))
        for name, values in found.items()
        if name not in differ
    }
    for name, time in scene.times.items():
        fixed[name] = ((), in_seconds(time, found["frequency"])[0], TIMES[name])
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
        wrong = Mistake(
            f"sample.{other[0]}" if other else "sample.design",
            (f"{purpose} need ", grid, f" {needed}{also}"),
            ABSENT if other else spec.design.name,
        )
        raise spec.refusal(wrong)
    return axes


def require_memory(what: str, count: int, bytes_each: int) -> None:
    """Raise a ParameterError if `count` things do not fit into this machine's memory."""
    available = physical_memory()
    if count * bytes_each > available:
        raise ParameterError(
            f"{count} {what} need {count * bytes_each / 2**30:.3g} GiB of memory, but this machine "
            f"has {available / 2**30:.3g} GiB: take fewer of them"
        )
