"""The high-bounce approximation in ball arithmetic: all that this base has of its own.

The base stays at height 0: a flight arrives with the speed that it began with, and the kick depends
on the phase alone.  The state is kept in velocities: the rebound speed v, and the sum V of the
speeds since the launch, which is the time flown in units of 2 / g.  With every parameter an exact
double

    V' = V + v         w = e v + A sin(2 pi (f t0 + phi / 2 pi + (2 f / g) V'))

so landing before the end, 2 V' <= g (T - t0), and rest, w <= g tau_c / 2, compare numbers that no
division has made inexact.  Without excitation V and v stay exact while they fit the precision, and
even a tie is decided.  The dimensionless map is the case g = 2, f = 1, phi = 0.

Where only phase and flight matter, as on a cycle, the map is written in forcing periods:
x' = x + u, w = e u + a sin(2 pi x').  What an impact keeps of the speed is the law's to say; e v
and e u stand for it here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from vibrosweep.proof.reference._flint import arb, ctx
from vibrosweep.proof.reference.laws import LAW_OF, Law

__all__ = ["BallMap", "Enclosure", "PeriodMap", "nearest_integer"]

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
    law
        Of the rebound.
    """

    restitution: arb
    amplitude: arb
    half_turns_at_launch: arb
    half_turn_rate: arb
    gravity: arb
    law: Law = LAW_OF["rest"]

    @classmethod
    def of(cls, parameters: Mapping[str, float], rebound: str, launch_time: arb) -> BallMap:
        """Map of physical parameters, at the current precision."""
        p = {name: arb(value) for name, value in parameters.items()}
        return cls(
            restitution=p["restitution"],
            amplitude=p["amplitude"],
            half_turns_at_launch=2 * p["frequency"] * launch_time + p["phase"] / arb.pi(),
            half_turn_rate=4 * p["frequency"],
            gravity=p["gravity"],
            law=LAW_OF[rebound],
        )

    @cached_property
    def _steepest(self) -> arb:
        """Largest derivative of the kick by V, pi A 4 f / g."""
        return arb.pi() * self.amplitude * self.half_turn_rate / self.gravity

    @cached_property
    def _unit(self) -> arb:
        """Speed whose flight lasts one forcing period."""
        return 2 * self.gravity / self.half_turn_rate

    def half_turns(self, flown: arb) -> arb:
        """Phase of the forcing, not reduced, when V is `flown`."""
        return self.half_turns_at_launch + self.half_turn_rate * flown / self.gravity

    def impact(self, flown: arb, speed: arb) -> tuple[arb, arb]:
        """V' at the landing, and w, after a flight that starts with `speed` at V = `flown`."""
        landed = flown + speed
        kick = self.amplitude * self.half_turns(landed).sin_pi()
        return landed, self.law.kept(self.restitution, speed, self._unit) + kick

    def slopes(self, half_turns: arb, speed: arb) -> tuple[arb, arb]:
        """Derivatives of w by V', at a phase, and by the speed before it, the landing kept."""
        by_landing = self._steepest * half_turns.cos_pi()
        return by_landing, self.law.slope(self.restitution, speed, self._unit)

    def liftoff(self, rest_velocity: arb) -> arb:
        """Phase in half turns at which the kick rises through a threshold below its amplitude."""
        return (rest_velocity / self.amplitude).asin() / arb.pi()


class PeriodMap(NamedTuple):
    """The map in forcing periods.

    Attributes
    ----------
    e, a, r
        Restitution, kick and threshold of rest.
    law
        Of the rebound.
    """

    e: arb
    a: arb
    r: arb
    law: Law

    @classmethod
    def of(cls, parameters: Mapping[str, float], rebound: str) -> PeriodMap:
        """Map of physical parameters, at the current precision."""
        p = {name: arb(value) for name, value in parameters.items()}
        kick = 2 * p["frequency"] / p["gravity"] * p["amplitude"]
        return cls(p["restitution"], kick, p["frequency"] * p["contact_time"], LAW_OF[rebound])

    def speed(self, x: arb, u: arb) -> arb:
        """Speed w after the landing at phase x of the flight u."""
        return self.law.kept(self.e, u, ONE) + self.a * (2 * x).sin_pi()

    def slopes(self, x: arb, u: arb) -> tuple[arb, arb]:
        """Derivatives of w by the phase x of the landing, and by u with that phase kept.

        The Jacobian of (x', w) by (x, u) is [[1, 1], [s, f + s]].
        """
        return 2 * arb.pi() * self.a * (2 * x).cos_pi(), self.law.slope(self.e, u, ONE)

    def slope_errors(self, x_error: float, u_error: float) -> tuple[float, float]:
        """Bounds of the changes of both slopes by changes of x and u."""
        return 4.0 * math.pi**2 * float(self.a) * x_error, self.law.bend(float(self.e)) * u_error

    def contraction(self, flights: Sequence[arb], u_error: float) -> tuple[arb | float, float]:
        """Mean logarithm of the modulus of the determinant, over landings of these flights.

        Also the bound of its change where all flights change by so much.
        """
        slopes = [self.law.slope(self.e, u, ONE) for u in flights]
        if any(slope == 0 for slope in slopes):
            return -math.inf, 0.0
        bend = self.law.bend(float(self.e))
        if bend == 0.0:  # the law keeps the same share of any speed
            return slopes[0].log(), 0.0
        change = max(bend * u_error / float(slope) for slope in slopes)
        return sum((slope.log() for slope in slopes), ZERO) / len(slopes), change


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
        # columns of Jacobian times frame; the Jacobian is [[1, 1], [s, f + s]]
        p1, q1 = self._cos + self._sin, self._cos - self._sin
        speed_ball = self._speed + self._sin * self._r1 + self._cos * self._r2
        flown_error = p1 * self._r1 + q1 * self._r2
        ctx.prec = bits
        flown_ball = landed + flown_error
        half_turns = m.half_turns(flown_ball)
        ctx.prec = FRAME_BITS
        s, f = m.slopes(half_turns, speed_ball)
        p2 = s * p1 + f * self._sin
        q2 = s * q1 + f * self._cos
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
