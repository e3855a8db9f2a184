"""One impact in ball arithmetic, and a rigorous set of states that the map is applied to.

The state is kept in velocities: the rebound speed v, and the sum V of the speeds since the launch,
which is the time flown in units of 2 / g.  With every parameter an exact double

    V' = V + v         w = e v + A sin(2 pi (f t0 + phi / 2 pi + (2 f / g) V'))

so landing before the end, 2 V' <= g (T - t0), and rest, w <= g tau_c / 2, compare numbers that no
division has made inexact.  Without excitation V and v stay exact while they fit the precision, and
even a tie is decided.  The dimensionless map is the case g = 2, f = 1, phi = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

from vibrosweep.proof.reference._flint import arb, ctx

__all__ = ["BallMap", "Enclosure", "nearest_integer"]

HALF = arb(0.5)
ZERO, ONE = arb(0), arb(1)

# The frame of an enclosure only shapes the error bound: a few more bits than its radius has.
FRAME_BITS = 64


def nearest_integer(ball: arb) -> int:
    """Integer next to the midpoint: a choice of representation, so never uncertain."""
    return int((ball.mid() + HALF).floor().fmpz())


@dataclass(frozen=True)
class BallMap:
    """The map's parameters as balls; half turns, because sin(pi h) needs no multiplication.

    Attributes
    ----------
    restitution, amplitude
        e and A (m s-1).
    half_turns_at_launch
        2 f t0 + phi / pi.
    half_turn_rate, gravity
        4 f and g.  The phase is 4 f V / g as a quotient, which is exact where the result is: a
        landing on a zero of the sine is then recognised as one.
    slope
        Largest derivative of the kick by V, pi A 4 f / g.
    """

    restitution: arb
    amplitude: arb
    half_turns_at_launch: arb
    half_turn_rate: arb
    gravity: arb
    slope: arb

    def half_turns(self, flown: arb) -> arb:
        """Phase of the forcing, not reduced, when V is `flown`."""
        return self.half_turns_at_launch + self.half_turn_rate * flown / self.gravity

    def impact(self, flown: arb, speed: arb) -> tuple[arb, arb]:
        """V' at the landing, and w, after a flight that starts with `speed` at V = `flown`."""
        landed = flown + speed
        kick = self.amplitude * self.half_turns(landed).sin_pi()
        return landed, self.restitution * speed + kick


class Enclosure:
    """All states (V, v) = centre + frame (r1, r2): the orbit's state is proved to be one of them.

    Plain balls grow at each impact by the absolute values of the Jacobian's entries, even on an
    orbit that contracts.  Here the centre is mapped as a point, and the error around it by the
    Jacobian in a frame that turns with the flow (Lohner's method: mean-value form and rotation), so
    it grows at the orbit's own rate: a locked orbit needs the same precision at any length.

    The exact states set out from `flown` and `speed`, both balls.
    """

    __slots__ = ("_cos", "_flown", "_r1", "_r2", "_sin", "_speed", "_useful")

    def __init__(self, flown: arb, speed: arb) -> None:
        self._flown, self._speed = flown.mid(), speed.mid()
        self._r1, self._r2 = flown - self._flown, speed - self._speed
        self._cos, self._sin = ONE, ZERO
        self._useful = ctx.prec

    def impact(self, m: BallMap) -> tuple[arb, arb, arb]:
        """Map the set; return V', its phase in half turns and w as balls around all its states."""
        full = ctx.prec
        # bits far below the error carry nothing: a chaotic orbit needs fewer as it loses them
        ctx.prec = bits = min(full, self._useful)
        landed, w = m.impact(self._flown, self._speed)
        ctx.prec = FRAME_BITS
        # columns of Jacobian times frame; the Jacobian is [[1, 1], [s, e + s]]
        p1, q1 = self._cos + self._sin, self._cos - self._sin
        flown_error = p1 * self._r1 + q1 * self._r2
        ctx.prec = bits
        flown_ball = landed + flown_error
        half_turns = m.half_turns(flown_ball)
        ctx.prec = FRAME_BITS
        s = m.slope * half_turns.cos_pi()
        p2 = s * p1 + m.restitution * self._sin
        q2 = s * q1 + m.restitution * self._cos
        speed_error = p2 * self._r1 + q2 * self._r2
        self._flown, self._speed = landed.mid(), w.mid()
        self._turn(p1, q1, p2, q2, landed - self._flown, w - self._speed)
        ctx.prec = full
        self._useful = max(0, flown_ball.rel_accuracy_bits()) + 2 * FRAME_BITS
        return flown_ball, half_turns, w + speed_error

    def _turn(self, p1: arb, q1: arb, p2: arb, q2: arb, d1: arb, d2: arb) -> None:
        """Express the set in a frame along the image (p1, p2) of the first axis.

        (d1, d2) is the rounding of the centre.  The new frame is any pair of exact numbers; its
        determinant, 1 up to rounding, is divided out, so nothing is assumed of it.
        """
        squared = p1 * p1 + p2 * p2
        cos, sin = ONE, ZERO
        if squared > 0:
            scale = squared.rsqrt()
            cos, sin = (p1 * scale).mid(), (p2 * scale).mid()
        determinant = cos * cos + sin * sin
        r1, r2 = self._r1, self._r2
        along = (cos * p1 + sin * p2) * r1 + (cos * q1 + sin * q2) * r2 + cos * d1 + sin * d2
        across = (cos * p2 - sin * p1) * r1 + (cos * q2 - sin * q1) * r2 + cos * d2 - sin * d1
        self._r1, self._r2 = along / determinant, across / determinant
        self._cos, self._sin = cos, sin

    def mirror(self) -> None:
        """Replace v by -v: the box of errors is symmetric, so the frame's angle changes sign."""
        self._speed, self._sin = self._speed.neg(exact=True), self._sin.neg(exact=True)
