"""Motion of a particle from landing to landing: results, the interface of a base, ends of flights.

Results are balls, and the doubles nearest to them.  A base implements `ParticleMotion` and
`PeriodMap`.

A flight ends at the first root of a smooth function, which `first_root` certifies.  In the units of
`vibrosweep.proof.reference.moving`, after leaving at phase x with the relative speed y, the
particle is

    G(s) = s (y - s) / 2 - (alpha / 2) (W(x + s) - W(x) - s w(x))

above the base, of velocity w and height W (`vibrosweep.proof.reference.laws`), after s periods.
A parabola that touches G at any s with G(s) >= 0, and has the largest curvature -G'' within a
step, stays below G during that step.  Steps up to where the parabola comes down pass no root and
converge to the first one from below; each may be twice as long as the last one, because the ball
of a shorter interval gives a better bound on the curvature.  The root at s = 0 is left by a step
that is proved beforehand.  Once G > 0 at one end of an interval, G < 0 at the other and G' < 0
throughout, there is one root inside.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Final, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.model.measures import Status
from vibrosweep.proof.reference.arithmetic import Course, Rows, UncertainError, arb, exact
from vibrosweep.proof.reference.laws import (
    Laws,
    Random,
    Restitution,
)


@dataclass(frozen=True, slots=True)
class ProvedFlight:
    """A flight; every ball contains the exact value."""

    # Ball, speed relative to the base at lift-off, in units of g / 2 f: on a base at rest, the
    # duration of the flight in forcing periods
    speed: arb
    height: arb  # ball, m; its highest point above the mean level of the base
    duration: arb  # ball, forcing periods
    # Derivatives of the duration by phase and speed of the lift-off; None where it equals the speed
    slopes: tuple[float, float] | None


@dataclass(frozen=True, slots=True)
class ProvedImpact:
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
    flight: ProvedFlight | None
    arrival: arb  # ball; speed relative to the base before the impact, in units of g / 2 f


@dataclass(frozen=True)
class Trajectory:
    """All landings of one particle in order of time, with proved error bounds.

    The arrays have shape (impact,); they hold the doubles nearest to the balls' midpoints.
    """

    launch: ProvedFlight  # the flight before the first landing
    # Every landing up to the end of the observation, or up to the budget
    impacts: tuple[ProvedImpact, ...]
    at_rest: bool  # True if the last landing left the particle at rest for good
    # `Status.COMPLETED`, or `Status.BUDGET_EXCEEDED` where more landings follow than the budget
    # allows
    status: Status
    # Precision at which every decision became certain and every ball narrow enough
    precision_bits: int

    def landed(self) -> Iterator[tuple[ProvedFlight, ProvedImpact]]:
        """Yield each landing with the flight that ends with it."""
        flight: ProvedFlight | None = self.launch
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


EPS: Final = 2.0**-53  # one rounding
Pair: TypeAlias = tuple[float, float]
# a mean logarithm, and a bound on its change by the errors of the speeds
Contraction: TypeAlias = tuple[arb | float, float]


class Deviates(NamedTuple):
    """Normal deviates of one particle, as exact numbers."""

    # Deviates of the restitution and of the kick, by the number of the impact, from 0
    of_impact: Callable[[int], Pair]
    of_period: Callable[[int], float]  # of the drive, by the forcing period
    largest: float  # bound on their moduli


@dataclass(frozen=True)
class TrajectoryProblem:
    """Exact inputs of one trajectory, and the accuracy of its results."""

    parameters: dict[str, float]
    launch_time: Fraction
    duration: Fraction
    laws: Laws
    max_impacts: int
    digits: int
    deviates: Deviates | None = None

    @property
    def launched(self) -> arb:
        """Launch time in s, at the current precision."""
        return exact(self.launch_time)

    @property
    def lasting(self) -> arb:
        """Time from the launch to the end of the observation in s, at the current precision."""
        return exact(self.duration) - self.launched

    @cached_property
    def balls(self) -> dict[str, arb]:
        """Parameters as exact balls."""
        return {name: arb(value) for name, value in self.parameters.items()}

    @property
    def driven(self) -> bool:
        """True if the amplitude is random."""
        return self.deviates is not None and self.parameters["drive_noise"] > 0.0

    @property
    def strengths(self) -> tuple[arb, arb]:
        """Largest and smallest amplitude of a forcing period, in units of that without noise."""
        assert self.deviates is not None
        change = self.balls["drive_noise"] * self.deviates.largest
        return 1 + change, 1 - change

    def strength(self, period: int) -> arb:
        """Amplitude of a forcing period, in units of that without noise."""
        if self.deviates is None or not self.driven:
            return arb(1)
        return 1 + self.balls["drive_noise"] * self.deviates.of_period(period)

    def random(self, law: Restitution, impact: int, unit: arb, thrown: bool) -> Restitution:
        """Return a law of restitution with the random numbers of an impact, counted from 1.

        `unit` is the unit of speeds.
        """
        if self.deviates is None:
            return law
        return Random.drawn(law, self.balls, unit, self.deviates.of_impact(impact - 1), thrown)


class ProvedLanding(NamedTuple):
    """A landing."""

    flown: arb  # time since the launch, in the unit of the base
    half_turns: arb  # phase of the forcing, not reduced
    duration: arb  # of the flight that ends with it, forcing periods
    # Derivatives of the duration by phase and speed of lift-off; None where it equals the speed
    slopes: tuple[float, float] | None
    arrival: arb  # speed relative to the base, in units of g / 2 f


class Left(NamedTuple):
    """A launch or lift-off."""

    flown: arb  # time since the launch, in the unit of the base
    rested: bool  # True if the particle stayed on the base before
    velocity: arb  # m s-1
    # Relative to the base, in units of g / 2 f: from a base at rest, a flight of speed 1 lasts one
    # forcing period
    speed: arb
    height: arb  # m, of the highest point of the flight, above the mean level of the base


class ParticleMotion(Protocol):
    """A particle and its base, at one precision."""

    launched: Left
    end: arb  # end of the observation, as time since the launch in the unit of the base

    def time(self, flown: arb) -> arb:
        """Time in s, `flown` after the launch."""

    def land(self, impact: int) -> ProvedLanding:
        """Fly to the next landing; an UncertainError where more precision is needed to find it."""

    def leave(self, impact: int) -> Left | None:
        """Rebound from the landing, perhaps after a rest; None at rest for good.

        Raises an UncertainError where more precision is needed to decide.
        """


class Step(NamedTuple):
    """An impact after which the particle leaves at once, and the flight before it."""

    duration: arb  # of the flight, forcing periods
    speed: arb  # after it, relative to the base
    rows: Rows  # derivative of phase and speed after it by those before the flight
    determinant: arb  # of these


class Carried(NamedTuple):
    """Images of a direction and of its normal under the Jacobian of an impact."""

    # along, across: the images
    along: Pair
    across: Pair
    wrong: float  # bound on the change of `along` by the errors of the state and by rounding
    turned_back: bool  # True if the law of rebound then turns the particle back


class PeriodMap(Protocol):
    """Impacts in forcing periods; states (x, u) are phase and relative speed at lift-off."""

    def step(self, x: arb, u: arb) -> Step | None:
        """Impact of a ball of states; None where one may rest, or a decision is uncertain."""

    def lost(self) -> float:
        """Bits that an impact may cost a ball."""

    def carried(self, x: arb, flight: ProvedFlight, direction: Pair, errors: Pair) -> Carried:
        """Carry a direction through the impact after a flight that sets out from phase x.

        The images are given as doubles; phase and speed of the lift-off are known up to `errors`.
        """

    def contraction(self, speeds: Sequence[arb], error: float) -> Contraction:
        """Mean logarithm of the contraction of areas by impacts with these speeds of arrival.

        Also returns a bound on its change if all speeds of lift-off change by `error`.
        """


MOST_STEPS: Final = 10_000  # a flight takes about ten, and one that grazes the base some dozens
FIRST_STEP: Final = arb(0.125)
# How often, and by how much, an interval about a root is narrowed until it is proved to hold one.
CLOSER: Final = 4
NEARER: Final = arb(2.0**-16)
END: Final = arb.pos_inf()
UNDECIDED: Final = "the flight grazes the base or lands"


def first_root(c: Course, start: arb, impact: int, until: arb = END) -> arb:
    """Return a ball that holds the first root of a positive function, with G' < 0 on all of it.

    There is no root before `start`.  The search ends at `until`; the result is infinite if it has
    found none.  Raises an UncertainError, about that impact, where this precision cannot
    distinguish a graze from a landing.
    """
    s = before = start
    step = FIRST_STEP
    for _ in range(MOST_STEPS):
        if s > until:
            return END
        height, slope = c(0, s), c(1, s)
        if not height > 0:  # the closest approach to the root at this precision
            break
        if slope < 0:
            found = _bracket(c, s, (s - 2 * height / slope).upper())
            if found is not None:
                return found
        down = _down(height.lower(), slope.lower(), -c(2, s.union(s + step)))
        reached = (s + down.min(step)).lower()
        if not reached > s:
            break
        before, s, step = s, reached, 2 * down.min(step)
    width = s - before
    for _ in range(CLOSER):  # there is no root before s
        found = _bracket(c, (s - width).upper(), (s + width).upper())
        if found is not None:
            return found
        width *= NEARER
    raise UncertainError(f"whether {UNDECIDED}", impact)


def _down(height: arb, slope: arb, bend: arb) -> arb:
    """Least time in which a parabola with these initial values comes down to 0."""
    bend = bend.upper().max(arb(0))
    reach = (slope * slope + 2 * bend * height).sqrt()
    if slope < 0:
        return 2 * height / (reach - slope)
    return (slope + reach) / bend if bend > 0 else arb.pos_inf()


def _bracket(c: Course, low: arb, high: arb) -> arb | None:
    """Interval between two times if it is proved to hold exactly one root, a landing."""
    interval = low.union(high)
    proved = c(0, low) > 0 and c(0, high) < 0 and c(1, interval) < 0
    return interval if proved else None
