"""Statistics of landings and of the flights that follow: their proof and their claims.

A running statistic of the kernels (`vibrosweep.kernels.statistics`) has its definition in ball
arithmetic here, and the largest error that the bounds of a dataset allow it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from functools import reduce
from typing import NamedTuple, TypeAlias

from vibrosweep.proof.reference._flint import arb
from vibrosweep.proof.reference.motion import EPS
from vibrosweep.proof.reference.results import Flight, Trajectory
from vibrosweep.proof.sample import Realization

# A ball, an exact count, code or double, or None where the variable is undefined (NaN stored).
Proved: TypeAlias = "arb | int | float | None"


class Landing(NamedTuple):
    """A landing in the window, or an earlier one whose stay reaches into it."""

    particle: int
    number: int
    time: arb
    stay_end: arb
    speed: arb | None
    rested: bool
    flight: Flight | None


class Flights(NamedTuple):
    """Sums over the flights that follow landings."""

    landings: int
    rests: int
    speeds: list[arb]
    flights: list[Flight]


def landings_of(realization: Realization, trajectories: Sequence[Trajectory]) -> list[Landing]:
    """All landings in the order of time."""
    contact = arb(realization.parameters["contact_time"])
    landings = [
        Landing(
            particle=particle,
            number=number,
            time=impact.landing_time,
            stay_end=arb.pos_inf()
            if impact.liftoff_time is None
            else impact.liftoff_time.max(impact.landing_time + contact),
            speed=impact.rebound_velocity,
            rested=impact.rested,
            flight=impact.flight,
        )
        for particle, trajectory in enumerate(trajectories)
        for number, impact in enumerate(trajectory.impacts)
    ]
    return sorted(landings, key=lambda landing: landing.time.mid())


def flights_of(landings: Iterable[Landing]) -> Flights:
    """Sum over the flights that follow landings."""
    listed = list(landings)
    speeds = [x.speed for x in listed if x.speed is not None]
    flights = [x.flight for x in listed if x.flight is not None]
    return Flights(len(listed), sum(x.rested for x in listed), speeds, flights)


def arrivals_of(trajectories: Sequence[Trajectory], begin: arb) -> Iterator[tuple[Flight, arb]]:
    """Yield the flight and the speed of arrival, in units of g / 2 f, of each landing since."""
    for trajectory in trajectories:
        flight: Flight | None = trajectory.launch
        for impact in trajectory.impacts:
            if flight is not None and impact.landing_time >= begin:
                yield flight, impact.arrival
            flight = impact.flight


def statistics(flights: Flights, frequency: arb) -> dict[str, Proved]:
    """Measures of flights, the same for a realization and for one particle."""
    heights, number = [flight.height for flight in flights.flights], len(flights.flights)
    mean_height = mean_time = None
    if number > 0:
        mean_height = sum(heights, arb(0)) / number
        mean_time = sum((f.duration for f in flights.flights), arb(0)) / number / frequency
    return {
        "impact_count": flights.landings,
        "rest_count": flights.rests,
        "rebound_height_mean": mean_height,
        "rebound_height_max": largest(heights),
        "flight_time_mean": mean_time,
    }


def largest_height(
    flights: Flights, realization: Realization, trajectories: Sequence[Trajectory]
) -> Proved:
    """Height of the highest flight, launches in the window among them."""
    begin, end = realization.transient, realization.duration
    launches = zip(realization.launch_times, trajectories, strict=True)
    launched = [t.launch.height for time, t in launches if begin <= time <= end]
    return largest(launched + [flight.height for flight in flights.flights])


def launch_depth(realization: Realization) -> Fraction:
    """Time between a launch and the nearer edge of the window, the largest of all launches."""
    begin, end = Fraction(realization.transient), Fraction(realization.duration)
    return max(min(time - begin, end - time) for time in realization.launch_times)


def largest(balls: Iterable[arb]) -> arb | None:
    """Largest of some balls; None without any."""
    listed = list(balls)
    return reduce(arb.max, listed) if listed else None


class LandingErrors(NamedTuple):
    """Largest errors of the numbers of a `vibrosweep.model.landing.Landing`, in its units."""

    phase: float
    flight_time: float
    arrival: float
    rebound: float


class Uncertainty(NamedTuple):
    """Bounds of the errors of flights."""

    velocity: float  # of every rebound velocity, m s-1
    height: float  # of the height of the base at every lift-off, m
    duration: float  # of every duration, s


def statistics_claims(
    error: Uncertainty,
    realization: Realization,
    flights: Sequence[Flight],
    fastest: arb | None,
    longest: int,
) -> dict[str, float | None]:
    """Largest errors of the statistics of a realization and of each particle.

    They follow from bounds of the errors of flights; the flights, the fastest and the longest are
    those of `vibrosweep.proof.measures.ProvedMeasures`.
    """
    p = realization.parameters
    gravity, launch = p["gravity"], p["launch_velocity"]
    rounding = (longest + len(realization.launch_times) + 10) * EPS
    v = 0.0 if fastest is None else float(fastest)
    raised = realization.velocity / (2.0 * math.pi * p["frequency"])
    lasting = max((float(flight.duration) for flight in flights), default=0.0) / p["frequency"]
    most = max(v, launch) ** 2 / (2.0 * gravity) + raised
    height = (2.0 * v * error.velocity + error.velocity**2) / (2.0 * gravity)
    height += error.height + rounding * most
    claimed: dict[str, float | None] = {
        "impact_count": 0.0,
        "rest_count": 0.0,
        "rebound_height_mean": height,
        "rebound_height_max": height,
        "flight_time_mean": error.duration + rounding * lasting,
    }
    of_each = {f"particle_{name}": claim for name, claim in claimed.items()}
    return {**claimed, **of_each, "flight_height_max": height}
