"""Statistics of landings and of the flights that follow, in ball arithmetic.

These are the definitions of the running statistics of the kernels
(`vibrosweep.kernels.statistics`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import reduce
from typing import NamedTuple, TypeAlias

from vibrosweep.proof.reference._flint import arb
from vibrosweep.proof.reference.results import Flight, Impact, Trajectory
from vibrosweep.proof.sample import Realization

# A ball, an exact count, code or double, or None where the variable is undefined (NaN stored).
Proved: TypeAlias = "arb | int | float | None"


class Landing(NamedTuple):
    """A landing in the window, or an earlier one whose stay reaches into it."""

    particle: int
    number: int
    time: arb
    stay_end: arb
    impact: Impact


class Flights(NamedTuple):
    """Numbers of landings and rests, and the rebounds and flights that follow."""

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
            impact=impact,
        )
        for particle, trajectory in enumerate(trajectories)
        for number, impact in enumerate(trajectory.impacts)
    ]
    return sorted(landings, key=lambda landing: landing.time.mid())


def flights_of(landings: Iterable[Landing]) -> Flights:
    """Collect the rebounds and flights that follow landings."""
    impacts = [landing.impact for landing in landings]
    speeds = [i.rebound_velocity for i in impacts if i.rebound_velocity is not None]
    flights = [i.flight for i in impacts if i.flight is not None]
    return Flights(len(impacts), sum(i.rested for i in impacts), speeds, flights)


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


def largest(balls: Iterable[arb]) -> arb | None:
    """Largest of some balls; None if there are none."""
    listed = list(balls)
    return reduce(arb.max, listed) if listed else None


def size_of(proved: Proved | list[Proved]) -> float:
    """Largest absolute value; 0 where none is defined."""
    values = proved if isinstance(proved, list) else [proved]
    return max((abs(float(value)) for value in values if value is not None), default=0.0)


class LandingErrors(NamedTuple):
    """Largest errors of the numbers of a `vibrosweep.model.landing.Landing`, in its units."""

    phase: float
    flight_time: float
    arrival: float
    rebound: float
