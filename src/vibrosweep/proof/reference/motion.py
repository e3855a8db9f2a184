"""What a base answers about the particle that it throws, landing after landing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Final, NamedTuple, Protocol, TypeAlias

from vibrosweep.proof.reference._flint import arb, exact
from vibrosweep.proof.reference.enclosure import Rows
from vibrosweep.proof.reference.results import Flight

EPS: Final = 2.0**-53  # one rounding
Pair: TypeAlias = tuple[float, float]
# a mean logarithm, and a bound of its change by the errors of the speeds
Contraction: TypeAlias = tuple[arb | float, float]


@dataclass(frozen=True)
class Problem:
    """One trajectory's exact inputs and the radii asked for."""

    parameters: dict[str, float]
    launch_time: Fraction
    duration: Fraction
    rebound: str
    max_impacts: int
    digits: int

    @property
    def digits_bits(self) -> int:
        """Relative accuracy in bits that gives the digits."""
        return math.ceil(self.digits * math.log2(10.0)) + 2

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
        """Parameters, exact."""
        return {name: arb(value) for name, value in self.parameters.items()}


class Landed(NamedTuple):
    """A landing.

    Attributes
    ----------
    flown
        Time since the launch, in the unit of the base.
    half_turns
        Phase of the forcing, not reduced.
    duration
        Of the flight that ends with it, forcing periods.
    slopes
        Derivatives of that by phase and speed of its beginning; None where it is that speed.
    """

    flown: arb
    half_turns: arb
    duration: arb
    slopes: tuple[float, float] | None


class Left(NamedTuple):
    """A launch or lift-off.

    Attributes
    ----------
    flown
        Time since the launch, in the unit of the base.
    rested
        Whether the particle stayed on the base before.
    velocity
        m s-1.
    speed
        Relative to the base; the unit is that whose flight from a base at rest lasts one forcing
        period, g / 2 f.
    height
        m, of the highest point of the flight, above the mean level of the base.
    """

    flown: arb
    rested: bool
    velocity: arb
    speed: arb
    height: arb


class Motion(Protocol):
    """A particle and its base, at one precision.

    Attributes
    ----------
    launched
        The launch.
    end
        End of the observation, as time since the launch in the unit of the base.
    """

    launched: Left
    end: arb

    def time(self, flown: arb) -> arb:
        """Time in s that long after the launch."""

    def land(self, impact: int) -> Landed:
        """Fly to the next landing; an UncertainError where more precision is needed to find it."""

    def leave(self, impact: int) -> Left | None:
        """Rebound from it, perhaps after a rest; None at rest for good.

        Raises an UncertainError where more precision is needed to decide.
        """


class Step(NamedTuple):
    """An impact after which the particle leaves at once, and the flight before it.

    Attributes
    ----------
    duration
        Of the flight, forcing periods.
    speed
        After it, relative to the base.
    rows
        Derivative of phase and speed after it by those before the flight.
    determinant
        Of these.
    """

    duration: arb
    speed: arb
    rows: Rows
    determinant: arb


class Carried(NamedTuple):
    """Images of a direction and of its normal by the Jacobian of an impact.

    Attributes
    ----------
    along, across
        The images.
    wrong
        Bound of the change of the first by the errors of the state and of doubles.
    turned_back
        Whether the law of rebound then turns the particle back.
    """

    along: Pair
    across: Pair
    wrong: float
    turned_back: bool


class PeriodMap(Protocol):
    """Impacts in forcing periods; states (x, u) are phase and relative speed at lift-off."""

    def step(self, x: arb, u: arb) -> Step | None:
        """Impact of a ball of states; None where one may rest, or a decision is open."""

    def lost(self) -> float:
        """Bits that an impact may cost a ball."""

    def carried(self, x: arb, flight: Flight, direction: Pair, errors: Pair) -> Carried:
        """Carry a direction through the impact after a flight that sets out from phase x.

        In doubles, which know phase and speed of the lift-off up to `errors`.
        """

    def contraction(self, speeds: Sequence[arb], error: float) -> Contraction:
        """Mean logarithm of what impacts after flights of these speeds leave of an area.

        Also a bound of its change where all speeds change by `error`.
        """
