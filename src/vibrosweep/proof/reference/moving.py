"""The moving base in ball arithmetic.

The base has the velocity V0 sin(omega t + phi) and the height -(V0 / omega) cos(omega t + phi),
with V0 = A / (1 + e).  An impact leaves E(z) of the relative speed z, with the slope q = E'(z).  In
forcing periods and speeds of g / 2 f its velocity is alpha sin(2 pi x)
with alpha = a / (1 + e), a = 2 f A / g, and its largest acceleration is Gamma = pi alpha in units
of gravity.  The state is the phase x and the speed y relative to the base, both at lift-off.  The
flight to the first s > 0 at the height of the base (`vibrosweep.proof.reference.landing`) ends with
the relative speed z, and

    x' = x + s,        z = 2 s - y + alpha (sin(2 pi x') - sin(2 pi x)),        y' = E(z)

By the implicit function theorem, with the angles t = 2 pi x and t' = 2 pi x',

    ds = (2 G_x dx + s dy) / z,            G_x = (alpha / 2) (sin t - sin t' + 2 pi s cos t)
    dy' = q (2 (1 + Gamma cos t') ds + 2 Gamma (cos t' - cos t) dx - dy)

with the determinant q y / z.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from vibrosweep.proof.reference._flint import arb, ctx
from vibrosweep.proof.reference.decisions import (
    UncertainError,
    certain_above,
    decided,
    nearest_integer,
)
from vibrosweep.proof.reference.enclosure import FRAME_BITS, Enclosure, Rows
from vibrosweep.proof.reference.landing import Clearance, first_root, narrowed
from vibrosweep.proof.reference.laws import Constant, Impact, Laws, mean_logarithm
from vibrosweep.proof.reference.motion import (
    EPS,
    Carried,
    Contraction,
    Landed,
    Left,
    Pair,
    Problem,
    Step,
)
from vibrosweep.proof.reference.results import Flight

ZERO, ONE = arb(0), arb(1)


class MovingMap(NamedTuple):
    """The impacts in forcing periods."""

    restitution: Impact
    # alpha, gamma: largest velocity of the base, and its largest acceleration
    alpha: arb
    gamma: arb
    r: arb  # relative speed at and below which a particle rests where the base presses

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, float], laws: Laws) -> MovingMap:
        """Map of physical parameters, at the current precision; there is one law of rebound."""
        p = {name: arb(value) for name, value in parameters.items()}
        alpha = 2 * p["frequency"] / p["gravity"] * p["amplitude"] / (1 + p["restitution"])
        rest = p["frequency"] * p["contact_time"]
        return cls(laws.in_periods(p), alpha, arb.pi() * alpha, rest)

    def lift_off(self, impact: int) -> arb | None:
        """Phase at which a resting particle is left behind; None if it never is."""
        if not certain_above(self.gamma, ONE, "the base ever falls faster than gravity", impact):
            return None
        return (-1 / self.gamma).acos() / (2 * arb.pi())

    def velocity(self, x: arb) -> arb:
        """Velocity of the base at a phase."""
        return self.alpha * (2 * x).sin_pi()

    def presses(self, x: arb, impact: int) -> bool:
        """Tell whether the base presses a particle that lies on it at a phase."""
        pressure = 1 + self.gamma * (2 * x).cos_pi()
        return certain_above(pressure, ZERO, "the base presses the particle", impact)

    def flight(self, x: arb, y: arb, impact: int, lift: arb | None = None) -> arb | None:
        """Ball of the durations of flights from a ball of states; None where they land at once.

        `lift` is the phase of the lift-off after a rest.
        """
        c = Clearance(self.alpha, x, y)
        if lift is None and (y < 0 or (y.is_zero() and self.presses(x, impact))):
            return None
        # after a rest, the base falls faster than gravity until the same height on its way up
        start = c.start() if lift is None else (1 - 2 * lift).lower()
        if start is None or not start > 0:
            raise UncertainError("whether the particle leaves the base", impact)
        return narrowed(c, first_root(c, start, impact))

    def impact(self, x: arb, y: arb, s: arb | None, impact: int) -> Step:
        """Impact after a flight of `s` periods; None where it lands at once."""
        if s is None:
            kept, slope = self.restitution.kept(-y), -self.restitution.slope(-y)
            return Step(ZERO, kept, ((ONE, ZERO), (ZERO, slope)), slope)
        arrival = -2 * Clearance(self.alpha, x, y).slope(s)
        if not arrival > 0:
            raise UncertainError("the speed of a landing", impact)
        kept, slope = self.restitution.kept(arrival), self.restitution.slope(arrival)
        return Step(s, kept, self.jacobian(x, s, arrival), slope * y / arrival)

    def jacobian(self, x: arb, s: arb, arrival: arb) -> Rows:
        """Derivative of phase and speed after an impact by those before its flight."""
        sine, cosine = (2 * x).sin_cos_pi()
        sine_after, cosine_after = (2 * (x + s)).sin_cos_pi()
        by_phase = self.alpha * (sine - sine_after + 2 * arb.pi() * s * cosine) / arrival
        by_speed = s / arrival
        twice = 2 * (1 + self.gamma * cosine_after)
        turned = 2 * self.gamma * (cosine_after - cosine)
        slope = self.restitution.slope(arrival)
        below = slope * (twice * by_phase + turned), slope * (twice * by_speed - 1)
        return (1 + by_phase, by_speed), below

    def step(self, x: arb, y: arb) -> Step | None:
        """Impact of a ball of states; None where one may rest, or a decision is open."""
        try:
            found = self.impact(x, y, self.flight(x, y, 1), 1)
        except UncertainError:
            return None
        return found if found.speed > self.r else None

    def lost(self) -> float:
        """Bits that an impact may cost a ball."""
        return 2.0 + 2.0 * math.log2(3.0 + 4.0 * float(self.gamma))

    def carried(self, x: arb, flight: Flight, direction: Pair, errors: Pair) -> Carried:
        """Carry a direction and its normal through the impact after a flight from phase x."""
        landing = -2 * Clearance(self.alpha, x, flight.speed).slope(flight.duration)
        exact = self.jacobian(x, flight.duration, landing)
        near, fast = x + arb(0, errors[0]), flight.speed + arb(0, errors[1])
        # both ends of the flight are off by the error of a phase
        s = flight.duration + arb(0, 2.0 * errors[0])
        arrival = -2 * Clearance(self.alpha, near, fast).slope(s)
        rows = self.jacobian(near, s, arrival)
        c, d = direction
        along, across = _applied(exact, c, d), _applied(exact, -d, c)
        off = [c * row[0] + d * row[1] for row in rows]
        wrong = sum(float((b - a).abs_upper()) for a, b in zip(along, off, strict=True))
        size = (1 + self.gamma) * (2 + s + self.alpha) * (1 + 1 / arrival)
        wrong += 64.0 * EPS * float(size.abs_upper())
        return Carried(_floats(along), _floats(across), wrong, False)

    def contraction(self, speeds: Sequence[arb], error: float) -> Contraction:
        """Mean logarithm of the determinant in coordinates in which only the arrival enters.

        It is q y / z = q (y' / z) (y / y') in (x, y), and q y' / z in (x, y^2).  An arrival is off
        by the error of y' = E(z) over the slope q.
        """
        law = self.restitution
        off = max((error / float(law.slope(z)) for z in speeds if law.slope(z) > 0), default=0.0)
        return mean_logarithm(law, lambda z: law.slope(z) * law.share(z), speeds, 2.0 * off)


def liftoff_error(parameters: Mapping[str, float]) -> float:
    """Error of the phase of a lift-off after a rest that a computation in doubles makes, turns.

    It grows where the base hardly falls faster than gravity: Gamma, of a few roundings, decides.
    """
    gamma = float(MovingMap.from_parameters(parameters, Laws()).gamma)
    if gamma <= 1.0 - 32.0 * EPS:
        return 0.0
    above = (gamma - 1.0) * (gamma + 1.0)
    if above <= 64.0 * EPS:
        return math.inf
    return (16.0 / (2.0 * math.pi * math.sqrt(above)) + 2.0) * EPS


def _applied(rows: Rows, c: float, d: float) -> tuple[arb, arb]:
    return rows[0][0] * c + rows[0][1] * d, rows[1][0] * c + rows[1][1] * d


def _floats(pair: tuple[arb, arb]) -> Pair:
    return float(pair[0]), float(pair[1])


def first_landing(
    e: float, a: float, x: float, y: float, bits: int = 128, max_bits: int = 1 << 13
) -> tuple[arb, arb]:
    """Proved landing of one flight from exact doubles.

    Kick a in forcing periods, alpha = a / (1 + e); phase x in turns, and speed y relative to the
    base in units of g / 2 f, at lift-off.  The precision is doubled until the landing is certain;
    an UndecidableError where a graze is not told from a landing.

    Returns
    -------
    s, z
        Balls of the duration of the flight in forcing periods, 0 where it lands at once, and of
        the relative speed of arrival.
    """

    def attempt(bits: int) -> tuple[arb, arb]:
        with ctx.workprec(bits):
            alpha = arb(a) / (1 + arb(e))
            s = MovingMap(Constant(arb(e)), alpha, arb.pi() * alpha, ZERO).flight(arb(x), arb(y), 1)
            if s is None:
                return ZERO, -arb(y)
            return s, -2 * Clearance(alpha, arb(x), arb(y)).slope(s)

    return decided(attempt, bits, max_bits)


class Motion:
    """A particle on the moving base, at one precision; the unit of time is the forcing period.

    Attributes
    ----------
    launched, end
        As in `vibrosweep.proof.reference.motion.Motion`.
    """

    def __init__(self, problem: Problem) -> None:
        p, self._launch_time, self._problem = problem.balls, problem.launched, problem
        self._map = MovingMap.from_parameters(problem.parameters, problem.laws)
        self._frequency, self._gravity = p["frequency"], p["gravity"]
        self._phase = p["frequency"] * self._launch_time + p["phase"] / (2 * arb.pi())
        self.end = p["frequency"] * problem.lasting
        self._flown = ZERO
        self._lift: arb | None = None  # phase of the lift-off, right after a rest
        u = 2 * p["frequency"] / p["gravity"] * p["launch_velocity"]
        self._speed = u - self._map.velocity(self._phase)
        self._state = Enclosure(self._flown, self._speed)
        self.launched = self._left()

    def time(self, flown: arb) -> arb:
        """Time in s that many periods after the launch."""
        return self._launch_time + flown / self._frequency

    def _left(self) -> Left:
        """Lift-off from the present state."""
        m, turns = self._map, self._phase + self._flown
        u = self._speed + m.velocity(turns)
        # a particle that falls, or that the base pushes at once, is highest at its beginning
        rising = ZERO if self._speed < 0 else u.max(ZERO)
        square = rising * rising - 2 * m.alpha / arb.pi() * (2 * turns).cos_pi()
        height = self._gravity / (8 * self._frequency * self._frequency) * square
        velocity = self._gravity / (2 * self._frequency) * u
        return Left(self._flown, self._lift is not None, velocity, self._speed, height)

    def land(self, impact: int) -> Landed:
        """Fly to the next landing."""
        m, state = self._drawn(impact), self._state
        left = self._speed + m.velocity(self._phase + self._flown)
        phase = self._phase - nearest_integer(self._phase + self._flown)
        s, rows = self._over_the_set(m, phase + self._flown, impact)
        with ctx.workprec(max(FRAME_BITS, min(ctx.prec, state.bits))):
            x = phase + state.flown
            flight = None if s is None else narrowed(Clearance(m.alpha, x, state.speed), s)
            centre = m.impact(x, state.speed, flight, impact)
            flown, speed = state.flown + centre.duration, centre.speed
        (by_flown, by_speed), below = rows
        duration = centre.duration + state.change(by_flown - 1, by_speed)
        self._flown = flown + state.change(by_flown, by_speed)
        self._speed = speed + state.change(*below)
        if not (self._flown.is_finite() and self._speed.is_finite()):
            raise UncertainError("a landing to any digit", impact)
        state.turn(flown, speed, rows)
        state.bits = max(0, duration.rel_accuracy_bits()) + 2 * FRAME_BITS
        slopes = float(by_flown - 1), float(by_speed)
        turns = self._phase + self._flown
        arrival = m.velocity(turns) + 2 * duration - left
        return Landed(self._flown, 2 * turns, duration, slopes, arrival)

    def _drawn(self, impact: int) -> MovingMap:
        """Return the map with what is random in an impact."""
        unit = self._gravity / (2 * self._frequency)
        law = self._problem.random(self._map.restitution, impact, unit, thrown=True)
        return self._map._replace(restitution=law)

    def _over_the_set(self, m: MovingMap, x: arb, impact: int) -> tuple[arb | None, Rows]:
        """Durations and Jacobians over all states; few bits are enough in most cases."""
        try:
            with ctx.workprec(FRAME_BITS):
                s = m.flight(x, self._speed, impact, self._lift)
                return s, m.impact(x, self._speed, s, impact).rows
        except UncertainError:
            s = m.flight(x, self._speed, impact, self._lift)
            return s, m.impact(x, self._speed, s, impact).rows

    def leave(self, impact: int) -> Left | None:
        """Rebound, perhaps after a rest; None at rest for good."""
        m, turns = self._map, self._phase + self._flown
        self._lift = None
        above = certain_above(self._speed, m.r, "e z > r", impact)
        if not above and m.presses(turns, impact):
            self._lift = m.lift_off(impact)
            if self._lift is None:
                return None
            # the base presses from minus this phase on, and up to it
            self._flown, self._speed = self._lift + nearest_integer(turns) - self._phase, ZERO
            self._state = Enclosure(self._flown, self._speed)
        return self._left()
