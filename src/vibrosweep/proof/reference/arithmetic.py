"""Ball arithmetic: numbers, decisions, sets of states, and derivatives.

The one place where python-flint is imported.  A decision that is uncertain requests more precision
(`decided`); an `OrbitEnclosure` is a set of states that turns and shrinks with an orbit (Lohner's
method); a `Jet` is a ball with its derivatives by several variables (automatic differentiation,
forward).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Final, TypeAlias, TypeVar

from vibrosweep.errors import VibrosweepError


class MissingFlintError(VibrosweepError, ImportError):
    """The proved reference needs python-flint, which is not installed."""


class UndecidableError(VibrosweepError, ArithmeticError):
    """A decision, or the requested digits, stayed uncertain at the largest precision.

    Either two numbers that the model compares are equal (a tie: no precision can tell which is
    larger unless both are exact), or the orbit loses more digits than the precision holds.

    Attributes
    ----------
    decision
        The uncertain decision, in words.
    impact
        Number of the impact, from 1.
    bits
        Largest precision that was tried.
    """

    def __init__(self, decision: str, impact: int, bits: int) -> None:
        super().__init__(
            f"impact {impact}: {decision} stays uncertain at {bits} bits: if this is an exact tie, "
            f"change a parameter by a rounding unit; if the orbit loses more digits than that, "
            f"raise max_bits, shorten the duration or request fewer digits"
        )
        self.decision = decision
        self.impact = impact
        self.bits = bits


try:
    from flint import acb as acb
    from flint import arb as arb
    from flint import arb_mat as arb_mat
    from flint import ctx as ctx
    from flint import fmpq
except ImportError as error:
    raise MissingFlintError(
        "the proved reference computes in ball arithmetic with python-flint, which is not "
        'installed: pip install "vibrosweep[verify]"'
    ) from error


# A ball, an exact count, code or double, or None where the variable is undefined (NaN stored).
Proved: TypeAlias = "arb | int | float | None"


def exact(number: float | Fraction) -> arb:
    """Ball that holds a number; its radius is 0 for a double."""
    if isinstance(number, Fraction):
        return arb(fmpq(number.numerator, number.denominator))
    return arb(number)


T = TypeVar("T")
HALF = arb(0.5)
GUARD_BITS: Final = 64


class UncertainError(Exception):
    """More precision is needed to decide `decision` at impact `impact`."""

    def __init__(self, decision: str, impact: int) -> None:
        super().__init__(decision, impact)
        self.decision = decision
        self.impact = impact


def certain_above(left: arb, right: arb, decision: str, impact: int) -> bool:
    """Decide left > right, or raise `UncertainError`."""
    if left > right:
        return True
    if left <= right:
        return False
    raise UncertainError(f"whether {decision}", impact)


class WidthLimits:
    """Check that results are as narrow as a number of digits requires.

    Attributes
    ----------
    bits
        Relative accuracy that is enough for any result.
    phase, time, velocity
        Radii that are enough for less accurate results: in turns or periods, s, and m s-1.
    """

    def __init__(self, digits: int, parameters: Mapping[str, float]) -> None:
        self.bits = accuracy_bits(digits)
        self.phase = arb(10) ** -digits
        self.time = self.phase * arb(parameters["contact_time"])
        self.velocity = self.time * arb(parameters["gravity"]) / 2

    def require(self, impact: int, *found: tuple[arb, arb]) -> None:
        """Raise `UncertainError` unless all results, each given with its radius, are narrow."""
        for ball, radius in found:
            if not (ball.rel_accuracy_bits() >= self.bits or ball.rad() <= radius):
                raise UncertainError("a result to the requested digits", impact)


def accuracy_bits(digits: int) -> int:
    """Relative accuracy in bits that gives the digits."""
    return math.ceil(digits * math.log2(10.0)) + 2


def nearest_integer(ball: arb) -> int:
    """Integer next to the midpoint: a choice of representation, so never uncertain."""
    return int((ball.mid() + HALF).mid().floor().fmpz())  # the sum may round


# Derivative of a function, of an order from 0 up; a ball of arguments gives bounds
Course: TypeAlias = Callable[[int, arb], arb]


def narrowed(c: Course, root: arb) -> arb:
    """Narrow a ball that holds one zero, and in which the slope has one sign, to the precision.

    The interval Newton operator (Moore 1966) narrows it, or the sign in the middle halves it.
    """
    while True:
        middle = root.mid()
        off, slopes = c(0, middle), c(1, root)
        closer = root.intersection(middle - off / slopes)
        if not 2 * closer.rad() < root.rad() and (off > 0 or off < 0):
            before = bool(off > 0) == bool(slopes > 0)
            closer = (root.lower() if before else root.upper()).union(middle)
        if not 4 * closer.rad() < 3 * root.rad():  # at the precision, a half has rounded ends
            return closer
        root = closer


def first_precision(digits: int) -> int:
    """Precision in bits at which results to these digits are tried first."""
    return GUARD_BITS * (2 + accuracy_bits(digits) // GUARD_BITS)


def decided(attempt: Callable[[int], T], bits: int, max_bits: int) -> T:
    """Return the result of an attempt at the lowest precision that decides everything.

    The precision starts at `bits` and is doubled.  Raises an UndecidableError where `max_bits` is
    not enough.
    """
    while True:
        try:
            return attempt(bits)
        except UncertainError as uncertain:
            if 2 * bits > max_bits:
                raise UndecidableError(uncertain.decision, uncertain.impact, bits) from None
        bits *= 2


# Derivative of an image by a state: two rows of two.
Rows: TypeAlias = tuple[tuple[arb, arb], tuple[arb, arb]]

ZERO, ONE = arb(0), arb(1)
# The frame of an enclosure only shapes the error bound: a few more bits than its radius has.
FRAME_BITS: Final = 64


class OrbitEnclosure:
    """All states (V, v) = centre + frame (r1, r2): the orbit's state is proved to be one of them.

    V is the time flown and v a speed, in units of the base.  Plain balls grow at each impact by the
    absolute values of the Jacobian's entries, even on an orbit that contracts.  Here the centre is
    mapped as a point, and the error around it by the Jacobian in a frame that turns with the flow
    (Lohner's method: mean-value form and rotation), so it grows at the orbit's own rate: a locked
    orbit needs the same precision at any length.

    The set begins as the product of the balls `flown` and `speed`.

    Attributes
    ----------
    flown, speed
        The centre, exact numbers.
    bits
        Precision with which the centre is computed: bits far below the error carry no information,
        so a chaotic orbit needs fewer and fewer.
    """

    __slots__ = ("_cos", "_r1", "_r2", "_sin", "bits", "flown", "speed")

    def __init__(self, flown: arb, speed: arb) -> None:
        self.flown, self.speed = flown.mid(), speed.mid()
        self._r1, self._r2 = flown - self.flown, speed - self.speed
        self._cos, self._sin = ONE, ZERO
        self.bits = ctx.prec

    def change(self, by_flown: arb, by_speed: arb) -> arb:
        """Ball of the changes within the set of a quantity that has these derivatives over it."""
        along, across = self._columns(by_flown, by_speed)
        return along * self._r1 + across * self._r2

    def _columns(self, by_flown: arb, by_speed: arb) -> tuple[arb, arb]:
        """One row of the Jacobian times the frame."""
        cos, sin = self._cos, self._sin
        return by_flown * cos + by_speed * sin, by_speed * cos - by_flown * sin

    def turn(self, flown: arb, speed: arb, rows: Rows) -> None:
        """Map the set: `flown`, `speed` hold the image of the centre, `rows` the Jacobians over it.

        The new frame lies along the image of the first axis.  It may be any pair of exact numbers;
        its determinant, 1 up to rounding, is divided out, so that it need not be orthogonal.
        """
        (p1, q1), (p2, q2) = (self._columns(*row) for row in rows)
        r1, r2 = self._r1, self._r2
        self.flown, self.speed = flown.mid(), speed.mid()
        d1, d2 = flown - self.flown, speed - self.speed
        squared = p1 * p1 + p2 * p2
        cos, sin = ONE, ZERO
        if squared > 0:
            scale = squared.rsqrt()
            cos, sin = (p1 * scale).mid(), (p2 * scale).mid()
        determinant = cos * cos + sin * sin
        along = (cos * p1 + sin * p2) * r1 + (cos * q1 + sin * q2) * r2 + cos * d1 + sin * d2
        across = (cos * p2 - sin * p1) * r1 + (cos * q2 - sin * q1) * r2 + cos * d2 - sin * d1
        self._r1, self._r2 = along / determinant, across / determinant
        self._cos, self._sin = cos, sin

    def mirror(self) -> None:
        """Replace v by -v."""
        self.turn(self.flown, -self.speed, ((ONE, ZERO), (ZERO, -ONE)))


class Jet:
    """A ball that holds a function of some variables, and balls that hold its derivatives."""

    __slots__ = ("d", "v")

    def __init__(self, v: arb, d: Sequence[arb]) -> None:
        self.v, self.d = v, d

    def __add__(self, other: Jet | arb | int) -> Jet:
        if isinstance(other, Jet):
            return Jet(self.v + other.v, [a + b for a, b in zip(self.d, other.d, strict=True)])
        return Jet(self.v + other, self.d)

    __radd__ = __add__

    def __neg__(self) -> Jet:
        return Jet(-self.v, [-a for a in self.d])

    def __sub__(self, other: Jet | arb | int) -> Jet:
        return self + -other

    def __rsub__(self, other: arb | int) -> Jet:
        return -self + other

    def __mul__(self, other: Jet | arb | int) -> Jet:
        if isinstance(other, Jet):
            v, w = self.v, other.v
            d = [a * w + v * b for a, b in zip(self.d, other.d, strict=True)]
            return Jet(v * w, d)
        return Jet(self.v * other, [a * other for a in self.d])

    __rmul__ = __mul__

    def __truediv__(self, other: Jet | arb | int) -> Jet:
        if isinstance(other, Jet):
            ratio = self.v / other.v
            d = [(a - ratio * b) / other.v for a, b in zip(self.d, other.d, strict=True)]
            return Jet(ratio, d)
        return Jet(self.v / other, [a / other for a in self.d])

    def __rtruediv__(self, other: arb | int) -> Jet:
        ratio = other / self.v
        return Jet(ratio, [-ratio * a / self.v for a in self.d])


def variables(values: Sequence[arb]) -> list[Jet]:
    """Return independent variables."""
    n = len(values)
    return [Jet(v, [arb(int(i == k)) for i in range(n)]) for k, v in enumerate(values)]
