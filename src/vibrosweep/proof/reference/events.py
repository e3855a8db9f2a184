"""Events on a base of finite mass, and the particles that may take part in one.

The units are those of `vibrosweep.proof.reference.mount`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from vibrosweep.proof.reference._flint import arb
from vibrosweep.proof.reference.drives import Mount
from vibrosweep.proof.reference.landing import END, Course, narrowed
from vibrosweep.proof.reference.laws import Impact

LAUNCH, LANDING, LIFTOFF = "launch", "landing", "lift-off"


class Bodies(NamedTuple):
    """The moving bodies: the base on its mount, and identical particles."""

    mount: Mount
    restitution: Impact
    r: arb  # relative speed at and below which a particle sticks where the base presses it
    u0: arb  # velocity of a launch
    # Law of restitution of an impact with its random numbers, by the particle and the number of its
    # impact, from 0; None where nothing is random
    drawn: Callable[[int, int], Impact] | None = None


class Event(NamedTuple):
    """An event of one particle."""

    kind: str  # `LAUNCH`, `LANDING`, or `LIFTOFF` of a rider
    particle: int  # its number
    turns: arb  # phase of the forcing, whole periods included
    height: arb  # of the base and the particle
    # before, after: velocity of the particle
    before: arb
    after: arb
    # base_before, base: velocity of the base, before and afterwards
    base_before: arb
    base: arb
    # Speed of the particle relative to the base, if it leaves; None if it stays
    relative: arb | None
    number: int  # number of landings so far, of all particles
    riders: int  # number of particles that ride afterwards
    # deviation, rate: D and D' afterwards
    deviation: arb
    rate: arb


@dataclass(eq=False)
class Flying:
    """Particles that left the base together and fly as one."""

    particles: tuple[int, ...]  # their numbers
    # gap, speed: height and speed relative to the base
    gap: arb
    speed: arb
    lifted: bool = False  # True if the base pressed them until they left
    # Time before which they cannot land; None where that is the time of the last event
    clear: arb | None = None


class Launch(NamedTuple):
    """Particles that are launched at one instant, in the order of their numbers."""

    turns: arb
    particles: tuple[int, ...]


class Corner(NamedTuple):
    """A corner of the velocity of the drive."""

    turns: arb


class Riders(NamedTuple):
    """Particles that ride the base and may leave it."""

    particles: tuple[int, ...]


class Next(NamedTuple):
    """An event that may be the next one, `s` periods after the present instant.

    The function `course` has its first root at that time; None where the time is known.
    """

    s: arb
    what: Launch | Corner | Flying | Riders
    course: Course | None = None

    def narrowed(self) -> Next:
        """Return the event with its time as narrow as the precision allows."""
        if self.course is None:
            return self
        return self._replace(s=narrowed(self.course, self.s))

    def __str__(self) -> str:
        if isinstance(self.what, Corner):
            return "a corner of the drive"
        does = {Launch: "launch", Flying: "landing", Riders: "lift-off"}[type(self.what)]
        numbers = " and ".join(map(str, self.what.particles))
        return f"the {does} of particle {numbers}"


def latest_start(found: Sequence[Next]) -> arb:
    """Time after which an event cannot be the next one."""
    return min((one.s.upper() for one in found), default=END)
