"""Basins of attraction: the attractor of each launch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis.basin_shape import basin_measures
from vibrosweep.analysis.common import (
    attributes,
    grid_axes,
    note_of,
    require_ability,
    require_memory,
    settling,
    shared,
)
from vibrosweep.analysis.evaluate import lift_off_speeds
from vibrosweep.arrays import Array
from vibrosweep.engine.landings import launch_times
from vibrosweep.engine.orbits import NO_ORBIT, find_orbits, label_orbits, slots
from vibrosweep.engine.workers import Workers
from vibrosweep.kernels.impact import base_of
from vibrosweep.kernels.settle import Orbits
from vibrosweep.kernels.shortest import empty_shortest, shortest_flights
from vibrosweep.model.measures import VARIABLES
from vibrosweep.model.parameters import PARAMETERS, Dimensionless, Launches, dimensionless, taken
from vibrosweep.model.status import Regime
from vibrosweep.model.turns import reduced_turns
from vibrosweep.runs.result import coordinate_attributes
from vibrosweep.scene.scene import Scene

if TYPE_CHECKING:
    from vibrosweep.scene.sweep import Sweep

__all__ = ["basins", "name_of", "summary"]

Codes = NDArray[np.int64]

BYTES_PER_LAUNCH: Final = 300
PLANE: Final = ("launch_velocity", "launch_time")


def basins(sweep: Sweep, threads: int) -> xr.Dataset:
    """Launch a particle at every point of a plane and find its attractor: `vibrosweep.basins`.

    The launch times are those of the sweep's particles, the speeds those of its grid; the result
    holds each once, ascending.  All launches at rest for good are one attractor.  All aperiodic
    launches share one index, and so do all unsettled ones, which are no attractor: ``regime``
    tells.  Raises a SpecError unless the design is a grid of launch velocities.
    """
    require_ability("basins", sweep.scene, sweep.design.sampled)
    speeds = grid_axes(sweep, "basins", "launch_velocity")["launch_velocity"]
    scene = settling(sweep, sweep.scene.inputs["restitution"])
    times = np.unique(launch_times(scene.launch, scene.particles, scene.inputs["frequency"]))
    require_memory("launches", speeds.size * times.size, BYTES_PER_LAUNCH)
    shape = (speeds.size, times.size)
    parameters = scene.parameters({"launch_velocity": np.repeat(speeds, times.size)})
    problem = dimensionless(parameters, scene.duration, scene.measures.transient)
    whole, phase = reduced_turns(scene.inputs["frequency"], np.tile(times, speeds.size), 0.0)
    launch = Launches(whole[:, np.newaxis], phase[:, np.newaxis])
    with Workers(threads) as workers:
        alone = replace(scene.only(), particles=1, launch=tuple(times))
        orbits = find_orbits(problem, launch, alone, workers)
        labels = _labels(orbits)
        first, index, count = _by_frequency(labels)
        landed, speed = _shortest(scene, problem, orbits, first, workers)
    data: dict[str, Any] = {
        "basin": (
            PLANE,
            index.reshape(shape),
            {
                "units": "1",
                "long_name": "index of the attractor that the launch leads to",
                "comment": "launches that are unsettled by regime share one, and reached none",
            },
        ),
        "slot": (PLANE, slots(orbits).reshape(shape), VARIABLES["slot"].attributes),
        **_attractors(orbits, landed, speed, first, count / labels.size),
        **basin_measures(index.reshape(shape), orbits.regime[first], count, speeds),
        **shared(scene, ["launch_velocity"]),
    }
    words = attributes(scene, "Basins of attraction") | {"notes": note_of(scene)}
    words |= {"title": sweep.title, "sweep_file": sweep.text}
    return xr.Dataset(data, _coordinates(times, speeds), words)


def name_of(attractor: xr.Dataset) -> str:
    """Name of one attractor: its regime, and for a cycle its impacts and periods."""
    regime = Regime(int(attractor["regime"]))
    if regime not in (Regime.RESTING, Regime.LOCKED):
        return regime.meaning.replace("_", " ")
    impacts, periods = int(attractor["cycle_impacts"]), int(attractor["cycle_periods"])
    return f"{regime.meaning}, {impacts} in {periods} period{'s' if periods > 1 else ''}"


def summary(found: xr.Dataset) -> Iterator[str]:
    """Say which fraction of the launches leads to each attractor, and how basins interlace."""
    for i in range(found.sizes["attractor"]):
        one = found.isel(attractor=i)
        low, high = float(one["fraction_low"]), float(one["fraction_high"])
        interval = f" ({low:.2%} to {high:.2%})" if np.isfinite(low) else ", on no attractor"
        yield f"{name_of(one):32}{float(one['fraction']):.2%}{interval}"
    entropy, exponent = float(found["basin_entropy"]), float(found["uncertainty_exponent"])
    if np.isfinite(entropy):
        yield f"{'basin entropy':32}{entropy:.3g} nats"
    if np.isfinite(exponent):
        error = float(found["uncertainty_exponent_error"])
        yield f"{'uncertainty exponent':32}{exponent:.3g} +- {error:.1g}"


def _labels(orbits: Orbits) -> Codes:
    """Label of the orbit of each launch; without a cycle one below zero for its regime."""
    labels = label_orbits(orbits, 1)[0]
    return np.where(labels == NO_ORBIT, -1 - orbits.regime.astype(np.int64), labels)


def _by_frequency(labels: Codes) -> tuple[Codes, Codes, Codes]:
    """First launch, index and number of launches of each label, the most frequent label first."""
    _, first, inverse, count = np.unique(
        labels, return_index=True, return_inverse=True, return_counts=True
    )
    order = np.lexsort((first, -count))
    rank = np.empty_like(order)
    rank[order] = np.arange(order.size)
    return first[order], rank[inverse], count[order]


def _shortest(
    scene: Scene, problem: Dimensionless, orbits: Orbits, first: Codes, workers: Workers
) -> tuple[Array, Array]:
    """Phase of landing in turns, and speed at lift-off in m/s, before each shortest flight.

    Of the attractors that the launches `first` lead to; NaN where an attractor is no cycle.
    """
    recurs = orbits.impacts[first] > 0
    rows = first[recurs]
    own = taken(problem, rows)
    base, found = base_of(*scene.mechanics), empty_shortest(rows.size)
    states = (orbits.phase[rows], orbits.flight[rows], orbits.impacts[rows])
    workers.each(
        lambda begin, end: shortest_flights(begin, end, base, own, *states, found),
        rows.size,
        16,
        found,
    )
    landed, speed = (np.full(first.size, np.nan) for _ in range(2))
    landed[recurs] = found.landed
    speed[recurs] = lift_off_speeds(scene.base, own, found.left, found.speed)
    return landed, speed * (scene.inputs["gravity"] / (2.0 * scene.inputs["frequency"]))


def _attractors(
    orbits: Orbits, landed: Array, speed: Array, first: Codes, fraction: Array
) -> dict[str, Any]:
    """Variables along the dim attractor, from the first launch that leads to each."""
    recurs = orbits.impacts[first] > 0
    same = recurs | (orbits.regime[first] == Regime.AT_REST)
    exponent = np.where(same, orbits.largest[first], np.nan)
    values = {
        "regime": (orbits.regime[first], VARIABLES["regime"].attributes),
        "cycle_impacts": (orbits.impacts[first], VARIABLES["cycle_impacts"].attributes),
        "cycle_periods": (orbits.periods[first], VARIABLES["cycle_periods"].attributes),
        "cycle_rests": (orbits.rests[first], VARIABLES["cycle_rests"].attributes),
        "fraction": (fraction, {"units": "1", "long_name": "fraction of launches in the basin"}),
        "lyapunov_largest": (
            exponent,
            VARIABLES["lyapunov_largest"].attributes
            | {"comment": "NaN where orbits do not repeat: each has its own"},
        ),
        "impact_phase": (
            landed,
            {"units": "1", "long_name": "phase in turns of the impact before the shortest flight"},
        ),
        "rebound_velocity": (
            speed,
            {"units": "m s-1", "long_name": "speed at the lift-off to the shortest flight"},
        ),
    }
    return {name: ("attractor", *value) for name, value in values.items()}


def _coordinates(times: Array, speeds: Array) -> dict[str, Any]:
    words = coordinate_attributes(PARAMETERS["launch_velocity"])
    return {
        "launch_time": ("launch_time", times, {"units": "s", "long_name": "time of launch"}),
        "launch_velocity": ("launch_velocity", speeds, words),
    }
