"""The orbit on which each trajectory settles: regime, cycle, multipliers, Lyapunov exponents.

Cycles without rests are recognised while the trajectory is advanced (see `cycles`).  If the base
lifts resting particles at one phase only, the state after every rest is the same, bit for bit: an
orbit enters its cycle with its first rest and closes it with the second.  The exponents of an orbit
that does not recur are means over the landings in the window; `exponents` computes those of cycles.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels import growth
from vibrosweep.kernels._jit import Complexes, Flags, Floats, Integers, jit, uncounted
from vibrosweep.kernels.bases import Constants, Instant, constants, contraction, density, jacobian
from vibrosweep.kernels.cycles import CYCLE, FIRST_ANCHOR, Cycles
from vibrosweep.kernels.exponents import Exponent, State, cycle_exponents
from vibrosweep.kernels.impact import Batch, impact, launch, launch_speed
from vibrosweep.kernels.restitution import slack as slack_of
from vibrosweep.kernels.rounding import HALF_ULP, ROUNDING
from vibrosweep.kernels.statistics import LANDINGS, RESTS, Statistics
from vibrosweep.kernels.tangent import stretch
from vibrosweep.kernels.trust import is_certain
from vibrosweep.kernels.unwritten import empty
from vibrosweep.model.status import Regime

__all__ = ["SAME_ORBIT"]

# Periods.  Two particles on the same orbit differ by the rounding error of an impact divided by 1 -
# |leading multiplier|, and so do successive rounds of a cycle whose exact bits return only after
# several rounds.  Distinct points of a cycle are never this close, except right after a period
# doubling.
SAME_ORBIT = 2.0**-30
NONE_LEFT = Exponent(-np.inf, 0.0)  # a rest removes every deviation
CERTAIN = 3.0  # standard errors by which the exponent of an aperiodic orbit exceeds zero

UNDETERMINED = -1  # as flags that could not be decided
AT_REST = int(Regime.AT_REST)
RESTING = int(Regime.RESTING)
LOCKED = int(Regime.LOCKED)
UNSETTLED = int(Regime.UNSETTLED)
APERIODIC = int(Regime.APERIODIC)


class Search(NamedTuple):
    """Limits of the search for orbits."""

    budget: int  # largest number of impacts of a trajectory
    # 1 for exponents of every orbit; 0 to follow only orbits that may prove to rest again and
    # again, or to be aperiodic
    exponents: int


class Orbits(NamedTuple):
    """Orbits that trajectories settle on, each array of shape (trajectory,)."""

    regime: Flags  # `vibrosweep.model.status.Regime`
    # impacts, periods, rests: impacts, forcing periods and rests in one cycle; 0 where no
    # recurrence was found
    impacts: Integers
    periods: Integers
    rests: Integers
    # 1 where rounding may have changed a decision along the cycle, 0 where it cannot have, -1 where
    # there is no cycle
    uncertain: Flags
    # Time in forcing periods from which on the orbit is known to repeat, a lift-off from rest if it
    # has rests; NaN if it is not known to repeat
    since: Floats
    # whole, phase, flight: a state from which the orbit can be continued: whole periods and phase
    # of a lift-off, and its speed relative to the base, in units of g / (2 f), which over a base at
    # rest is the duration of the flight that follows.  On a cycle, the representative: the state
    # with the smallest speed, which is the same for all particles on one orbit, up to rounding.  At
    # rest for good, the last landing, with a speed of 0.  NaN if the trajectory was not simulated.
    whole: Floats
    phase: Floats
    flight: Floats
    # The leading multiplier of the cycle, 0 if it has a rest; NaN where there is no cycle
    multiplier: Complexes
    # largest, largest_error: largest Lyapunov exponent per impact, and the standard error of its
    # mean, or the rounding error to first order where multipliers give it; -inf with error 0 for a
    # cycle with a rest, and at rest for good; NaN where the window has a rest and no cycle is
    # closed.  The error is infinite where the cycle is uncertain.
    largest: Floats
    largest_error: Floats
    # total, total_error: sum of both exponents per impact, from the areas of the frames that are
    # carried along, and the bound on its rounding error; -inf with error 0 also without restitution
    total: Floats
    total_error: Floats


def empty_orbits(trajectories: int) -> Orbits:
    """Allocate the orbits of a batch."""
    return empty(Orbits, trajectories)


class Rests(NamedTuple):
    """Rests of a trajectory, until it has been lifted twice in the same state."""

    cycle: int  # rests in the cycle; 0 where it was not closed
    seen: int  # rests in the window
    first: float  # whole periods of the first of these lift-offs
    # impacts, periods: of the cycle
    impacts: int
    periods: int


@jit
def _follow(
    fixed: Constants,
    launched: State,
    particle: int,
    begin: Instant,
    end: Instant,
    budget: int,
    g: Floats,
) -> tuple[State, Rests, float, float]:
    """Simulate a trajectory to its end, or until two rests have closed its cycle.

    Lift-offs are compared with that of rest 1, 2, 4, ... (Brent's algorithm), so that the cycle is
    found whatever rests came before it.  Returns the state reached, the rests, and, over the
    impacts in the window, the sum of the logarithms of areas with the bound on its rounding error.
    """
    n, x, u = launched
    c, d = 1.0, 0.0
    lifted, seen, first, since, impacts, periods = 0, 0, np.nan, 0, 0, 0
    anchor, x_first, u_first, closed = 0, np.nan, np.nan, 0
    area, slack = 0.0, 0.0
    growth.empty(g)
    for age in range(budget):
        hit = impact(fixed, n, x, u, particle, age)
        if not hit.n - end.whole <= end.phase - hit.x:
            break
        if begin.whole - hit.n <= hit.x - begin.phase:
            seen += 0 if hit.leaves else 1
            c, d, along, across, error = stretch(c, d, jacobian(hit.fixed, hit.flight))
            growth.add(g, growth.logarithm(along))
            before = density(fixed, abs(u))
            if before > 0.0:
                area += growth.logarithm(along * across * (density(fixed, hit.u) / before))
            else:  # in these coordinates the area was 0
                area += growth.logarithm(contraction(hit.fixed, hit.v))
                error = ROUNDING * (1.0 + 2.0 * slack_of(fixed.base.restitution))
            slack += error + HALF_ULP * (abs(area) + 2.0)  # of the sum, and of the logarithm
        if hit.n_off == np.inf:
            n, x, u = hit.n, hit.x, 0.0
            break
        n, x, u = hit.n_off, hit.x_off, hit.u
        if not hit.leaves and fixed.base.noise is None:  # random motion never repeats
            lifted += 1
            same = x == x_first and u == u_first
            if same and n > first:  # time has passed
                closed, impacts, periods = lifted - anchor, age - since, int(n - first)
                break
            if not same and lifted >= 2 * anchor:
                anchor, first, since, x_first, u_first = lifted, n, age, x, u
    return State(n, x, u), Rests(closed, seen, first, impacts, periods), area, slack


@jit
def _next(fixed: Constants, state: State) -> State:
    """State after the next impact."""
    hit = impact(fixed, state.whole, state.phase, state.flight)
    return State(hit.n_off, hit.x_off, hit.u)


@jit
def _periods_of(fixed: Constants, x: float, u: float, impacts: int, shorter: int) -> int:
    """Periods of a shorter cycle that equals this one up to rounding; 0 if there is none."""
    state = ahead = State(0.0, x, u)
    for _ in range(shorter):
        ahead = _next(fixed, ahead)
    periods = np.rint(ahead.whole + (ahead.phase - x))
    for _ in range(impacts):
        apart = (ahead.whole - state.whole - periods) + (ahead.phase - state.phase)
        if abs(apart) > SAME_ORBIT or abs(ahead.flight - state.flight) > SAME_ORBIT:
            return 0
        state, ahead = _next(fixed, state), _next(fixed, ahead)
    return int(periods)


@jit
def _shortest(fixed: Constants, x: float, u: float, impacts: int, periods: int) -> tuple[int, int]:
    """Impacts and periods of a cycle; states closer than `SAME_ORBIT` count as equal.

    Rounding can make an orbit alternate between neighbouring doubles; its exact bits then repeat
    only after a multiple of the true period.
    """
    for shorter in range(1, impacts // 2 + 1):
        if impacts % shorter == 0:
            found = _periods_of(fixed, x, u, impacts, shorter)
            if found > 0:
                return shorter, found
    return impacts, periods


@jit
def _representative(fixed: Constants, state: State, impacts: int) -> State:
    """Member of the cycle with the smallest speed; of equal ones that with the first phase."""
    best = state
    for _ in range(impacts):
        state = _next(fixed, state)
        tie = abs(state.flight - best.flight) <= SAME_ORBIT
        first = tie and state.phase < best.phase - SAME_ORBIT
        if state.flight < best.flight - SAME_ORBIT or first:
            best = state
    if best.phase < SAME_ORBIT - 0.5:  # -1/2 and 1/2 are the same phase
        return State(best.whole - 1.0, best.phase + 1.0, best.flight)
    return best


@jit
def _write_exponents(
    t: int, fixed: Constants, largest: Exponent, total: Exponent, out: Orbits
) -> None:
    """Write both exponents of a trajectory, each with its error."""
    out.largest[t], out.largest_error[t] = largest
    out.total[t], out.total_error[t] = total
    # every impact removes one dimension; without an impact nothing is known
    if contraction(fixed, 0.0) == 0.0 and not np.isnan(total.value):
        out.total[t], out.total_error[t] = -np.inf, 0.0


@jit
def _write_cycle(fixed: Constants, t: int, state: State, out: Orbits) -> None:
    """Write a cycle through a state: its representative, multiplier and exponents.

    `out` already holds its impacts and rests and, if it has rests, whether it is uncertain.
    """
    impacts = out.impacts[t]
    state = _representative(fixed, state, impacts)
    out.whole[t], out.phase[t], out.flight[t] = state
    if out.rests[t] > 0:
        out.multiplier[t] = 0.0
        _write_exponents(t, fixed, NONE_LEFT, NONE_LEFT, out)
    else:
        found = cycle_exponents(fixed, state, impacts)
        out.multiplier[t] = found.multiplier
        _write_exponents(t, fixed, found.largest, found.total, out)
        certain = is_certain(fixed, state.phase, state.flight, impacts, abs(found.multiplier))
        out.uncertain[t] = 0 if certain else 1
    if out.uncertain[t] == 1:
        out.largest_error[t] = out.total_error[t] = np.inf


@jit
def _write_mean(
    t: int, fixed: Constants, area: float, slack: float, g: Floats, out: Orbits
) -> None:
    """Write the exponents of an orbit that does not recur, and does not rest in the window."""
    impacts = g[growth.AT.COUNT]
    total = Exponent(np.nan, np.nan)
    if impacts > 0.0:
        total = Exponent(area / impacts, slack / impacts)
    _write_exponents(t, fixed, Exponent(growth.mean(g), growth.error(g)), total, out)
    positive = out.largest[t] > CERTAIN * out.largest_error[t]
    if impacts >= FIRST_ANCHOR and positive and out.regime[t] == UNSETTLED:
        out.regime[t] = APERIODIC


@jit
def _write_nothing(t: int, out: Orbits) -> None:
    """Write an undetermined orbit."""
    out.regime[t] = UNSETTLED
    out.impacts[t] = out.periods[t] = out.rests[t] = 0
    out.uncertain[t], out.since[t] = -1, np.nan
    out.whole[t] = out.phase[t] = out.flight[t] = np.nan
    out.multiplier[t] = complex(np.nan, np.nan)
    out.largest[t] = out.largest_error[t] = out.total[t] = out.total_error[t] = np.nan


@uncounted
def settle(
    first: int,
    last: int,
    batch: Batch,
    statistics: Statistics,
    cycles: Cycles,
    search: Search,
    g: Floats,
    out: Orbits,
) -> None:
    """Determine the orbits on which trajectories first ... last - 1 of a batch settle.

    Statistics and cycles are those that `advance` has written.  Only the slots first ... last - 1
    are written; `g` is memory of `growth.SIZE` numbers that no other thread uses.
    """
    base, problem, launches = batch
    particles, (budget, exponents) = launches.whole.shape[1], search
    # realization and lift-off of the orbit with rests that was judged last, and the result
    judged, x_judged, doubtful = -1, np.nan, 0
    for t in range(first, last):
        i = t // particles
        fixed = constants(base, problem, i)
        _write_nothing(t, out)
        at_rest = statistics.at_rest[t] > 0
        recurs = cycles[CYCLE.IMPACTS, t] > 0.0 and not at_rest
        if recurs and cycles[CYCLE.RESTS, t] == 0.0:
            x, u = cycles[CYCLE.PHASE, t], cycles[CYCLE.FLIGHT, t]
            n = cycles[CYCLE.WHOLE, t] + problem.end_count[i]
            impacts, periods = int(cycles[CYCLE.IMPACTS, t]), int(cycles[CYCLE.PERIODS, t])
            out.impacts[t], out.periods[t] = _shortest(fixed, x, u, impacts, periods)
            out.regime[t], out.since[t] = LOCKED, n + (x - problem.phase[i])
            _write_cycle(fixed, t, State(n, x, u), out)
            continue
        out.regime[t] = AT_REST if at_rest else UNSETTLED
        if base.noise is not None:
            out.regime[t] = AT_REST if at_rest else UNDETERMINED
            if exponents == 0:
                continue
        n, x = launch(launches, i, t % particles, problem.phase[i])
        begin = Instant(problem.begin_count[i], problem.begin_phase[i])
        end = Instant(problem.end_count[i], problem.end_phase[i])
        if exponents == 0:
            # statistics do not count rests before the window
            rests_again = (
                recurs or statistics.totals[RESTS, t] > 1.0 or begin.whole - n > x - begin.phase
            )
            if at_rest or not (rests_again or statistics.totals[LANDINGS, t] >= FIRST_ANCHOR):
                continue
        launched, particle = State(n, x, launch_speed(fixed, problem, i, x)), t % particles
        state, rests, area, slack = _follow(fixed, launched, particle, begin, end, budget, g)
        if rests.cycle > 0:
            _, x, u = state
            if judged != i or x != x_judged:
                judged, x_judged = i, x
                doubtful = 0 if is_certain(fixed, x, u, rests.impacts, 0.0) else 1
            out.regime[t], out.rests[t], out.uncertain[t] = RESTING, rests.cycle, doubtful
            out.impacts[t], out.periods[t] = rests.impacts, rests.periods
            out.since[t] = rests.first + (x - problem.phase[i])
            _write_cycle(fixed, t, State(rests.first, x, u), out)
            continue
        out.whole[t], out.phase[t], out.flight[t] = state
        if at_rest:
            _write_exponents(t, fixed, NONE_LEFT, NONE_LEFT, out)
        elif rests.seen == 0:
            _write_mean(t, fixed, area, slack, g, out)
