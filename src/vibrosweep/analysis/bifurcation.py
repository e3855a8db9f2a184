"""Bifurcation diagram along the forcing, each orbit continued from the previous point."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis.common import KEPT as ALWAYS_HELD
from vibrosweep.analysis.common import (
    attributes,
    batch_from,
    grid_axes,
    launch_states,
    meaning,
    reached,
    require_ability,
    require_memory,
    settle_from,
    settling,
    shared,
)
from vibrosweep.arrays import Array
from vibrosweep.engine.landings import recorded
from vibrosweep.engine.measure import orbit_variables
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.record import Record, Units
from vibrosweep.kernels.settle import Orbits
from vibrosweep.kernels.unwritten import unwritten
from vibrosweep.model.forcing import FORCINGS, forcing_of
from vibrosweep.model.measures import VARIABLES
from vibrosweep.model.parameters import HIGH_BOUNCE, MAX_PERIODS
from vibrosweep.model.shapes import SINE, TWO_PI
from vibrosweep.model.status import Regime
from vibrosweep.runs.result import coordinate_attributes, short_observation
from vibrosweep.scene.scene import Scene

if TYPE_CHECKING:
    from vibrosweep.scene.sweep import Sweep

__all__ = ["OBSERVABLES", "OfImpacts", "bifurcation", "summary"]

# phase of landing in turns, speed at lift-off in m s-1, gravity in m s-2 -> the observable
OfImpacts = Callable[[Array, Array, float], Array]


class Impacts(NamedTuple):
    """Impacts of orbits, each array of one shape."""

    phase: Array  # of the forcing at landing, turns
    speed: Array  # at lift-off, m s-1
    # Highest point of the next flight, above the mean level of the base, m
    height: Array
    time: Array  # duration of the next flight, s


DIRECTIONS: Final = ("up", "down")
BYTES_PER_IMPACT, BYTES_PER_ORBIT = 18, 130
OBSERVABLES: Final = {
    "rebound_velocity": ("speed", "m s-1", "velocity at lift-off"),
    "rebound_height": ("height", "m", "rebound height"),
    "flight_time": ("time", "s", "flight time"),
    "impact_phase": ("phase", "1", "phase of the forcing at landing, turns"),
}
KEPT: Final = (
    "regime",
    "cycle_impacts",
    "cycle_periods",
    "cycle_rests",
    "lyapunov_largest",
    "lyapunov_largest_error",
)


def bifurcation(
    sweep: Sweep, observable: str | OfImpacts, samples: int, threads: int
) -> xr.Dataset:
    """Follow the orbits of a sweep's particles up and down the forcing: `vibrosweep.bifurcation`.

    At the first point of each direction particles are launched as the scene says; at every further
    point they start from the state reached at the previous one.  They settle until they recur or
    the duration is over, and then `samples` further impacts are kept.  Orbits that ``regime`` calls
    unsettled may still approach an attractor.  Raises a SpecError unless the only axis of the
    design is a forcing.
    """
    require_ability("bifurcation", sweep.scene, sweep.design.sampled)
    forcing = forcing_of(sweep.design.sampled)
    a = grid_axes(sweep, "bifurcation diagrams", forcing)[forcing]
    scene = settling(sweep, sweep.scene.inputs["restitution"])
    if not callable(observable) and observable not in tuple(OBSERVABLES):
        known = f"{', '.join(OBSERVABLES)}, or a function"
        raise ParameterError(f"observable = {observable!r}: must be one of {known}")
    name = "observable" if callable(observable) else observable
    field, units, words = OBSERVABLES.get(name, ("", "1", name))
    order = np.stack([a, a[::-1]])
    shape = (len(DIRECTIONS), a.size, scene.particles)
    bytes_each = BYTES_PER_ORBIT + BYTES_PER_IMPACT * samples
    require_memory(f"orbits with {samples} samples each", math.prod(shape), bytes_each)
    values = unwritten((*shape, samples))
    measured: dict[str, NDArray[Any]] = {}
    states = launch_states(scene, scene.parameters({forcing: order[:, 0]}))
    with Workers(threads) as workers:
        for i in range(a.size):
            parameters = scene.parameters({forcing: order[:, i]})
            orbits = settle_from(scene, parameters, states, workers)
            states = reached(orbits, scene.particles)
            impacts = _impacts(scene, parameters, orbits, samples, workers)
            at = (np.arange(len(DIRECTIONS)), np.array([i, a.size - 1 - i]))
            if callable(observable):
                values[at] = observable(impacts.phase, impacts.speed, scene.inputs["gravity"])
            else:
                values[at] = getattr(impacts, field)
            found = orbit_variables(orbits, parameters["frequency"])
            for kept in KEPT:
                array = measured.setdefault(kept, unwritten(shape, found[kept].dtype))
                array[at] = found[kept]
    dims = ("direction", forcing, "particle", "sample")
    data: dict[str, Any] = {n: (dims[:-1], v, VARIABLES[n].attributes) for n, v in measured.items()}
    data[name] = (dims, values, meaning(words, units))
    quantities = scene.quantities({forcing: a})
    coordinates: dict[str, Any] = {
        n: (forcing, quantities[n], coordinate_attributes(FORCINGS[n]))
        for n in (forcing, *ALWAYS_HELD)
    }
    inputs = scene.inputs
    notes = short_observation(scene, inputs["restitution"], inputs["frequency"])
    return xr.Dataset(
        data | shared(scene, [forcing]),
        {"direction": list(DIRECTIONS), **coordinates},
        attributes(sweep, scene, notes, forcing=forcing, observable=name),
    )


def summary(diagram: xr.Dataset) -> Iterator[str]:
    """Describe the shares of the regimes, in one line for each direction."""
    along = diagram.attrs["forcing"].removeprefix("base_")
    for direction in diagram["direction"].values:
        regimes = diagram["regime"].sel(direction=direction).values.ravel()
        parts = [
            f"{one.meaning.replace('_', ' ')} {np.mean(regimes == one):.1%}"
            for one in Regime
            if np.any(regimes == one)
        ]
        yield f"{f'{along} {direction}':24}{', '.join(parts)}"


def _impacts(
    scene: Scene, parameters: dict[str, Array], orbits: Orbits, samples: int, workers: Workers
) -> Impacts:
    """Impacts after the states that orbits have reached; arrays (point, particle, sample)."""
    problem, launch = batch_from(scene, parameters, reached(orbits, scene.particles))
    count = orbits.phase.size
    problem = problem._replace(end_count=np.full(count, MAX_PERIODS))
    frequency, gravity = (
        np.repeat(parameters[name], scene.particles)[:, np.newaxis]
        for name in ("frequency", "gravity")
    )
    # with a frequency of 1, times are in forcing periods
    units = Units(np.ones(count), np.ravel(gravity / (2.0 * frequency)))
    landings = samples + 1  # the last flight ends with one more landing
    alone = replace(scene.recorded(landings), particles=1, launch=(0.0,))
    flat, _ = recorded(problem, launch, alone, workers, units, np.full(count, landings))
    out = Record._make(values.reshape(count, landings) for values in flat)
    shape = (-1, scene.particles, samples)
    speed, left = out.rebound_velocity[:, :samples], out.liftoff_time[:, :samples]
    height, time = speed**2 / (2.0 * gravity), 2.0 * speed / gravity
    if scene.base != HIGH_BOUNCE:
        velocity = (problem.kick / (1.0 + problem.restitution))[:, np.newaxis]
        unit = gravity / (4.0 * np.pi * frequency**2)
        rising, wave = np.maximum(speed, 0.0), scene.waveform
        level = -np.cos(2.0 * np.pi * left) if wave == SINE else TWO_PI * wave.height(left)
        height = rising**2 / (2.0 * gravity) + unit * velocity * level
        time = (out.landing_time[:, 1:] - left) / frequency
    # a particle at permanent rest makes no impact
    landed = np.where(np.isnan(left), np.nan, out.landing_time[:, :samples])
    phase = landed - np.rint(landed)
    return Impacts(*(values.reshape(shape) for values in (phase, speed, height, time)))
