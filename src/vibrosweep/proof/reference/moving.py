"""The moving base in ball arithmetic.

The base has the velocity V0 w(x) and the height (V0 / f) W(x), with V0 = A / (1 + e) and a shape w
(`vibrosweep.proof.reference.laws`).  An impact leaves E(z) of the relative speed z, with the slope
q = E'(z).  In units of g / 2 f the base has the velocity alpha w(x) with alpha = a / (1 + e),
a = 2 f A / g, and in units of gravity the acceleration G = alpha w' / 2.  The state is the
phase x and the speed y relative to the base, both at lift-off.  The flight to the first s > 0 at
the height of the base (`vibrosweep.proof.reference.motion`) ends with the relative speed z, and

    x' = x + s,        z = 2 s - y + alpha (w(x') - w(x)),        y' = E(z)

By the implicit function theorem

    ds = (P dx + s dy) / z,            P = alpha (w(x) - w(x') + s w'(x))
    dy' = q (2 (1 + G(x')) ds + 2 (G(x') - G(x)) dx - dy)

with the determinant q y / z.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from vibrosweep.proof.reference.arithmetic import (
    FRAME_BITS,
    OrbitEnclosure,
    Rows,
    UncertainError,
    arb,
    certain_above,
    ctx,
    narrowed,
    nearest_integer,
)
from vibrosweep.proof.reference.laws import (
    SINE_WAVE,
    AtLiftoff,
    Laws,
    Restitution,
    ShapeBounds,
    Wave,
    mean_logarithm,
    next_of,
    wave_of,
)
from vibrosweep.proof.reference.motion import (
    EPS,
    Carried,
    Contraction,
    Left,
    Pair,
    ProvedFlight,
    ProvedLanding,
    Step,
    TrajectoryProblem,
    first_root,
)

ZERO, ONE = arb(0), arb(1)
ROUNDED_BITS = 64  # beyond those of a frame, in which roundings of doubles are seen


@dataclass(frozen=True)
class BallClearance:
    """Height above the base during flights that set out from a ball of states."""

    wave: Wave
    alpha: arb  # factor of the velocity of the base
    # x, y: phase in turns and relative speed at lift-off
    x: arb
    y: arb
    presses: Callable[[], Sequence[arb]] = tuple  # phases at which the base begins to press

    @cached_property
    def bounds(self) -> ShapeBounds:
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

    def derivative(self, order: int, s: arb) -> arb:
        """G (0), G' (1) or G'' (2)."""
        return (self.height, self.slope, lambda s: -self.bend(s))[order](s)

    def start(self) -> arb | None:
        """Time before which there is no root; None if uncertain."""
        if self.bend(arb(0)) < 0 and (self.y > 0 or self.y.is_zero()):
            # the base falls away until it presses again
            until = (next_of(self.presses(), self.x, 0) - self.x).lower()
            return until if until > 0 else None
        return (self.y / (2 * (1 + self.gamma))).lower() if self.y > 0 else None


