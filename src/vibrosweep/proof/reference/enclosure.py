"""Sets of states that turn and shrink with an orbit (Lohner's method)."""

from __future__ import annotations

from typing import Final, TypeAlias

from vibrosweep.proof.reference._flint import arb, ctx

# Derivative of an image by a state: two rows of two.
Rows: TypeAlias = tuple[tuple[arb, arb], tuple[arb, arb]]

ZERO, ONE = arb(0), arb(1)
# The frame of an enclosure only shapes the error bound: a few more bits than its radius has.
FRAME_BITS: Final = 64


class Enclosure:
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
        """Replace v by -v: the box of errors is symmetric, so the frame's angle changes sign."""
        self.speed, self._sin = self.speed.neg(exact=True), self._sin.neg(exact=True)
