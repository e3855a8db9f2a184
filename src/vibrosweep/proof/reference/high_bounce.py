"""The high-bounce approximation in ball arithmetic.

The base stays at height 0: a flight arrives with the speed that it began with, and the kick depends
on the phase alone.  The state is kept in velocities: the rebound speed v, and the sum V of the
speeds since the launch, which is the time flown in units of 2 / g.  Every parameter is an exact
double.  The map is

    V' = V + v         w = e v + A sin(2 pi (f t0 + phi / 2 pi + (2 f / g) V'))

so the conditions for a landing before the end, 2 V' <= g (T - t0), and for a rest,
w <= g tau_c / 2, compare numbers that no division has made inexact.  Without excitation V and v
stay exact while they fit the precision, and even a tie is decided.  The dimensionless map is the
case g = 2, f = 1, phi = 0.

Where only phase and flight matter, as on a cycle, the map is written in forcing periods:
x' = x + u, w = e u + a sin(2 pi x').  For other laws of restitution and other shapes of the motion
(`vibrosweep.proof.reference.laws`), e v, e u and the sine stand for what these give.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, NamedTuple

from vibrosweep.proof.reference.arithmetic import (
    FRAME_BITS,
    OrbitEnclosure,
    UncertainError,
    arb,
    certain_above,
    ctx,
)
from vibrosweep.proof.reference.laws import (
    SINE_WAVE,
    Laws,
    Restitution,
    Wave,
    mean_logarithm,
    next_of,
    slope_change,
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
)

ZERO, ONE = arb(0), arb(1)
LONGEST: Final = 1 << 16  # number of forcing periods in which the end of a rest is searched for


@dataclass(frozen=True)
class BallMap:
    """The map's parameters as balls; phases in half turns, as sin(pi h) needs no multiplication."""

    restitution: Restitution
    amplitude: arb  # A (m s-1)
    half_turns_at_launch: arb  # 2 f t0 + phi / pi
    # half_turn_rate, gravity: 4 f and g.  The phase 4 f V / g is one quotient, exact if its value
    # fits the precision: a landing on a zero of the sine is then recognised as one.
    half_turn_rate: arb
    gravity: arb
    turns_back: bool = False  # True if a particle that is pushed into the base is turned back
    wave: Wave = SINE_WAVE

    @classmethod
    def from_parameters(
        cls, parameters: Mapping[str, float], laws: Laws, launch_time: arb
    ) -> BallMap:
        """Map of physical parameters, at the current precision."""
        p = {name: arb(value) for name, value in parameters.items()}
        return cls(
            restitution=laws.impact(p["restitution"], p.get("restitution_speed")),
            amplitude=p["amplitude"],
            half_turns_at_launch=2 * p["frequency"] * launch_time + p["phase"] / arb.pi(),
            half_turn_rate=4 * p["frequency"],
            gravity=p["gravity"],
            turns_back=laws.turns_back,
            wave=wave_of(laws.waveform),
        )

    def half_turns(self, flown: arb) -> arb:
        """Phase of the forcing, not reduced, when V is `flown`."""
        return self.half_turns_at_launch + self.half_turn_rate * flown / self.gravity

    def impact(self, flown: arb, speed: arb) -> tuple[arb, arb]:
        """V' at the landing, and w, after a flight that starts with `speed` at V = `flown`."""
        landed = flown + speed
        kick = self.amplitude * self.wave.velocity(self.half_turns(landed))
        return landed, self.restitution.kept(speed) + kick

    def slopes(self, half_turns: arb, speed: arb) -> tuple[arb, arb]:
        """Derivatives of w by V', at a phase, and by the speed before the impact at a fixed V'."""
        turns_by_landing = self.half_turn_rate / self.gravity / 2
        by_landing = self.amplitude * self.wave.slope(half_turns) * turns_by_landing
        return by_landing, self.restitution.slope(speed)

    def carry(self, state: OrbitEnclosure) -> tuple[arb, arb, arb]:
        """Map a set; return V', its phase in half turns and w as balls around all its states."""
        full = ctx.prec
        ctx.prec = bits = min(full, state.bits)
        landed, w = self.impact(state.flown, state.speed)
        ctx.prec = FRAME_BITS
        speed = state.speed + state.change(ZERO, ONE)
        flown_error = state.change(ONE, ONE)
        ctx.prec = bits
        flown = landed + flown_error
        half_turns = self.half_turns(flown)
        ctx.prec = FRAME_BITS
        s, f = self.slopes(half_turns, speed)
        speed_error = state.change(s, f + s)
        state.turn(landed, w, ((ONE, ONE), (s, f + s)))
        ctx.prec = full
        state.bits = max(0, flown.rel_accuracy_bits()) + 2 * FRAME_BITS
        return flown, half_turns, w + speed_error

    def flown_at(self, half_turns: arb) -> arb:
        """V at a phase that is not reduced."""
        return (half_turns - self.half_turns_at_launch) * self.gravity / self.half_turn_rate


