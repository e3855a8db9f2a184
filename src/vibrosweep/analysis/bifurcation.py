"""Bifurcation diagram along the forcing: orbits continued from point to point, and new launches."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

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
from vibrosweep.kernels.memory import unwritten
from vibrosweep.kernels.record import Record, Units
from vibrosweep.kernels.settle import Orbits
from vibrosweep.mistakes import argument
from vibrosweep.model.forcing import FORCINGS, forcing_of
from vibrosweep.model.measures import VARIABLES, Regime
from vibrosweep.model.parameters import HIGH_BOUNCE, MAX_PERIODS, STAGGERED
from vibrosweep.model.shapes import SINE, TWO_PI
from vibrosweep.runs.result import attributes_of, short_observation
from vibrosweep.scene.scene import Scene
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
MORE: Final = 4  # times as many samples are kept of an aperiodic orbit, which fills an interval
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
    sweep: Sweep, observable: str | OfImpacts, samples: int, launches: int, threads: int
) -> xr.Dataset:
    """Continue the orbits of a sweep's particles up and down the forcing: `vibrosweep.bifurcation`.

    At the first point of each direction particles are launched as the scene says; at every further
    point they start from the state reached at the previous one.  They settle until they recur or
    the duration is over, and then `samples` further impacts are kept, `MORE` times as many of an
    aperiodic orbit.  As many staggered particles as `launches` says are launched at every point.
    Orbits that ``regime`` calls unsettled may still approach an attractor.  Raises a SpecError
    unless the only axis of the design is a forcing.
    """
    require_ability("bifurcation", sweep.scene, sweep.design.sampled)
    forcing = forcing_of(sweep.design.sampled)
    a = grid_axes(sweep, "bifurcation diagrams", forcing)[forcing]
    scene = settling(sweep, sweep.scene.inputs["restitution"])
    if not callable(observable) and observable not in tuple(OBSERVABLES):
        known = f"{', '.join(OBSERVABLES)}, or a function"
        rule = f"{observable!r}: must be one of {known}"
        raise ParameterError(argument("observable"), rule)
    name = "observable" if callable(observable) else observable
    field, units, words = OBSERVABLES.get(name, ("", "1", name))
    many = replace(scene, particles=launches, launch=STAGGERED)
    orbits_each = len(DIRECTIONS) * scene.particles + launches
    bytes_each = BYTES_PER_ORBIT + BYTES_PER_IMPACT * samples * MORE
    require_memory(f"orbits with {samples} samples each", a.size * orbits_each, bytes_each)

    def observed(scene: Scene, parameters: dict[str, Array], orbits: Orbits) -> Array:
        impacts = _impacts(scene, parameters, orbits, samples * MORE, workers)
        if callable(observable):
            return np.asarray(observable(impacts.phase, impacts.speed, scene.inputs["gravity"]))
        return np.asarray(getattr(impacts, field))

    order = np.stack([a, a[::-1]])
    values = unwritten((len(DIRECTIONS), a.size, scene.particles, samples * MORE))
    states = launch_states(scene, scene.parameters({forcing: order[:, 0]}))
    followed: list[Orbits] = []
    with Workers(threads) as workers:
        for i in range(a.size):
            parameters = scene.parameters({forcing: order[:, i]})
            followed.append(settle_from(scene, parameters, states, workers))
            states = reached(followed[-1], scene.particles)
            at = (np.arange(len(DIRECTIONS)), np.array([i, a.size - 1 - i]))
            values[at] = observed(scene, parameters, followed[-1])
        parameters = scene.parameters({forcing: a})
        anew = settle_from(many, parameters, launch_states(many, parameters), workers)
        launched = np.array(observed(many, parameters, anew), np.float64)
    found = orbit_variables(_together(followed, anew, a.size), parameters["frequency"])
    data = _regimes(found, scene.particles, forcing) | _coexistence(found, forcing, a)
    chaos = float(data["chaos_high"][1])
    for prefix, impacts in (("", values), ("launched_", launched)):
        axes, regimes, _ = data[f"{prefix}regime"]
        impacts[regimes != Regime.APERIODIC, samples:] = np.nan
        kept = impacts[..., : samples * MORE if math.isfinite(chaos) else samples]
        data[f"{prefix}{name}"] = ((*axes, "sample"), kept, meaning(words, units))
    quantities = scene.quantities({forcing: a})
    coordinates: dict[str, Any] = {
        n: (forcing, quantities[n], attributes_of(n)) for n in (forcing, *ALWAYS_HELD)
    }
    inputs = scene.inputs
    notes = short_observation(scene, inputs["restitution"], inputs["frequency"])
    return xr.Dataset(
        data | shared(scene, [forcing]),
        {"direction": list(DIRECTIONS), **coordinates},
        attributes(sweep, scene, notes, forcing=forcing, observable=name),
    )


def _together(followed: Sequence[Orbits], anew: Orbits, points: int) -> Orbits:
    """Continued orbits, up and down, and new launches, in the order of the points."""

    def joined(of_steps: Sequence[NDArray[Any]], fresh: Any) -> NDArray[Any]:
        each = np.array(of_steps).reshape(points, len(DIRECTIONS), -1)
        parts = each[:, 0], each[::-1, 1], fresh.reshape(points, -1)
        return np.concatenate(parts, axis=1).ravel()

    pairs = zip(zip(*followed, strict=True), anew, strict=True)
    return Orbits._make(joined(steps, fresh) for steps, fresh in pairs)


def _regimes(found: Mapping[str, NDArray[Any]], particles: int, forcing: str) -> dict[str, Any]:
    """Variables of continued orbits, and of new launches, as by `_together`."""
    data: dict[str, Any] = {}
    for name in KEPT:
        up, down, anew = np.split(found[name], [particles, 2 * particles], axis=1)
        attrs = VARIABLES[name].attributes
        data[name] = (("direction", forcing, "particle"), np.stack([up, down]), attrs)
        data[f"launched_{name}"] = ((forcing, "launch"), anew, attrs)
    return data


def _coexistence(found: Mapping[str, NDArray[Any]], forcing: str, a: Array) -> dict[str, Any]:
    """Number of attractors at each point, and where the first positive exponent lies."""
    aperiodic, at_rest = (
        found[f"{regime.meaning}_count"] > 0 for regime in (Regime.APERIODIC, Regime.AT_REST)
    )
    words = meaning("number of different attractors that were found")
    words["comment"] = "all aperiodic orbits count as one; unsettled ones do not count"
    ends = np.full(2, np.nan)
    if aperiodic.any():
        first = int(np.argmax(aperiodic))
        ends[:] = a[first - 1] if first else np.nan, a[first]
    units = FORCINGS[forcing].units
    return {
        "attractors": (forcing, found["orbit_count"] + at_rest + aperiodic, words),
        "chaos_low": ((), ends[0], meaning("last point before the first positive exponent", units)),
        "chaos_high": ((), ends[1], meaning("first point with a positive exponent", units)),
    }


def summary(diagram: xr.Dataset) -> Iterator[str]:
    """Describe the shares of the regimes, attractors that coexist, and where chaos begins."""
    along, forcing = diagram.attrs["forcing"].removeprefix("base_"), diagram.attrs["forcing"]
    each = {f"{along} {one}": diagram["regime"].sel(direction=one) for one in DIRECTIONS}
    each["new launches"] = diagram["launched_regime"]
    for name, regimes in each.items():
        parts = [
            f"{one.meaning.replace('_', ' ')} {np.mean(regimes.values == one):.1%}"
            for one in Regime
            if np.any(regimes.values == one)
        ]
        yield f"{name:24}{', '.join(parts)}"
    several = diagram[forcing].values[diagram["attractors"].values > 1]
    ends = f", from {several[0]:.6g} to {several[-1]:.6g}" if several.size else ""
    yield f"{'several attractors':24}at {several.size} of {diagram[forcing].size} values{ends}"
    low, high = (float(diagram[f"chaos_{end}"]) for end in ("low", "high"))
    first = f"at {high:.6g}" if np.isnan(low) else f"above {low:.6g}, at most at {high:.6g}"
    yield f"{'positive exponent':24}{'none was found' if np.isnan(high) else f'first {first}'}"


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
    # a particle at rest for good makes no impact
    landed = np.where(np.isnan(left), np.nan, out.landing_time[:, :samples])
    phase = landed - np.rint(landed)
    return Impacts(*(values.reshape(shape) for values in (phase, speed, height, time)))
