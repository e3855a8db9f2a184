"""What happens on a base of finite mass: the events, and the particles that may take part in one.

The units are those of `vibrosweep.proof.reference.mount`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from vibrosweep.proof.reference._flint import arb
from vibrosweep.proof.reference.landing import END, Course, narrowed
from vibrosweep.proof.reference.mount import Mount

LAUNCH, LANDING, LIFTOFF = "launch", "landing", "lift-off"


class Bodies(NamedTuple):
    """What moves: the base on its mount, and identical particles.

    Attributes
    ----------
    mount
        The base.
    e
        Restitution.
    r
        Relative speed at and below which a particle sticks where the base presses it.
    u0
        Velocity of a launch.
    """

    mount: Mount
    e: arb
    r: arb
    u0: arb


class Event(NamedTuple):
    """What happened to one particle.

    Attributes
    ----------
    kind
        `LAUNCH`, `LANDING`, or `LIFTOFF` of a rider.
    particle
        Its number.
    turns
        Phase of the forcing, whole periods included.
    height
        Of the base and the particle.
    before, after
        Velocity of the particle.
    base_before, base
        Velocity of the base, before and afterwards.
    relative
        Speed of the particle relative to the base, if it leaves; None if it stays.
    number
        Number of landings so far, of all particles.
    riders
        Number of particles that ride afterwards.
    deviation, rate
        D and D' afterwards.
    """

    kind: str
    particle: int
    turns: arb
    height: arb
    before: arb
    after: arb
    base_before: arb
    base: arb
    relative: arb | None
    number: int
    riders: int
    deviation: arb
    rate: arb


@dataclass(eq=False)
class Flying:
    """Particles that left the base together and fly as one.

    Attributes
    ----------
    particles
        Their numbers.
    gap, speed
        Height and speed relative to the base.
    lifted
        Whether the base pressed them until they left.
    clear
        Time before which they have not landed; None where that is the last event.
    """

    particles: tuple[int, ...]
    gap: arb
    speed: arb
    lifted: bool = False
    clear: arb | None = None


class Launch(NamedTuple):
    """Particles that are launched at one instant, in the order of their numbers."""

    turns: arb
    particles: tuple[int, ...]


class Riders(NamedTuple):
    """Those that ride the base and may leave it."""

    particles: tuple[int, ...]


class Next(NamedTuple):
    """An event that may be the next one, so long after the present instant.

    `course` is what then has its first root; None where the time is known.
    """

    s: arb
    what: Launch | Flying | Riders
    course: Course | None = None

    def narrowed(self) -> Next:
        """Return it with its time as narrow as the precision allows."""
        if self.course is None:
            return self
        return self._replace(s=narrowed(self.course, self.s))

    def __str__(self) -> str:
        does = {Launch: "launch", Flying: "landing", Riders: "lift-off"}[type(self.what)]
        numbers = " and ".join(map(str, self.what.particles))
        return f"the {does} of particle {numbers}"


def latest_start(found: Sequence[Next]) -> arb:
    """Time after which an event cannot be the next one."""
    return min((one.s.upper() for one in found), default=END)