class BounceMotion:
    """A particle on this base, at one precision; times are V, in units of 2 / g.

    Attributes
    ----------
    launched, end
        As in `vibrosweep.proof.reference.motion.ParticleMotion`.
    """

    def __init__(self, problem: TrajectoryProblem) -> None:
        p, self._launch_time, self._problem = problem.balls, problem.launched, problem
        self._map = BallMap.from_parameters(problem.parameters, problem.laws, self._launch_time)
        self._rest_velocity = p["gravity"] * p["contact_time"] / 2
        self._flown, self._velocity = ZERO, p["launch_velocity"]
        self._half_turns = self._map.half_turns_at_launch
        self._state = OrbitEnclosure(self._flown, self._velocity)
        self.end = p["gravity"] * problem.lasting / 2
        self.launched = self._left(rested=False)

    def time(self, flown: arb) -> arb:
        """Time in s at which V is `flown`."""
        return self._launch_time + 2 * flown / self._map.gravity

    def _left(self, rested: bool) -> Left:
        """Lift-off from the present state."""
        m, v = self._map, self._velocity
        height = v * v / (2 * m.gravity)
        return Left(self._flown, rested, v, m.half_turn_rate * v / m.gravity / 2, height)

    def land(self, impact: int) -> ProvedLanding:
        """Fly to the next landing."""
        duration = self._map.half_turn_rate * self._velocity / self._map.gravity / 2
        drawn = self._map if self._problem.deviates is None else self._drawn(impact)
        self._flown, self._half_turns, self._velocity = drawn.carry(self._state)
        return ProvedLanding(self._flown, self._half_turns, duration, None, arrival=duration)

    def _drawn(self, impact: int) -> BallMap:
        """Return the map with the random numbers of the next impact."""
        m = self._map
        law = self._problem.random(m.restitution, impact, ONE, thrown=False)
        period = _period(m.half_turns(self._flown + self._velocity) / 2, impact)
        return replace(m, restitution=law, amplitude=self._problem.strength(period) * m.amplitude)

    def leave(self, impact: int) -> Left | None:
        """Rebound, perhaps after a rest; None at rest for good."""
        w = self._velocity
        speed = abs(w) if self._map.turns_back else w
        if certain_above(speed, self._rest_velocity, "w > v_rest", impact):
            self._velocity = speed
            if w < 0:
                self._state.mirror()
            return self._left(rested=False)
        lifted = self._lifted(impact)
        if lifted is None:
            return None
        self._flown = lifted
        self._velocity = self._rest_velocity
        self._state = OrbitEnclosure(self._flown, self._velocity)
        return self._left(rested=True)

    @cached_property
    def _lifts(self) -> list[arb]:
        """Phases at which a resting particle is lifted."""
        return self._map.wave.rises(self._map.amplitude, self._rest_velocity, 0)

    def _lifted(self, impact: int) -> arb | None:
        """V at the lift-off from a rest; None at rest for good.

        Without noise no rest begins while the kick is above v_rest, since then w > v_rest; only the
        number of whole periods is to be decided.
        """
        m = self._map
        if self._problem.deviates is not None:
            if self._problem.driven:
                return self._lifted_in_some_period(impact)
            kick = m.amplitude * m.wave.velocity(self._half_turns)
            if certain_above(kick, self._rest_velocity, "A sin > v_rest", impact):
                return self._flown
        if not self._lifts:
            return None
        return m.flown_at(2 * next_of(self._lifts, self._half_turns / 2, impact))

    @cached_property
    def _lifts_ever(self) -> bool:
        """True if some strength of the random drive lifts a resting particle."""
        m, strengths = self._map, self._problem.strengths
        return any(m.wave.rises(s * m.amplitude, self._rest_velocity, 0) for s in strengths)

    def _lifted_in_some_period(self, impact: int) -> arb | None:
        """V at which the kick first exceeds v_rest, with the random strength of each period."""
        m, rest, begin = self._map, self._rest_velocity, self._half_turns / 2
        if not self._lifts_ever:
            return None
        first = _period(begin, impact)
        for period in range(first, first + LONGEST):
            strength = self._problem.strength(period) * m.amplitude
            if not certain_above(
                abs(strength) * m.wave.bounds.fast, rest, "a kick > v_rest", impact
            ):
                continue
            begin = begin if period == first else arb(period)
            if certain_above(
                strength * m.wave.velocity(2 * begin), rest, "a kick > v_rest", impact
            ):
                return self._flown if period == first else m.flown_at(2 * begin)
            rises = m.wave.rises(strength, rest, impact)
            if not rises:
                continue
            lift = next_of(rises, begin, impact)
            if certain_above(arb(period + 1), lift, "a kick > v_rest before a period ends", impact):
                return m.flown_at(2 * lift)
        raise UncertainError("when a rest ends", impact)