@dataclass(frozen=True)
class MovingMap:
    """The map in forcing periods."""

    restitution: Restitution
    alpha: arb  # factor of the velocity of the base
    r: arb  # relative speed at and below which a particle rests where the base presses
    wave: Wave = SINE_WAVE
    bits: int = field(default_factory=lambda: int(ctx.prec))  # precision of its numbers

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, float], laws: Laws) -> MovingMap:
        """Map of physical parameters, at the current precision; its law of rebound is `rest`."""
        p = {name: arb(value) for name, value in parameters.items()}
        alpha = 2 * p["frequency"] / p["gravity"] * p["amplitude"] / (1 + p["restitution"])
        rest = p["frequency"] * p["contact_time"]
        return cls(laws.in_periods(p), alpha, rest, wave_of(laws.waveform))

    @cached_property
    def gamma(self) -> arb:
        """Bound on |G|."""
        return self.alpha * self.wave.bounds.steep / 2

    @cached_property
    def ends(self) -> tuple[list[arb], list[arb]]:
        """Phases at which the base begins to fall faster than gravity, and to press again."""
        with ctx.workprec(max(int(ctx.prec), self.bits)):
            return self.wave.falls(self.alpha, 0)

    def velocity(self, x: arb) -> arb:
        """Velocity of the base at a phase."""
        return self.alpha * self.wave.velocity(2 * x)

    def clearance(self, x: arb, y: arb) -> BallClearance:
        """Height above the base during flights from a ball of states."""
        return BallClearance(self.wave, self.alpha, x, y, lambda: self.ends[1])

    def presses(self, x: arb, impact: int) -> bool:
        """Return whether the base presses a particle that lies on it at a phase."""
        pressure = 1 + self.alpha / 2 * self.wave.slope(2 * x)
        return certain_above(pressure, ZERO, "the base presses the particle", impact)

    def flight(self, x: arb, y: arb, impact: int, lift: arb | None = None) -> arb | None:
        """Ball of the durations of flights from a ball of states; None where they land at once.

        `lift` is the phase of the lift-off after a rest.
        """
        c = self.clearance(x, y)
        if lift is None and (y < 0 or (y.is_zero() and self.presses(x, impact))):
            return None
        # after a rest, the base falls faster than gravity until it presses again
        start = c.start() if lift is None else (next_of(self.ends[1], lift, impact) - lift).lower()
        if start is None or not start > 0:
            raise UncertainError("whether the particle leaves the base", impact)
        return narrowed(c.derivative, first_root(c.derivative, start, impact))

    def impact(self, x: arb, y: arb, s: arb | None, impact: int) -> Step:
        """Impact after a flight of `s` periods; `s` is None if the particle lands at once."""
        if s is None:
            kept, slope = self.restitution.kept(-y), -self.restitution.slope(-y)
            return Step(ZERO, kept, ((ONE, ZERO), (ZERO, slope)), slope)
        arrival = -2 * self.clearance(x, y).slope(s)
        if not arrival > 0:
            raise UncertainError("the speed of a landing", impact)
        kept, slope = self.restitution.kept(arrival), self.restitution.slope(arrival)
        return Step(s, kept, self.jacobian(x, s, arrival), slope * y / arrival)

    def jacobian(self, x: arb, s: arb, arrival: arb) -> Rows:
        """Derivative of phase and speed after an impact by those before its flight."""
        before, after = self.wave.slope(2 * x), self.wave.slope(2 * (x + s))
        gained = self.wave.gain(self.wave.at_liftoff(2 * x), s)
        by_phase = self.alpha * (s * before - gained) / arrival
        by_speed = s / arrival
        twice = 2 + self.alpha * after
        turned = self.alpha * (after - before)
        slope = self.restitution.slope(arrival)
        below = slope * (twice * by_phase + turned), slope * (twice * by_speed - 1)
        return (1 + by_phase, by_speed), below

    def step(self, x: arb, y: arb) -> Step | None:
        """Impact of a ball of states; None where one may rest, or a decision is uncertain."""
        try:
            found = self.impact(x, y, self.flight(x, y, 1), 1)
        except UncertainError:
            return None
        return found if found.speed > self.r else None

    def lost(self) -> float:
        """Bits that an impact may cost a ball."""
        return 2.0 + 2.0 * math.log2(3.0 + 4.0 * float(self.gamma))

    def carried(self, x: arb, flight: ProvedFlight, direction: Pair, errors: Pair) -> Carried:
        """Carry a direction and its normal through the impact after a flight from phase x."""
        landing = -2 * self.clearance(x, flight.speed).slope(flight.duration)
        exact = self.jacobian(x, flight.duration, landing)
        near, fast = x + arb(0, errors[0]), flight.speed + arb(0, errors[1])
        # both ends of the flight are off by the error of a phase
        s = flight.duration + arb(0, 2.0 * errors[0])
        arrival = -2 * self.clearance(near, fast).slope(s)
        rows = self.jacobian(near, s, arrival)
        c, d = direction
        along, across = _applied(exact, c, d), _applied(exact, -d, c)
        off = [c * row[0] + d * row[1] for row in rows]
        wrong = sum(float((b - a).abs_upper()) for a, b in zip(along, off, strict=True))
        bounds = self.wave.bounds
        size = (1 + self.gamma) * (2 + s + self.alpha * bounds.fast) * (1 + 1 / arrival)
        wrong += (64.0 + 4.0 * bounds.blur) * EPS * float(size.abs_upper())
        return Carried(_floats(along), _floats(across), wrong, False)

    def contraction(self, speeds: Sequence[arb], error: float) -> Contraction:
        """Mean logarithm of the determinant, in coordinates where it depends on the arrival alone.

        It is q y / z = q (y' / z) (y / y') in (x, y), and q y' / z in (x, y^2).  The error of an
        arrival z is that of y' = E(z) divided by the slope q.
        """
        law = self.restitution
        off = max((error / float(law.slope(z)) for z in speeds if law.slope(z) > 0), default=0.0)
        return mean_logarithm(law, lambda z: law.slope(z) * law.share(z), speeds, 2.0 * off)


