"""The first root of a smooth function, certified; the flight that meets the moving base again.

In the units of `vibrosweep.proof.reference.moving`, after leaving at phase x with the relative
speed y, the particle is

    G(s) = s (y - s) / 2 - (alpha / 2) (W(x + s) - W(x) - s w(x))

above the base, of velocity w and height W (`vibrosweep.proof.reference.waves`), after s periods.
G'' >= -(1 + Gamma), where Gamma bounds alpha |w'| / 2.  For a while G'', G''' and a bound on the
next derivative give a better bound, even where both are close to 0, as when a base of little more
than 1 g throws a particle for a moment.  A base of finite mass (`vibrosweep.proof.reference.mount`)
has such bounds too.

So a parabola of this curvature that touches G at any s with G(s) >= 0 stays below it; steps to
where the parabola comes down pass no root and converge to the first one from below.  While the
particle is above every height of the base there is no root, and one step goes to the end of that
time.  The root at s = 0 is left by a step that is proved beforehand.  Once G > 0 at one end of an
interval, G < 0 at the other and G' < 0 throughout, there is one root inside, and the interval
Newton operator (Moore 1966) narrows it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Protocol

from vibrosweep.proof.reference._flint import arb
from vibrosweep.proof.reference.decisions import UncertainError
from vibrosweep.proof.reference.waves import AtLiftoff, Bounds, Wave, next_of

# Steps; a flight takes about ten, and one that passes close above the base some dozens.
MOST_STEPS: Final = 1000
SHORTENING: Final = arb(1.0 - 2.0**-8)  # shortens the time above all heights of the base
# How often, and by how much, an interval about a root is narrowed until it is proved to hold one.
CLOSER: Final = 4
NEARER: Final = arb(2.0**-16)
END: Final = arb.pos_inf()
UNDECIDED: Final = "the flight grazes the base or lands"


class Course(Protocol):
    """A function of time, positive until its first root."""

    def height(self, s: arb) -> arb:
        """Value."""

    def slope(self, s: arb) -> arb:
        """Derivative."""

    def curvature(self, s: arb) -> tuple[arb, arb, arb, arb]:
        """Return c, minus the second derivative; its derivative c'; a bound on c'' and one on c."""

    def above_all(self) -> tuple[arb, arb] | None:
        """Interval of time without a root, if one is known."""
        return None


@dataclass(frozen=True)
class Clearance:
    """Height above the base during flights that set out from a ball of states."""

    wave: Wave
    alpha: arb  # factor of the velocity of the base
    # x, y: phase in turns and relative speed at lift-off
    x: arb
    y: arb
    presses: Callable[[], Sequence[arb]] = tuple  # phases at which the base begins to press

    @cached_property
    def bounds(self) -> Bounds:
        """Bounds of the shape."""
        return self.wave.bounds

    @cached_property
    def gamma(self) -> arb:
        """Bound on the acceleration of the base, in units of gravity."""
        return self.alpha * self.bounds.steep / 2

    @cached_property
    def at_liftoff(self) -> AtLiftoff:
        """Shape at the phase of the lift-off."""
        return self.wave.at_liftoff(2 * self.x)

    def height(self, s: arb) -> arb:
        """G(s)."""
        return s * (self.y - s) / 2 - self.alpha / 2 * self.wave.rise(self.at_liftoff, s)

    def slope(self, s: arb) -> arb:
        """G'(s), half the speed relative to the base."""
        return self.y / 2 - s - self.alpha / 2 * self.wave.gain(self.at_liftoff, s)

    def bend(self, s: arb) -> arb:
        """Minus the second derivative, positive where the base presses a particle lying on it."""
        return 1 + self.alpha / 2 * self.wave.slope(2 * (self.x + s))

    def curvature(self, s: arb) -> tuple[arb, arb, arb, arb]:
        """As `Course.curvature`."""
        if self.bounds.bend.is_zero():  # the second derivative jumps
            return 1 + self.gamma, arb(0), arb(0), 1 + self.gamma
        rate = self.alpha / 2 * self.wave.rate(2 * (self.x + s))
        return self.bend(s), rate, self.alpha / 2 * self.bounds.jolt, 1 + self.gamma

    def start(self) -> arb | None:
        """Time before which there is no root; None if uncertain."""
        if self.bend(arb(0)) < 0 and (self.y > 0 or self.y.is_zero()):
            # the base falls away until it presses again
            until = (next_of(self.presses(), self.x, 0) - self.x).lower()
            return until if until > 0 else None
        return (self.y / (2 * (1 + self.gamma))).lower() if self.y > 0 else None

    def above_all(self) -> tuple[arb, arb] | None:
        """Interval of time in which the particle is above every height of the base."""
        u = self.y + self.alpha * self.wave.velocity(2 * self.x)
        below = self.bounds.top - self.wave.level(2 * self.x)
        root = u * u - 4 * self.alpha * below
        if not (u > 0 and root > 0):
            return None
        return ((u - root.sqrt()) / 2).upper(), ((u + SHORTENING * root.sqrt()) / 2).lower()


def first_root(c: Course, start: arb, impact: int, until: arb = END) -> arb:
    """Return a ball that holds the first root, with G' < 0 on all of it.

    There is no root before `start`.  The search ends at `until`; the result is infinite if it has
    found none.  Raises an UncertainError, about that impact, where this precision cannot
    distinguish a graze from a landing.
    """
    clear = c.above_all()
    s, before = start, start
    for _ in range(MOST_STEPS):
        if s > until:
            return END
        height, slope = c.height(s), c.slope(s)
        if not height > 0:  # the closest approach to the root at this precision
            break
        if slope < 0:
            found = _bracket(c, s, (s - 2 * height / slope).upper())
            if found is not None:
                return found
        reached = (s + _step(c, s, height.lower(), slope.lower())).lower()
        if clear is not None and clear[0] < reached < clear[1]:
            reached = clear[1]
        if not reached > s:
            break
        before, s = s, reached
    width = s - before
    for _ in range(CLOSER):  # there is no root before s
        found = _bracket(c, (s - width).upper(), (s + width).upper())
        if found is not None:
            return found
        width *= NEARER
    raise UncertainError(f"whether {UNDECIDED}", impact)


def _step(c: Course, s: arb, height: arb, slope: arb) -> arb:
    """Step that passes no root, from lower bounds of G(s), which is positive, and G'(s)."""
    now, rate, growth, largest = c.curvature(s)
    tried = step = _down(height, slope, largest)
    while tried < 1:
        tried = 4 * tried
        then = now + tried * (rate + growth * tried / 2)
        bend = now.max(then).min(largest)  # largest curvature during the step that is tried
        down = _down(height, slope, bend)
        if not down > tried:
            return step.max(down.min(tried))
        step = tried
    return step


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
    proved = c.height(low) > 0 and c.height(high) < 0 and c.slope(interval) < 0
    return interval if proved else None


def narrowed(c: Course, root: arb) -> arb:
    """Narrow a ball that holds a root and on which G' < 0, as far as the precision goes."""
    while True:
        middle = root.mid()
        newton = middle - c.height(middle) / c.slope(root)
        closer = root.intersection(newton)
        if not 2 * closer.rad() < root.rad():
            return closer
        root = closer