def _period(turns: arb, impact: int) -> int:
    """Forcing period of a phase."""
    found = turns.floor().unique_fmpz()
    if found is None:
        raise UncertainError("the forcing period of a landing", impact)
    return int(found)


class BounceMap(NamedTuple):
    """The map in forcing periods."""

    restitution: Restitution
    # a, r: kick and threshold of rest
    a: arb
    r: arb
    turns_back: bool
    wave: Wave

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, float], laws: Laws) -> BounceMap:
        """Map of physical parameters, at the current precision."""
        p = {name: arb(value) for name, value in parameters.items()}
        kick = 2 * p["frequency"] / p["gravity"] * p["amplitude"]
        rest = p["frequency"] * p["contact_time"]
        wave = wave_of(laws.waveform)
        return cls(laws.in_periods(p), kick, rest, laws.turns_back, wave)

    def speed(self, x: arb, u: arb) -> arb:
        """Speed w after the landing at phase x of the flight u."""
        return self.restitution.kept(u) + self.a * self.wave.velocity(2 * x)

    def slopes(self, x: arb, u: arb) -> tuple[arb, arb]:
        """Derivatives of w by the phase x of the landing, and by u at a fixed phase.

        The Jacobian of (x', w) by (x, u) is [[1, 1], [s, f + s]].
        """
        return self.a * self.wave.slope(2 * x), self.restitution.slope(u)

    def step(self, x: arb, u: arb) -> Step | None:
        """Impact of a ball of states; None where one may rest, or a decision is uncertain."""
        w = self.speed(x + u, u)
        s, f = self.slopes(x + u, u)
        if self.turns_back and w < 0:
            w, s, f = -w, -s, -f
        return Step(u, w, ((ONE, ONE), (s, f + s)), f) if w > self.r else None

    def lost(self) -> float:
        """Bits that an impact may cost a ball, by its Jacobian."""
        return 1.0 + math.log2(3.0 + 2.0 * float(self.a * self.wave.bounds.steep))

    def carried(self, x: arb, flight: ProvedFlight, direction: Pair, errors: Pair) -> Carried:
        """Carry a direction and its normal through the impact after a flight from phase x."""
        u = flight.speed
        k, f = (float(slope) for slope in self.slopes(x + u, u))
        bounds, a = self.wave.bounds, float(self.a)
        s_error = a * self.wave.slope_change(2 * (x + u), errors[0])
        # both computations round
        s_error += (8.0 + bounds.blur) * EPS * a * float(bounds.steep)
        f_error = slope_change(self.restitution, u, errors[1])
        c, s = direction
        wrong = abs(c + s) * s_error + abs(s) * f_error
        wrong += 32.0 * EPS * (2.0 + f + 2.0 * abs(k))
        pushed = self.speed(x + u, u) < 0  # then the law turns it back
        return Carried((c + s, k * c + (f + k) * s), (c - s, (f + k) * c - k * s), wrong, pushed)

    def contraction(self, speeds: Sequence[arb], error: float) -> Contraction:
        """Mean logarithm of the determinant of impacts with these speeds of arrival."""
        return mean_logarithm(self.restitution, self.restitution.slope, speeds, error)


def liftoff_error(parameters: Mapping[str, float], laws: Laws) -> float:
    """Error in turns of the phase of a lift-off after a rest, as computed in doubles.

    It grows where the kick barely exceeds v_rest.
    """
    with ctx.workprec(2 * FRAME_BITS):
        wave = wave_of(laws.waveform)
        a = arb(parameters["amplitude"])
        rest = arb(parameters["gravity"]) * arb(parameters["contact_time"]) / 2
        try:
            phases = wave.rises(a, rest, 0)
        except UncertainError:
            return math.inf
        worst, bounds = 0.0, wave.bounds
        for x in phases:
            ratio, slope = float(rest / a), abs(float(wave.slope(2 * x)))
            off = EPS * (8.0 * ratio + bounds.blur * float(bounds.fast))
            if slope * slope <= 4.0 * off * float(bounds.bend):
                return math.inf
            worst = max(worst, off / slope + EPS)
        return worst
