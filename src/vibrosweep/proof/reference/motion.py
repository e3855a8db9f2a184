"""Interface of a base: the motion of a particle from landing to landing, and its period map."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Final, NamedTuple, Protocol, TypeAlias

from vibrosweep.proof.reference._flint import arb, exact
from vibrosweep.proof.reference.enclosure import Rows
from vibrosweep.proof.reference.laws import Impact, Laws, Random
from vibrosweep.proof.reference.results import Flight

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
class Problem:
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

    def random(self, law: Impact, impact: int, unit: arb, thrown: bool) -> Impact:
        """Return a law of restitution with the random numbers of an impact, counted from 1.

        `unit` is the unit of speeds.
        """
        if self.deviates is None:
            return law
        p, (slip, push) = self.balls, self.deviates.of_impact(impact - 1)
        moved = (1 + p["restitution"]) * p["kick_noise"] * push / unit
        return Random(law, p["restitution_noise"] * slip, moved, thrown)


class Landed(NamedTuple):
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


class Motion(Protocol):
    """A particle and its base, at one precision."""

    launched: Left
    end: arb  # end of the observation, as time since the launch in the unit of the base

    def time(self, flown: arb) -> arb:
        """Time in s, `flown` after the launch."""

    def land(self, impact: int) -> Landed:
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

    def carried(self, x: arb, flight: Flight, direction: Pair, errors: Pair) -> Carried:
        """Carry a direction through the impact after a flight that sets out from phase x.

        The images are given as doubles; phase and speed of the lift-off are known up to `errors`.
        """

    def contraction(self, speeds: Sequence[arb], error: float) -> Contraction:
        """Mean logarithm of the contraction of areas by impacts with these speeds of arrival.

        Also returns a bound on its change if all speeds of lift-off change by `error`.
        """
