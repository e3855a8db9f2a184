"""Totals of the kernels, over any base, in physical units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.kernels.record import Units
from vibrosweep.kernels.separation import Separations
from vibrosweep.kernels.sequence import Orders
from vibrosweep.kernels.statistics import UNCOUNTED, Statistics
from vibrosweep.model.measures import RESOLUTION, UNDETERMINED
from vibrosweep.model.restitution_laws import SPEED, fastest_in_range
from vibrosweep.model.status import Status
from vibrosweep.model.times import Periods, Time, amount, in_periods
from vibrosweep.scene.scene import Scene

Measured = dict[str, NDArray[Any]]


def height_unit(parameters: Mapping[str, Array]) -> Array:
    """Return g / (8 f^2), the height in m of a flight that lasts one forcing period."""
    frequency = parameters["frequency"]
    return np.asarray(parameters["gravity"] / (8.0 * frequency * frequency))


def units_of(parameters: Mapping[str, Array]) -> Units:
    """Return f in Hz, and g / (2 f), the speed in m s-1 whose flight lasts one forcing period."""
    frequency = parameters["frequency"]
    return Units(frequency, parameters["gravity"] / (2.0 * frequency))


def statistics_in_units(
    scene: Scene,
    parameters: Mapping[str, Array],
    found: Statistics,
    of_each: Statistics | None,
    launch_heights: Array,
    lifts: NDArray[np.bool_] | None = None,
    lowest: Array | None = None,
) -> Measured:
    """Return statistics of realizations and of particles, as named in `vibrosweep.model.measures`.

    `found` and `of_each` are those of realizations and of trajectories.  Launches reach the heights
    given in m, of shape (realization, particle), or (realization, 1) where all reach the same.

    `lifts` says whether the base lifts a resting particle, which gives the number of flights; it is
    None if the kernels have counted flights.  The kernels measure heights from `lowest` below the
    mean level of the base.  In the high-bounce limit, where `lowest` is None, their totals hold
    square roots of the greatest heights.
    """
    measured = _physical(found, parameters, lifts, lowest)
    status = np.where(found.counted, found.status, np.int8(Status.REFUSED))
    measured |= {"at_rest_count": found.at_rest, "status": status}
    highest = measured["rebound_height_max"]
    reached = _highest_launches(scene, parameters["frequency"], launch_heights)
    measured["flight_height_max"] = np.fmax(highest, reached)
    if scene.measures.impact_speed:
        measured |= impact_speeds(found, parameters, scene.restitution_law)
    if scene.measures.per_particle and of_each is not None:
        measured |= _of_particles(of_each, parameters, scene.particles, lifts, lowest)
    return measured


def _of_particles(
    found: Statistics,
    parameters: Mapping[str, Array],
    particles: int,
    lifts: NDArray[np.bool_] | None,
    lowest: Array | None,
) -> Measured:
    """Return statistics of particles, shape (realization, particle)."""

    def repeated(values: Any) -> Any:
        return None if values is None else np.repeat(values, particles)

    units = {name: repeated(parameters[name]) for name in ("frequency", "gravity")}
    measured = _physical(found, units, repeated(lifts), repeated(lowest))
    measured |= {"at_rest": found.at_rest.astype(np.int8), "status": found.status}
    # copies, because the next batch overwrites the memory
    return {f"particle_{n}": v.reshape(-1, particles).copy() for n, v in measured.items()}


def _highest_launches(scene: Scene, frequency: Array, heights: Array) -> Array:
    """Return the greatest height of launches in the window; NaN where there is none."""
    launched = _launched_in_window(scene, frequency)
    if heights.shape[1] == 1:  # all launches reach the same height
        launched = np.any(launched, axis=1)[:, np.newaxis]
    reached = np.where(launched, heights, -np.inf).max(axis=1)
    return np.where(reached > -np.inf, reached, np.nan)


def impact_speeds(found: Statistics, parameters: Mapping[str, Array], law: str) -> Measured:
    """Return the greatest speeds of impact, and whether they are in the range of the law."""
    speed = found.total("impact_speed") * units_of(parameters).velocity
    lost = found.status == Status.NON_FINITE
    speed = np.where(lost | (found.landings == 0), np.nan, speed)
    with np.errstate(invalid="ignore"):
        outside = speed > fastest_in_range(law, parameters["restitution"], parameters.get(SPEED))
    decided = outside | (found.status == Status.COMPLETED)
    inside = np.where(decided, ~outside, UNDETERMINED)
    return {"impact_speed_max": speed, "law_in_range": inside.astype(np.int8)}


def separations_in_units(found: Separations, frequency: Array) -> Measured:
    """Return separations of realizations, by the names of `vibrosweep.model.measures`."""
    shared = found.shared
    resolved = np.where(np.isnan(found.gap), UNDETERMINED, found.gap > RESOLUTION)
    return {
        "dt_min": found.gap / frequency,
        "dt_min_resolved": resolved.astype(np.int8),
        "dt_min_same_index": found.same / frequency,
        "base_shared": shared,
        "collision_free": np.where(shared == UNDETERMINED, shared, 1 - shared).astype(np.int8),
    }


def order_in_units(found: Orders, frequency: Array) -> Measured:
    """Return the order of realizations, by the names of `vibrosweep.model.measures`."""
    names = ("order_1", "order_2", "order_3", "order_half", "order_third")
    return {
        **dict(zip(names, found.phases, strict=True)),
        "gap_median": found.gap_median / frequency,
        "gap_min": found.gap_least / frequency,
        "order_changes": found.changes,
    }


def _physical(
    found: Statistics,
    parameters: Mapping[str, Array],
    lifts: NDArray[np.bool_] | None,
    lowest: Array | None,
) -> Measured:
    unit, frequency = height_unit(parameters), parameters["frequency"]
    landings = found.landings
    rests = np.minimum(found.total("rests"), UNCOUNTED).astype(np.int64)
    # where the base lifts no resting particle, a rest is followed by no flight
    flights = found.total("flights") if lifts is None else landings - np.where(lifts, 0, rests)
    roots = lifts is not None and lowest is None
    ground = 0.0 if lowest is None else lowest
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        mean, largest = found.total("height_sum") / flights, found.total("height_max")
        of_flights = {
            "rebound_height_mean": unit * (mean - ground),
            "rebound_height_max": unit * (largest * largest if roots else largest - ground),
            "flight_time_mean": found.total("flight_sum") / flights / frequency,
        }
    # always the same NaN: the sign of 0 / 0 depends on the length of the batch
    known = {name: np.where(flights > 0, v, np.nan) for name, v in of_flights.items()}
    return {"impact_count": landings, "rest_count": rests, **known}


def _launched_in_window(scene: Scene, frequency: Array) -> NDArray[np.bool_]:
    """Return whether particles are launched in the window; shape (realization or 1, particle)."""
    frequency = frequency[:1] if np.all(frequency == frequency[:1]) else frequency
    begin, end = scene.measures.transient, scene.duration
    if isinstance(scene.launch, str):
        particles = scene.particles
        number = np.arange(particles, dtype=np.float64)
        first = _launches_until(begin, particles, frequency)[:, np.newaxis]
        last = _launches_until(end, particles, frequency)[:, np.newaxis]
        return np.asarray((first <= number) & (number <= last))
    times = np.asarray(scene.launch)[np.newaxis, :]
    if not isinstance(begin, Periods) and not isinstance(end, Periods):
        return np.asarray((begin <= times) & (times <= end))
    first, last = (in_periods(time, frequency)[:, np.newaxis] for time in (begin, end))
    periods = frequency[:, np.newaxis] * times
    return np.asarray((first <= periods) & (periods <= last))


def _launches_until(time: Time, particles: int, frequency: Array) -> Array:
    """Return a time in units of the interval between staggered launches."""
    per_time = particles * (np.ones_like(frequency) if isinstance(time, Periods) else frequency)
    return np.asarray(per_time * amount(time))
