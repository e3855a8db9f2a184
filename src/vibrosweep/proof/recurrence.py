"""Recurrence of a proved orbit: whether it repeats as stated, its cycle, slot and exponents.

The state after a rest depends only on the phase at which the rest ends: two rests that end at the
same phase close a cycle, which the orbit entered with the first.  Otherwise the kernel detects
recurrence when a state returns bit for bit, whereas the exact orbit approaches its cycle
asymptotically.  A proof can show that it repeats as stated, up to the tolerance with which the
kernel identifies states and the errors that the dataset claims; impacts and periods of the cycle
then follow exactly.  Recurrence is stated at the second occurrence of a state, after which the
orbit may end almost at once; so states are compared from the first occurrence on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from vibrosweep.kernels.settle import SAME_ORBIT
from vibrosweep.model.status import Regime
from vibrosweep.proof.growth import Mean, mean_growth
from vibrosweep.proof.reference._flint import arb, ctx
from vibrosweep.proof.reference.decisions import nearest_integer
from vibrosweep.proof.reference.motion import EPS, PeriodMap
from vibrosweep.proof.reference.results import Trajectory
from vibrosweep.proof.sample import Realization
from vibrosweep.proof.tolerances import Bounds

# Precision in bits of numbers that become doubles
FLOATING: Final = 128
# Signs that a particle recurs: variables, each with its test
SIGNS: Final[dict[str, Callable[[Any], bool]]] = {
    "regime": lambda code: code in (Regime.RESTING, Regime.LOCKED),
    "cycle_impacts": lambda number: number > 0,
    "cycle_periods": lambda number: number > 0,
    "recurrent_from": math.isfinite,
    "cycle_uncertain": lambda code: code >= 0,
    "orbit": lambda number: number >= 0,
    "slot": lambda number: number >= 0,
}


class State(NamedTuple):
    """A lift-off: whole periods, phase in turns, speed relative to the base in units of g / 2 f."""

    whole: int
    phase: float
    speed: float


@dataclass(frozen=True)
class Cycle:
    """A cycle that a proved orbit has entered."""

    # Number of the state at which recurrence is stated, or of that after the first of two rests
    since: int
    # impacts, periods, rests: in one cycle
    impacts: int
    periods: int
    rests: int


class Orbit:
    """States of a particle after its launch (number 0) and after each impact.

    Attributes
    ----------
    trajectory
        Proved landings.
    times, flights, speeds
        For each state: time of lift-off in s, flight that follows, and its speed relative to the
        base.
    time_error
        Largest error in s of the kernel's time of a state.
    """

    def __init__(
        self, realization: Realization, bounds: Bounds, trajectory: Trajectory, particle: int
    ) -> None:
        p, launch = realization.parameters, realization.launch_times[particle]
        self.trajectory, self._realization, self._bounds = trajectory, realization, bounds
        self._frequency = arb(p["frequency"])
        left = [i for i in trajectory.impacts if i.liftoff_time is not None]
        with ctx.workprec(2 * trajectory.precision_bits):
            launched = arb(launch.numerator) / launch.denominator
        self.times = [launched, *(i.liftoff_time for i in left)]
        self.flights = [f for f in (trajectory.launch, *(i.flight for i in left)) if f is not None]
        self.speeds = [flight.speed for flight in self.flights]
        end = float(realization.duration)
        self.time_error = bounds.record_claims(realization, end)["liftoff_time"]
        self._time_error = bounds.landing_time * p["frequency"] + 4.0 * EPS
        time = bounds.record_claims(realization, 0.0)["liftoff_time"] * p["frequency"]
        # error of the difference of two states of the kernel, in periods
        self._error = 2.0 * max(time, bounds.speed_error(realization)) + 8.0 * EPS

    def from_rest_to_rest(self) -> Cycle | None:
        """Cycle between two rests that end at the same phase; None if there are no two such rests.

        Lift-offs are compared with that of rest 1, 2, 4, ... (Brent's algorithm), as in the
        kernels: with several phases of lift-off other rests may come before the cycle.
        """
        lifted = (n for n, i in enumerate(self.trajectory.impacts, 1) if i.rested)
        anchor, first = 0, 0  # number of a rest, and of its lift-off
        with ctx.workprec(2 * self.trajectory.precision_bits):
            for rest, state in enumerate(lifted, 1):
                same = False
                if anchor and state < len(self.times):
                    turns = (self.times[state] - self.times[first]) * self._frequency
                    periods = nearest_integer(turns)
                    same = bool(abs(turns - periods) < SAME_ORBIT)
                    if same and periods > 0:
                        return Cycle(first, state - first, periods, rest - anchor)
                if not same and rest >= 2 * anchor:
                    anchor, first = rest, state
        return None

    def recurrence(self, time: float, stated: int) -> Cycle | None:
        """Cycle without rests at a stated time, with the stated number of impacts if correct.

        A time (s) of NaN stands for the last state, and 0 impacts for a number that is not stated.
        None where the orbit does not repeat.
        """
        if self.trajectory.at_rest:
            return None
        with ctx.workprec(2 * self.trajectory.precision_bits):
            for since in self._at(time):
                impacts = self._cycle(since, stated)
                if impacts > 0:
                    return Cycle(since, impacts, self._periods(since - impacts, impacts), 0)
        return None

    def _at(self, time: float) -> Sequence[int]:
        """Numbers of the states that may be at a given time, or nearest to it."""
        if not math.isfinite(time):
            return [len(self.times) - 1]
        gaps = [float(abs(t - time)) for t in self.times]
        near = [n for n, gap in enumerate(gaps) if gap <= self.time_error]
        return near or [gaps.index(min(gaps))]

    def _periods(self, state: int, cycle: int) -> int:
        """Forcing periods from a state to the one `cycle` impacts later, as a whole number."""
        return nearest_integer((self.times[state + cycle] - self.times[state]) * self._frequency)

    def _cycle(self, since: int, stated: int) -> int:
        """Impacts in the cycle of a state; 0 if the orbit does not repeat.

        The stated number is correct if the orbit may repeat after it, and does not certainly repeat
        after one of its proper divisors.
        """
        if stated > 0 and self._repeats(since - stated, stated, SAME_ORBIT + self._error):
            shorter = (d for d in range(1, stated) if stated % d == 0)
            certain = SAME_ORBIT - self._error
            return next((d for d in shorter if self._repeats(since - stated, d, certain)), stated)
        others = range(1, since + 1)
        return next((n for n in others if self._repeats(since - n, n, SAME_ORBIT + self._error)), 0)

    def _repeats(self, first: int, cycle: int, error: float) -> bool:
        """Return whether all states from `first` on return a cycle later, up to an error."""
        last = len(self.times) - cycle
        if not 0 <= first < last:
            return False
        periods = self._periods(first, cycle)
        if periods < 1:
            return False
        for n in range(first, last):
            turns = (self.times[n + cycle] - self.times[n]) * self._frequency - periods
            if abs(turns) > error or abs(self.speeds[n + cycle] - self.speeds[n]) > error:
                return False
        return True

    def map(self) -> PeriodMap:
        """Map in forcing periods, at the current precision."""
        realization = self._realization
        return realization.reference.period_map(realization.parameters, realization.laws)

    def contraction(self, first: int, last: int) -> tuple[arb | float, float]:
        """Mean logarithm of the contraction of areas by impacts, from state `first` to `last`.

        Also returns its largest error, from the errors that the dataset claims.
        """
        error = self._bounds.speed_error(self._realization)
        speeds = [impact.arrival for impact in self.trajectory.impacts[first:last]]
        with ctx.workprec(self.trajectory.precision_bits):
            return self.map().contraction(speeds, error)

    def last_state(self) -> tuple[arb, arb]:
        """Phase in turns, not reduced, and speed of the last state."""
        with ctx.workprec(2 * self.trajectory.precision_bits):
            return self._turns(-1), self.speeds[-1]

    def growth(self, first: int, last: int) -> Mean:
        """Mean growth by the impacts from state `first` to state `last`."""
        with ctx.workprec(2 * self.trajectory.precision_bits):
            phases = [self._turns(n) for n in range(first, last)]
        errors = self._time_error, self._bounds.speed_error(self._realization)
        with ctx.workprec(FLOATING):
            return mean_growth(self.map(), phases, self.flights[first:last], errors)

    def _turns(self, state: int) -> arb:
        return self.times[state] * self._frequency + arb(self._realization.parameters["phase"]) / (
            2 * arb.pi()
        )

    def representative(self, cycle: Cycle) -> State | None:
        """State of a cycle with the lowest speed; of equally slow ones, that of lowest phase.

        Whole periods are counted with the phase of the forcing reduced to one turn.  None if states
        are too close to decide.
        """
        with ctx.workprec(2 * self.trajectory.precision_bits):
            whole = nearest_integer(arb(self._realization.parameters["phase"]) / (2 * arb.pi()))
            members = []
            for n in range(len(self.times) - cycle.impacts, len(self.times)):
                turns = self._turns(n)
                count = nearest_integer(turns)
                members.append(State(count - whole, float(turns - count), float(self.speeds[n])))
        slowest = min(member.speed for member in members)
        tied = sorted(
            (m for m in members if m.speed <= slowest + 3 * SAME_ORBIT), key=lambda m: m[1]
        )
        if any(m.speed > slowest + SAME_ORBIT / 3 for m in tied):
            return None
        found = tied[0]
        if len(tied) > 1 and tied[1].phase - found.phase < 3 * SAME_ORBIT:
            return None
        if found.phase < SAME_ORBIT / 3 - 0.5:  # -1/2 and 1/2 are the same phase
            return State(found.whole - 1, found.phase + 1.0, found.speed)
        return None if found.phase < 3 * SAME_ORBIT - 0.5 else found


def numbered(
    cycles: Sequence[Cycle | None], states: Sequence[State | None]
) -> Sequence[int | None]:
    """Number the orbits of particles, each new one after those of earlier particles.

    Each particle is given by its cycle and representative.  A particle without a cycle has the
    number -1; all are None if it cannot be decided whether two particles are on one orbit.
    """
    numbers: list[int] = []
    firsts: list[tuple[Cycle, State]] = []
    for cycle, state in zip(cycles, states, strict=True):
        if cycle is None:
            numbers.append(-1)
            continue
        same = [] if state is None else [_same(cycle, state, *first) for first in firsts]
        if state is None or None in same:
            return [None] * len(cycles)
        if True not in same:
            firsts.append((cycle, state))
            same.append(True)
        numbers.append(same.index(True))
    return numbers


def _same(cycle: Cycle, state: State, other: Cycle, first: State) -> bool | None:
    """Decide whether two particles are on one orbit; None if uncertain."""
    if (cycle.impacts, cycle.periods, cycle.rests) != (other.impacts, other.periods, other.rests):
        return False
    apart = state.phase - first.phase
    distance = max(abs(state.speed - first.speed), abs(apart - round(apart)))
    return None if SAME_ORBIT / 3 < distance < 3 * SAME_ORBIT else distance < SAME_ORBIT
