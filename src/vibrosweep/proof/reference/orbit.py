"""A trajectory at one precision: all is certain and narrow enough, or more is asked for.

The semantics of the branches are stated in `vibrosweep.proof.reference.ball`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

from vibrosweep.model.status import Status
from vibrosweep.proof.reference._flint import arb, ctx, exact
from vibrosweep.proof.reference.high_bounce import BallMap, Enclosure, nearest_integer
from vibrosweep.proof.reference.results import Impact, Trajectory

__all__ = ["Problem", "UncertainError", "attempt"]


class UncertainError(Exception):
    """More precision is needed to decide `decision` at impact `impact`."""

    def __init__(self, decision: str, impact: int) -> None:
        super().__init__(decision, impact)
        self.decision = decision
        self.impact = impact


class _Landing(NamedTuple):
    """One landing as the orbit goes by: V, phase in half turns, V at lift-off, v', rested."""

    flown: arb
    half_turns: arb
    liftoff_flown: arb | None
    speed: arb | None
    rested: bool


@dataclass(frozen=True)
class Problem:
    """One trajectory's exact inputs and the radii asked for."""

    parameters: dict[str, float]
    launch_time: Fraction
    duration: Fraction
    rebound: str
    max_impacts: int
    digits: int

    @property
    def digits_bits(self) -> int:
        """Relative accuracy in bits that gives the digits."""
        return math.ceil(self.digits * math.log2(10.0)) + 2


class _Constants:
    """The problem's constants as balls at the current precision."""

    def __init__(self, problem: Problem) -> None:
        p = {name: arb(value) for name, value in problem.parameters.items()}
        gravity = p["gravity"]
        self.launch_time = exact(problem.launch_time)
        self.map = BallMap.of(problem.parameters, problem.rebound, self.launch_time)
        self.launch_velocity = p["launch_velocity"]
        self.rest_velocity = gravity * p["contact_time"] / 2
        self.flown_at_end = gravity * (exact(problem.duration) - self.launch_time) / 2
        self.digits_bits = problem.digits_bits
        self.phase_radius = arb(10) ** -problem.digits
        self.time_radius = self.phase_radius * p["contact_time"]
        self.lifts = _certain_above(self.map.amplitude, self.rest_velocity, "A > v_rest", 0)
        if self.lifts:
            self.liftoff_half_turns = self.map.liftoff(self.rest_velocity)

    def time(self, flown: arb) -> arb:
        """Time in s at which V is `flown`."""
        return self.launch_time + 2 * flown / self.map.gravity

    def liftoff_flown(self, half_turns: arb, impact: int) -> arb:
        """V at the first lift-off phase not earlier than the phase of a rest.

        No rest lies between the rise of the kick through v_rest and its fall, where w > v_rest; the
        whole period is the only thing to decide.
        """
        periods = ((half_turns - self.liftoff_half_turns) / 2).ceil().unique_fmpz()
        if periods is None:
            raise UncertainError("whether a rest begins before the lift-off phase", impact)
        liftoff = self.liftoff_half_turns + 2 * periods
        since_launch = liftoff - self.map.half_turns_at_launch
        return since_launch * self.map.gravity / self.map.half_turn_rate

    def require_narrow(self, landing: _Landing, impact: int) -> None:
        """Raise `UncertainError` unless what is reported of a landing is as narrow as asked."""
        bits, floor = self.digits_bits, self.time_radius
        narrow = _narrow(self.time(landing.flown), bits, floor)
        narrow = narrow and landing.half_turns.rad() <= self.phase_radius
        if landing.rested and landing.liftoff_flown is not None:
            narrow = narrow and _narrow(self.time(landing.liftoff_flown), bits, floor)
        if landing.speed is not None:
            narrow = narrow and landing.speed.rel_accuracy_bits() >= bits
        if not narrow:
            raise UncertainError("a result to the digits asked for", impact)

    def report(self, landing: _Landing) -> Impact:
        """Physical and dimensionless values of a landing."""
        half = arb(0.5)
        turns = landing.half_turns * half
        count = nearest_integer(turns)
        time = self.time(landing.flown)
        liftoff = flight = None
        if landing.liftoff_flown is not None and landing.speed is not None:
            liftoff = self.time(landing.liftoff_flown) if landing.rested else time
            flight = self.map.half_turn_rate * landing.speed / self.map.gravity * half
        return Impact(time, liftoff, landing.speed, landing.rested, count, turns - count, flight)


def _narrow(ball: arb, bits: int, radius: arb) -> bool:
    return bool(ball.rel_accuracy_bits() >= bits or ball.rad() <= radius)


def _certain_above(left: arb, right: arb, decision: str, impact: int) -> bool:
    """Decide left > right, or raise `UncertainError`."""
    if left > right:
        return True
    if left <= right:
        return False
    raise UncertainError(f"whether {decision}", impact)


def _orbit(fixed: _Constants, max_impacts: int) -> tuple[list[_Landing], Status]:
    """All landings at the current precision."""
    landings: list[_Landing] = []
    state = Enclosure(arb(0), fixed.launch_velocity)
    while True:
        n = len(landings) + 1
        flown, half_turns, w = state.impact(fixed.map)
        if _certain_above(flown, fixed.flown_at_end, "the landing is after the end", n):
            return landings, Status.COMPLETED
        if n > max_impacts:
            return landings, Status.BUDGET_EXCEEDED
        speed = abs(w) if fixed.map.law.turns_back else w
        if _certain_above(speed, fixed.rest_velocity, "w > v_rest", n):
            landing = _Landing(flown, half_turns, flown, speed, False)
            if w < 0:
                state.mirror()
        elif fixed.lifts:
            liftoff = fixed.liftoff_flown(half_turns, n)
            landing = _Landing(flown, half_turns, liftoff, fixed.rest_velocity, True)
            state = Enclosure(liftoff, fixed.rest_velocity)
        else:
            landing = _Landing(flown, half_turns, None, None, True)
        fixed.require_narrow(landing, n)
        landings.append(landing)
        if landing.speed is None:
            return landings, Status.COMPLETED


def attempt(problem: Problem, bits: int) -> Trajectory:
    """Return the trajectory at one precision, or raise `UncertainError`."""
    with ctx.workprec(bits):
        fixed = _Constants(problem)
        landings, status = _orbit(fixed, problem.max_impacts)
        return Trajectory(
            impacts=tuple(fixed.report(landing) for landing in landings),
            at_rest=bool(landings) and landings[-1].speed is None,
            status=status,
            precision_bits=bits,
        )
