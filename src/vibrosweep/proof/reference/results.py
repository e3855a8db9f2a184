"""Results of the proved reference: balls, and the doubles nearest to them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.model.status import Status
from vibrosweep.proof.reference._flint import arb


@dataclass(frozen=True, slots=True)
class Flight:
    """A flight; every ball contains the exact value."""

    # Ball, speed relative to the base at lift-off, in units of g / 2 f: on a base at rest, the
    # duration of the flight in forcing periods
    speed: arb
    height: arb  # ball, m; its highest point above the mean level of the base
    duration: arb  # ball, forcing periods
    # Derivatives of the duration by phase and speed of the lift-off; None where it equals the speed
    slopes: tuple[float, float] | None


@dataclass(frozen=True, slots=True)
class Impact:
    """One landing and the lift-off that follows; every ball contains the exact value."""

    landing_time: arb  # ball, s
    # liftoff_time, rebound_velocity: balls, s and m s-1; None where the particle is at rest for
    # good
    liftoff_time: arb | None
    rebound_velocity: arb | None
    rested: bool  # True if the particle stayed on the base
    # count, phase: phase of the forcing at the landing: whole periods, and a ball in turns around a
    # midpoint in [-1/2, 1/2]
    count: int
    phase: arb
    # The flight after lift-off, also where it ends after the observation; None at rest for good
    flight: Flight | None
    arrival: arb  # ball; speed relative to the base before the impact, in units of g / 2 f


@dataclass(frozen=True)
class Trajectory:
    """All landings of one particle in order of time, with proved error bounds.

    The arrays have shape (impact,); they hold the doubles nearest to the balls' midpoints.
    """

    launch: Flight  # the flight before the first landing
    # Every landing up to the end of the observation, or up to the budget
    impacts: tuple[Impact, ...]
    at_rest: bool  # True if the last landing left the particle at rest for good
    # `Status.COMPLETED`, or `Status.BUDGET_EXCEEDED` where more landings follow than the budget
    # allows
    status: Status
    # Precision at which every decision became certain and every ball narrow enough
    precision_bits: int

    def landed(self) -> Iterator[tuple[Flight, Impact]]:
        """Yield each landing with the flight that ends with it."""
        flight: Flight | None = self.launch
        for impact in self.impacts:
            if flight is not None:
                yield flight, impact
            flight = impact.flight

    @cached_property
    def rested(self) -> NDArray[np.bool_]:
        """Flags of landings after which the particle stayed on the base."""
        return np.array([impact.rested for impact in self.impacts], dtype=np.bool_)

    @cached_property
    def landing_time(self) -> Array:
        """Landing times in s."""
        return _doubles(impact.landing_time for impact in self.impacts)

    @cached_property
    def liftoff_time(self) -> Array:
        """Lift-off times in s; NaN at rest for good."""
        return _doubles(impact.liftoff_time for impact in self.impacts)

    @cached_property
    def rebound_velocity(self) -> Array:
        """Velocities after lift-off in m s-1; NaN at rest for good."""
        return _doubles(impact.rebound_velocity for impact in self.impacts)


def _doubles(balls: Iterable[arb | None]) -> Array:
    return np.array([math.nan if ball is None else float(ball) for ball in balls], np.float64)
