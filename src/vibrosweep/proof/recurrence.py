"""Recurrence of a proved orbit: whether it repeats as stated, its cycle, slot and exponents.

The state after a rest depends only on the phase at which the rest ends: two rests that end at the
same phase close a cycle, which the orbit entered with the first.  Otherwise the kernel detects
recurrence when a state returns bit for bit, whereas the exact orbit approaches its cycle
asymptotically.  A proof can show that it repeats as stated, up to the tolerance with which the
kernel identifies states and the errors that the dataset claims; impacts and periods of the cycle
then follow exactly.  Recurrence is stated at the second occurrence of a state, after which the
orbit may end almost at once; so states are compared from the first occurrence on.

`mean_growth` follows small perturbations along an orbit.  The kernel's orbit differs from the
proved one by no more than the dataset's bounds, and its Jacobians differ accordingly.  A change of
a Jacobian changes the growth at that impact, and turns the direction that is carried on: both
effects are followed here to first order, and doubled to cover the higher orders.

`largest_exponent` proves that a cycle exists, and its multipliers.  The state (x, u), phase and
speed relative to the base at lift-off, lies on a cycle of p impacts in q periods if p impacts lead
to (x + q, u).  Newton's method finds it next to a state of an orbit; the interval Newton operator
(Krawczyk 1969; Moore 1966) then maps a box around it into its interior, which proves that one and
only one such state lies in the box, and the Jacobians over the box enclose the cycle's own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from vibrosweep.kernels.settle import SAME_ORBIT
from vibrosweep.model.measures import Regime
from vibrosweep.proof.claims import Bounds
from vibrosweep.proof.reference.arithmetic import arb, ctx, nearest_integer
from vibrosweep.proof.reference.motion import EPS, Flight, PeriodMap, Trajectory
from vibrosweep.proof.sampling import Realization

MOST_BLOCKS: Final = 32
TURNED: Final = 1e-3  # error of the direction beyond which the first-order estimate is useless
FIRST_ORDER: Final = 2.0


class Mean(NamedTuple):
    """Mean logarithm of the growth per impact."""

    value: float
    # Standard error of the mean, from the means of blocks; None below two blocks
    standard_error: float | None
    # Bound on the errors of both, from the dataset's bounds; None where there is none
    claim: float | None


def mean_growth(
    m: PeriodMap, phases: Sequence[arb], flights: Sequence[Flight], errors: tuple[float, float]
) -> Mean:
    """Mean growth of a perturbation of the phase alone, over one or more impacts without rests.

    The phases of successive lift-offs (turns) and the flights that follow them are proved; the
    kernel's phases and speeds may be off by `errors`.
    """
    c, s, turned, logarithms, wrongs = 1.0, 0.0, 0.0, [], []
    for x, flight in zip(phases, flights, strict=True):
        carried = m.carried(x, flight, (c, s), errors)
        (ax, ay), (bx, by) = carried.along, carried.across
        along = math.hypot(ax, ay)
        if along == 0.0:
            return Mean(-math.inf, 0.0, 0.0 if turned == 0.0 else None)
        wrong = carried.wrong / along
        logarithms.append(math.log(along))
        wrongs.append(abs(ax * bx + ay * by) / along**2 * turned + wrong + 4.0 * EPS)
        turned = abs(ax * by - ay * bx) / along**2 * turned + wrong
        c, s = ax / along, (-ay if carried.turned_back else ay) / along
        if not turned <= TURNED:
            return Mean(math.nan, None, None)
    claim = FIRST_ORDER * max(wrongs) + 2.0 * len(wrongs) * EPS * max(map(abs, logarithms))
    return Mean(math.fsum(logarithms) / len(logarithms), _standard_error(logarithms), claim)


def _standard_error(logarithms: Sequence[float]) -> float | None:
    """Standard error of a mean, from the means of fewer than `MOST_BLOCKS` blocks."""
    length = 1
    while len(logarithms) // length >= MOST_BLOCKS:
        length *= 2
    blocks = len(logarithms) // length
    if blocks < 2:
        return None
    means = [math.fsum(logarithms[b * length : (b + 1) * length]) / length for b in range(blocks)]
    middle = math.fsum(means) / blocks
    return math.sqrt(math.fsum((m - middle) ** 2 for m in means) / (blocks * (blocks - 1)))


# Impacts; a longer cycle would take too long to verify.
MAX_CYCLE: Final = 1000
# Periods; if the cycle found by Newton's method is farther from the orbit, it is another one.
NEAR: Final = 2.0**-20
ROUNDS: Final = 40


class _Return(NamedTuple):
    """Image of a state after one cycle, and the Jacobian along it, by rows."""

    x: arb
    u: arb
    jacobian: tuple[arb, arb, arb, arb]
    determinant: arb


def largest_exponent(
    map_of: Callable[[], PeriodMap],
    state: tuple[arb, arb],
    impacts: int,
    periods: int,
) -> arb | None:
    """Largest Lyapunov exponent per impact of the cycle without rests that passes next to a state.

    The state, phase in turns and speed at lift-off, is one of an orbit that has come near to the
    cycle; `map_of` returns the map in forcing periods, at the current precision.  None if no such
    cycle is proved: a decision along it is uncertain, a multiplier may be 1 or all may be 0, or it
    is longer than `MAX_CYCLE`.
    """
    if impacts > MAX_CYCLE:
        return None
    with ctx.workprec(128 + 4 * math.ceil(impacts * map_of().lost())):
        found = _proved_return(map_of(), state, impacts, periods)
        return None if found is None else _exponent(found, impacts)


def _proved_return(
    m: PeriodMap, state: tuple[arb, arb], impacts: int, periods: int
) -> _Return | None:
    """Return from a box in which the cycle is proved to pass, or None."""
    x, u = state[0].mid(), state[1].mid()
    radius = arb(2) ** (-ctx.prec // 2)
    for _ in range(ROUNDS):
        back = _once_round(m, x, u, impacts)
        step = None if back is None else _newton(back, back, x, u, periods)
        if step is None:
            return None
        x, u = (x + step[0]).mid(), (u + step[1]).mid()
        if not (abs(x - state[0]) < NEAR and abs(u - state[1]) < NEAR):
            return None
        if abs(step[0]) < radius and abs(step[1]) < radius:
            break
    back = _once_round(m, x, u, impacts)
    wide = arb(0, radius)
    box = _once_round(m, x + wide, u + wide, impacts)
    if back is None or box is None:
        return None
    step = _newton(back, box, x, u, periods)
    inside = step is not None and abs(step[0]) < radius and abs(step[1]) < radius
    return box if inside else None


def _once_round(m: PeriodMap, x: arb, u: arb, impacts: int) -> _Return | None:
    """Follow a ball of states round the cycle; None if one may rest, or a decision is uncertain."""
    j00, j01, j10, j11 = arb(1), arb(0), arb(0), arb(1)
    determinant = arb(1)
    for _ in range(impacts):
        step = m.step(x, u)
        if step is None:
            return None
        (xx, xu), (ux, uu) = step.rows
        j00, j10 = xx * j00 + xu * j10, ux * j00 + uu * j10
        j01, j11 = xx * j01 + xu * j11, ux * j01 + uu * j11
        determinant *= step.determinant
        x, u = x + step.duration, step.speed
    return _Return(x, u, (j00, j01, j10, j11), determinant)


def _newton(back: _Return, slope: _Return, x: arb, u: arb, periods: int) -> tuple[arb, arb] | None:
    """Step to the fixed point from the residual of `back` and the Jacobian of `slope`."""
    j00, j01, j10, j11 = slope.jacobian
    j00, j11 = j00 - 1, j11 - 1
    determinant = j00 * j11 - j01 * j10
    if determinant.contains(0):
        return None
    g, h = x + periods - back.x, u - back.u
    return (j11 * g - j01 * h) / determinant, (j00 * h - j10 * g) / determinant


def _exponent(found: _Return, impacts: int) -> arb | None:
    """Logarithm of the largest modulus of the eigenvalues, per impact."""
    trace = abs(found.jacobian[0] + found.jacobian[3])
    discriminant = trace * trace - 4 * found.determinant
    if discriminant < 0:
        modulus = found.determinant.sqrt()
    else:  # where it may be 0, the modulus is between those of both cases
        root = discriminant.abs_upper().sqrt()
        least = discriminant.abs_lower().sqrt() if discriminant > 0 else arb(0)
        modulus = (trace + least.union(root)) / 2
    return modulus.log() / impacts if modulus > 0 else None


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


class Representative(NamedTuple):
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

    def representative(self, cycle: Cycle) -> Representative | None:
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
                members.append(
                    Representative(count - whole, float(turns - count), float(self.speeds[n]))
                )
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
            return Representative(found.whole - 1, found.phase + 1.0, found.speed)
        return None if found.phase < 3 * SAME_ORBIT - 0.5 else found


def numbered(
    cycles: Sequence[Cycle | None], states: Sequence[Representative | None]
) -> Sequence[int | None]:
    """Number the orbits of particles, each new one after those of earlier particles.

    Each particle is given by its cycle and representative.  A particle without a cycle has the
    number -1; all are None if it cannot be decided whether two particles are on one orbit.
    """
    numbers: list[int] = []
    firsts: list[tuple[Cycle, Representative]] = []
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


def _same(cycle: Cycle, state: Representative, other: Cycle, first: Representative) -> bool | None:
    """Decide whether two particles are on one orbit; None if uncertain."""
    if (cycle.impacts, cycle.periods, cycle.rests) != (other.impacts, other.periods, other.rests):
        return False
    apart = state.phase - first.phase
    distance = max(abs(state.speed - first.speed), abs(apart - round(apart)))
    return None if SAME_ORBIT / 3 < distance < 3 * SAME_ORBIT else distance < SAME_ORBIT