def liftoff_error(parameters: Mapping[str, float], laws: Laws) -> float:
    """Error in turns of the phase of a lift-off after a rest, as computed in doubles.

    It grows where the base barely falls faster than gravity, and rounding errors of G decide.
    """
    with ctx.workprec(FRAME_BITS + ROUNDED_BITS):
        m = MovingMap.from_parameters(parameters, laws)
        bounds, wave = m.wave.bounds, m.wave
        off = EPS * (16.0 + bounds.blur * float(m.gamma))
        try:
            phases = m.ends[0]
            likely = wave.falls(m.alpha * (1 + 2 * arb(off)), 0)[0]
        except UncertainError:
            return math.inf
        if len(phases) < len(likely):
            return math.inf
        worst = 0.0
        for x in phases if not bounds.bend.is_zero() else ():
            slope = abs(float(m.alpha / 2 * wave.rate(2 * x)))
            if slope * slope <= 4.0 * off * float(m.alpha / 2 * bounds.jolt):
                return math.inf
            worst = max(worst, off / slope + 2.0 * EPS)
        return worst


def _applied(rows: Rows, c: float, d: float) -> tuple[arb, arb]:
    return rows[0][0] * c + rows[0][1] * d, rows[1][0] * c + rows[1][1] * d


def _floats(pair: tuple[arb, arb]) -> Pair:
    return float(pair[0]), float(pair[1])


class MovingMotion:
    """A particle on the moving base, at one precision; the unit of time is the forcing period.

    Attributes
    ----------
    launched, end
        As in `vibrosweep.proof.reference.motion.ParticleMotion`.
    """

    def __init__(self, problem: TrajectoryProblem) -> None:
        p, self._launch_time, self._problem = problem.balls, problem.launched, problem
        self._map = MovingMap.from_parameters(problem.parameters, problem.laws)
        self._frequency, self._gravity = p["frequency"], p["gravity"]
        self._phase = p["frequency"] * self._launch_time + p["phase"] / (2 * arb.pi())
        self.end = p["frequency"] * problem.lasting
        self._flown = ZERO
        self._lift: arb | None = None  # phase of the lift-off, right after a rest
        u = 2 * p["frequency"] / p["gravity"] * p["launch_velocity"]
        self._speed = u - self._map.velocity(self._phase)
        self._state = OrbitEnclosure(self._flown, self._speed)
        self.launched = self._left()

    def time(self, flown: arb) -> arb:
        """Time in s that many periods after the launch."""
        return self._launch_time + flown / self._frequency

    def _left(self) -> Left:
        """Lift-off from the present state."""
        m, turns = self._map, self._phase + self._flown
        u = self._speed + m.velocity(turns)
        # a particle that falls, or that the base pushes at once, is highest at the start
        rising = ZERO if self._speed < 0 else u.max(ZERO)
        square = rising * rising + 4 * m.alpha * m.wave.level(2 * turns)
        height = self._gravity / (8 * self._frequency * self._frequency) * square
        velocity = self._gravity / (2 * self._frequency) * u
        return Left(self._flown, self._lift is not None, velocity, self._speed, height)

    def land(self, impact: int) -> ProvedLanding:
        """Fly to the next landing."""
        m, state = self._drawn(impact), self._state
        left = self._speed + m.velocity(self._phase + self._flown)
        phase = self._phase - nearest_integer(self._phase + self._flown)
        s, rows = self._over_the_set(m, phase + self._flown, impact)
        with ctx.workprec(max(FRAME_BITS, min(ctx.prec, state.bits))):
            x = phase + state.flown
            flight = None if s is None else narrowed(m.clearance(x, state.speed).derivative, s)
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
        return ProvedLanding(self._flown, 2 * turns, duration, slopes, arrival)

    def _drawn(self, impact: int) -> MovingMap:
        """Return the map with the random numbers of an impact."""
        unit = self._gravity / (2 * self._frequency)
        law = self._problem.random(self._map.restitution, impact, unit, thrown=True)
        return replace(self._map, restitution=law)

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
            if not m.ends[0]:
                return None
            lift = next_of(m.ends[0], turns, impact)
            self._lift = lift - nearest_integer(lift)
            self._flown, self._speed = lift - self._phase, ZERO
            self._state = OrbitEnclosure(self._flown, self._speed)
        return self._left()
