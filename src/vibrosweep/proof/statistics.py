"""Statistics of landings and of the flights that follow: their proof, and what is claimed of them.

A running statistic of the kernels (`vibrosweep.kernels.statistics`) has its definition in ball
arithmetic here, and the largest error that the bounds of a dataset allow it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import Final, NamedTuple, TypeAlias

from vibrosweep.proof.reference._flint import arb
from vibrosweep.proof.reference.ball import Trajectory
from vibrosweep.proof.sample import Realization

__all__ = [
    "EPS",
    "Flights",
    "Landing",
    "Proved",
    "flights_of",
    "landings_of",
    "largest",
    "largest_height",
    "launch_depth",
    "statistics",
    "statistics_claims",
]

EPS: Final = 2.0**-53
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


class Flights(NamedTuple):
    """Sums over the flights that follow landings."""

    landings: int
    rests: int
    speeds: list[arb]
    squares: arb


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
        )
        for particle, trajectory in enumerate(trajectories)
        for number, impact in enumerate(trajectory.impacts)
    ]
    return sorted(landings, key=lambda landing: landing.time.mid())


def flights_of(landings: Iterable[Landing]) -> Flights:
    """Sum over the flights that follow landings."""
    listed = list(landings)
    speeds = [x.speed for x in listed if x.speed is not None]
    squares = sum((speed * speed for speed in speeds), arb(0))
    return Flights(len(listed), sum(x.rested for x in listed), speeds, squares)


def statistics(flights: Flights, gravity: arb) -> dict[str, Proved]:
    """Measures of flights, the same for a realization and for one particle."""
    number, fastest = len(flights.speeds), largest(flights.speeds)
    mean_square = mean_time = highest = None
    if fastest is not None:
        mean_square = flights.squares / number / (2 * gravity)
        mean_time = 2 * sum(flights.speeds, arb(0)) / number / gravity
        highest = fastest * fastest / (2 * gravity)
    return {
        "impact_count": flights.landings,
        "rest_count": flights.rests,
        "rebound_height_mean": mean_square,
        "rebound_height_max": highest,
        "flight_time_mean": mean_time,
    }


def largest_height(flights: Flights, realization: Realization) -> Proved:
    """Height of the highest flight, a launch in the window among them."""
    speeds = list(flights.speeds)
    if launch_depth(realization) >= 0:
        speeds.append(arb(realization.parameters["launch_velocity"]))
    fastest = largest(speeds)
    return None if fastest is None else fastest**2 / (2 * arb(realization.parameters["gravity"]))


def launch_depth(realization: Realization) -> Fraction:
    """Time between a launch and the nearer edge of the window, the largest of all launches."""
    begin, end = Fraction(realization.transient), Fraction(realization.duration)
    return max(min(time - begin, end - time) for time in realization.launch_times)


def largest(balls: Iterable[arb]) -> arb | None:
    """Largest of some balls; None of none."""
    found = None
    for ball in balls:
        found = ball if found is None else found.max(ball)
    return found


def statistics_claims(
    error: float, realization: Realization, fastest: arb | None, longest: int
) -> dict[str, float | None]:
    """Largest errors of statistics, of a realization and of each particle.

    Parameters
    ----------
    error
        Bound of the error of every rebound velocity, m s-1.
    scene
        The realization.
    fastest, longest
        As in `vibrosweep.proof.measured.Measured`.
    """
    gravity, launch = realization.parameters["gravity"], realization.parameters["launch_velocity"]
    rounding = (longest + len(realization.launch_times) + 10) * EPS
    v = 0.0 if fastest is None else float(fastest)
    most, height = max(v, launch), (2.0 * v * error + error * error) / (2.0 * gravity)
    height += rounding * most * most / (2.0 * gravity)
    claimed: dict[str, float | None] = {
        "impact_count": 0.0,
        "rest_count": 0.0,
        "rebound_height_mean": height,
        "rebound_height_max": height,
        "flight_time_mean": (2.0 * error + rounding * 2.0 * v) / gravity,
    }
    of_each = {f"particle_{name}": claim for name, claim in claimed.items()}
    return {**claimed, **of_each, "flight_height_max": height}
