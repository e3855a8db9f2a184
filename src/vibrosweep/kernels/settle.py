"""The orbit on which each trajectory settles: regime, cycle, multipliers, Lyapunov exponents.

Cycles without rests are recognised while the trajectory is advanced (see `cycles`).  If the base
lifts resting particles at one phase only, the state after every rest is the same, bit for bit: an
orbit enters its cycle with its first rest and closes it with the second.  The exponents of an orbit
that does not recur are means over the landings in the window; `cycle_exponents` gives those of
cycles.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from vibrosweep.kernels import arithmetic, bases, trust
from vibrosweep.kernels._jit import Complexes, Flags, Floats, Integers, jit, uncounted
from vibrosweep.kernels.arithmetic import HALF_ULP, ROUNDING
from vibrosweep.kernels.bases import Base, Constants, Instant, StateError
from vibrosweep.kernels.cycles import CYCLE, FIRST_ANCHOR, Cycles
from vibrosweep.kernels.impact import Batch, carry, impact, launch, launch_speed, stretch
from vibrosweep.kernels.memory import empty
from vibrosweep.kernels.restitution import slack as slack_of
from vibrosweep.kernels.statistics import LANDINGS, RESTS, Statistics
from vibrosweep.kernels.trust import Enclosure
from vibrosweep.model.measures import Regime
from vibrosweep.model.parameters import Dimensionless

# --- Mean growth ----------------------------------------------------------------------------------
# Mean growth per impact along an orbit, with the error of the mean from means of blocks.
#
# Successive growths are correlated, so that the standard error of their mean does not follow from
# their variance.  They are gathered into blocks of equal length.  The means of blocks much longer
# than the correlation time are practically independent, and their variance gives the standard error
# of the mean (the method of batch means).  When all blocks are full, neighbours are joined and
# blocks become twice as long, because the number of impacts is not known beforehand.


BLOCKS = 32


class GrowthPlaces(NamedTuple):
    """Places of further numbers, which follow the means of the blocks in this order."""

    FILLED: int  # blocks
    LENGTH: int  # impacts of a block
    PARTIAL: int  # growth in the block that is being filled
    INSIDE: int  # impacts in it
    TOTAL: int  # growth
    COUNT: int  # impacts


GROWTH: Final = GrowthPlaces(*range(BLOCKS, BLOCKS + len(GrowthPlaces._fields)))
GROWTH_SIZE: Final = BLOCKS + len(GROWTH)


@jit
def logarithm(grown: float) -> float:
    """Logarithm of a growth, -inf of 0."""
    return arithmetic.log(grown) if grown > 0.0 else -np.inf


@jit
def reset_growth(g: Floats) -> None:
    """Discard all growth; `g` has `GROWTH_SIZE` numbers."""
    g[:] = 0.0
    g[GROWTH.LENGTH] = 1.0


@jit
def add_growth(g: Floats, grown: float) -> None:
    """Add the logarithm of the growth in one impact."""
    g[GROWTH.TOTAL] += grown
    g[GROWTH.COUNT] += 1.0
    g[GROWTH.PARTIAL] += grown
    g[GROWTH.INSIDE] += 1.0
    if g[GROWTH.INSIDE] < g[GROWTH.LENGTH]:
        return
    g[int(g[GROWTH.FILLED])] = g[GROWTH.PARTIAL] / g[GROWTH.LENGTH]
    g[GROWTH.PARTIAL] = g[GROWTH.INSIDE] = 0.0
    g[GROWTH.FILLED] += 1.0
    if g[GROWTH.FILLED] == BLOCKS:
        for b in range(BLOCKS // 2):
            g[b] = 0.5 * (g[2 * b] + g[2 * b + 1])
        g[GROWTH.FILLED] = BLOCKS // 2
        g[GROWTH.LENGTH] *= 2.0


@jit
def mean_growth(g: Floats) -> float:
    """Mean growth per impact; NaN if there are no impacts."""
    if g[GROWTH.COUNT] == 0.0:
        return np.nan
    return g[GROWTH.TOTAL] / g[GROWTH.COUNT]  # type: ignore[no-any-return]


@jit
def growth_error(g: Floats) -> float:
    """Standard error of the mean, from at most 31 blocks; NaN below two, 0 for a mean of -inf."""
    filled = int(g[GROWTH.FILLED])
    if g[GROWTH.TOTAL] == -np.inf:
        return 0.0
    if filled < 2:
        return np.nan
    middle, squares = 0.0, 0.0
    for b in range(filled):  # numpy.sum would choose another order
        middle += g[b] / filled
    for b in range(filled):
        squares += (g[b] - middle) * (g[b] - middle)
    return math.sqrt(squares / (filled * (filled - 1.0)))


# --- Exponents of a cycle -------------------------------------------------------------------------
# The multipliers are the eigenvalues of the product of the Jacobians of the impacts of the cycle.


class State(NamedTuple):
    """A state at lift-off."""

    whole: float  # whole periods and phase
    phase: float
    flight: float  # speed, as the duration of the flight that follows


class Exponent(NamedTuple):
    """An exponent per impact."""

    value: float
    error: float


class CycleExponents(NamedTuple):
    """Exponents of a cycle without rests: the largest, and the sum of both."""

    multiplier: complex  # the leading one
    largest: Exponent
    total: Exponent


TINY = 2.0**-500


@jit
def leading_eigenvalue(trace: float, determinant: float) -> complex:
    """Eigenvalue of largest modulus of a 2 x 2 matrix."""
    discriminant = trace * trace - 4.0 * determinant
    root = math.sqrt(abs(discriminant))
    if discriminant < 0.0:
        return complex(0.5 * trace, 0.5 * root)
    return complex(0.5 * (trace + math.copysign(root, trace)), 0.0)


@jit
def _eigenvalue_error(
    trace: float, determinant: float, trace_error: float, determinant_error: float
) -> float:
    """Error of the modulus of the leading eigenvalue."""
    discriminant = trace * trace - 4.0 * determinant
    change = 2.0 * abs(trace) * trace_error + trace_error * trace_error + 4.0 * determinant_error
    if discriminant < -change:  # the modulus is the root of the determinant
        return determinant_error / math.sqrt(determinant)
    root = math.sqrt(abs(discriminant))
    # at a double eigenvalue an error enters by its square root
    return 0.5 * (trace_error + min(change / max(root, TINY), math.sqrt(change)))


EXACT = StateError(0.0, 0.0)


@jit
def _widened(box: Enclosure, added: float, norm: float = 1.0) -> Enclosure:
    """Lengthen both sides of a box by `added`, and divide them by a norm."""
    return Enclosure(box.c, box.s, (box.along + added) / norm, (box.across + added) / norm)


@jit
def _state_error(fixed: Constants, state: State, impacts: int) -> StateError:
    """Bound the distance of a state on a cycle of rounded impacts from the exact cycle.

    To first order, roundings during one cycle add up to b at its end, and a distance d becomes
    M d + b.  The distance that repeats is d = (1 - M)^-1 b.
    """
    n, x, u = state
    box = trust.upright(EXACT)
    m00, m01, m10, m11 = 1.0, 0.0, 0.0, 1.0
    for _ in range(impacts):
        hit = impact(fixed, n, x, u)
        derivative = bases.jacobian(fixed, hit.flight)
        m00, m10 = carry(m00, m10, derivative)
        m01, m11 = carry(m01, m11, derivative)
        added = bases.landing_added(fixed, hit.flight, EXACT)
        rounding = added.phase + bases.rebound_error(fixed, hit.flight, added, added.phase, EXACT)
        box = _widened(trust.turn_box(box, derivative), rounding)
        n, x, u = hit.n_off, hit.x_off, hit.u
    dx, du = trust.extent(box)
    determinant = abs((1.0 - m00) * (1.0 - m11) - m01 * m10)
    # entries are rounded themselves
    slack = impacts * ROUNDING * (1.0 + abs(m00) + abs(m11) + abs(m01 * m10))
    if not determinant > slack:
        return StateError(np.inf, np.inf)
    determinant -= slack
    return StateError(
        (abs(1.0 - m11) * dx + abs(m01) * du) / determinant,
        (abs(m10) * dx + abs(1.0 - m00) * du) / determinant,
    )


@jit
def cycle_exponents(fixed: Constants, state: State, impacts: int) -> CycleExponents:
    """Return the exponents of a cycle without rests through a state."""
    n, x, u = state
    m00, m01, m10, m11 = 1.0, 0.0, 0.0, 1.0  # product over exp(scale): its largest row sum is 1
    c, d, area, slack = 1.0, 0.0, 0.0, 0.0
    scale, turned = 0.0, 1.0
    # impacts that contract by `shrunk`, and the logarithm of the contraction by others before
    alike, shrunk, exponent = 0, bases.contraction(fixed, u), 0.0
    # boxes of the errors of the state and of both columns
    box = trust.upright(_state_error(fixed, state, impacts))
    box_0, box_1 = trust.upright(EXACT), trust.upright(EXACT)
    for _ in range(impacts):
        hit = impact(fixed, n, x, u)
        derivative = bases.jacobian(fixed, hit.flight)
        factor = bases.contraction(fixed, hit.v)
        if factor != shrunk:
            exponent += alike * logarithm(shrunk)
            alike, shrunk = 0, factor
        alike += 1
        turned *= bases.reverses(fixed, hit.x, hit.v)
        n, x, u = hit.n_off, hit.x_off, hit.u
        off = trust.landing_error(box, derivative)
        changed = bases.jacobian_error(fixed, hit.flight, off, trust.spread_of(box))
        by_phase, by_speed, by_landing = changed
        box = trust.turn_box(box, derivative)
        box_0, box_1 = trust.turn_box(box_0, derivative), trust.turn_box(box_1, derivative)
        rounding = ROUNDING * derivative.size
        added_0, added_1 = rounding * (abs(m00) + abs(m10)), rounding * (abs(m01) + abs(m11))
        added_0, added_1 = added_0 + by_phase * abs(m00), added_1 + by_phase * abs(m01)
        added_0, added_1 = added_0 + by_speed * abs(m10), added_1 + by_speed * abs(m11)
        m00, m10 = carry(m00, m10, derivative)
        m01, m11 = carry(m01, m11, derivative)
        added_0, added_1 = added_0 + by_landing * abs(m00), added_1 + by_landing * abs(m01)
        norm = max(abs(m00) + abs(m01), abs(m10) + abs(m11))
        scale += logarithm(norm)
        m00, m01, m10, m11 = m00 / norm, m01 / norm, m10 / norm, m11 / norm
        box_0, box_1 = _widened(box_0, added_0, norm), _widened(box_1, added_1, norm)
        c, d, along, across, error = stretch(c, d, derivative)
        area += logarithm(along * across)
        slack += error + HALF_ULP * (abs(area) + 2.0)  # of the sum, and of the logarithm
    exponent += alike * logarithm(shrunk) - 2.0 * scale
    determinant = turned * arithmetic.exp(exponent)
    value = leading_eigenvalue(m00 + m11, determinant)
    modulus = abs(value)
    trace_error = trust.extent(box_0).phase + trust.extent(box_1).speed
    determinant_error = 0.0
    if determinant != 0.0:
        determinant_error = (impacts * ROUNDING + 4.0 * HALF_ULP * abs(exponent)) * abs(determinant)
    error = _eigenvalue_error(m00 + m11, determinant, trace_error, determinant_error)
    largest = (logarithm(modulus) + scale) / impacts
    relative = error / modulus if modulus > 0.0 else 0.0
    relative += HALF_ULP * impacts * (abs(scale) + 2.0)  # of the sum of logarithms
    if not relative < np.inf:  # at a multiplier of 1 the error of the state is not bounded
        relative = np.inf
    return CycleExponents(
        value * arithmetic.exp(scale),
        Exponent(largest, relative / impacts),
        Exponent(area / impacts, slack / impacts),
    )


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
    # 1 for exponents of every orbit; 0 to simulate only orbits that may prove to rest again and
    # again, or to be aperiodic
    exponents: int


class Orbits(NamedTuple):
    """Orbits that trajectories settle on, each array of shape (trajectory,)."""

    regime: Flags  # `vibrosweep.model.measures.Regime`
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


class RestCycle(NamedTuple):
    """Rests of a trajectory, until it has been lifted twice in the same state."""

    cycle: int  # rests in the cycle; 0 where it was not closed
    seen: int  # rests in the window
    first: float  # whole periods of the first of these lift-offs
    # impacts, periods: of the cycle
    impacts: int
    periods: int


@jit
def _simulate(
    fixed: Constants,
    launched: State,
    particle: int,
    begin: Instant,
    end: Instant,
    budget: int,
    g: Floats,
) -> tuple[State, RestCycle, float, float]:
    """Simulate a trajectory to its end, or until two rests have closed its cycle.

    Lift-offs are compared with that of rest 1, 2, 4, ... (Brent's algorithm), so that the cycle is
    found whatever rests precede it.  Returns the state reached, the rests, and, over the
    impacts in the window, the sum of the logarithms of areas with the bound on its rounding error.
    """
    n, x, u = launched
    c, d = 1.0, 0.0
    lifted, seen, first, since, impacts, periods = 0, 0, np.nan, 0, 0, 0
    anchor, x_first, u_first, closed = 0, np.nan, np.nan, 0
    area, slack = 0.0, 0.0
    reset_growth(g)
    for age in range(budget):
        hit = impact(fixed, n, x, u, particle, age)
        if not hit.n - end.whole <= end.phase - hit.x:
            break
        if begin.whole - hit.n <= hit.x - begin.phase:
            seen += 0 if hit.leaves else 1
            c, d, along, across, error = stretch(c, d, bases.jacobian(hit.fixed, hit.flight))
            add_growth(g, logarithm(along))
            before = bases.density(fixed, abs(u))
            if before > 0.0:
                area += logarithm(along * across * (bases.density(fixed, hit.u) / before))
            else:  # in these coordinates the area was 0
                area += logarithm(bases.contraction(hit.fixed, hit.v))
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
    return State(n, x, u), RestCycle(closed, seen, first, impacts, periods), area, slack


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
    if bases.contraction(fixed, 0.0) == 0.0 and not np.isnan(total.value):
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
        certain = trust.is_certain(fixed, state.phase, state.flight, impacts, abs(found.multiplier))
        out.uncertain[t] = 0 if certain else 1
    if out.uncertain[t] == 1:
        out.largest_error[t] = out.total_error[t] = np.inf


@jit
def _write_mean(
    t: int, fixed: Constants, area: float, slack: float, g: Floats, out: Orbits
) -> None:
    """Write the exponents of an orbit that does not recur, and does not rest in the window."""
    impacts = g[GROWTH.COUNT]
    total = Exponent(np.nan, np.nan)
    if impacts > 0.0:
        total = Exponent(area / impacts, slack / impacts)
    _write_exponents(t, fixed, Exponent(mean_growth(g), growth_error(g)), total, out)
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
    are written; `g` is memory of `GROWTH_SIZE` numbers that no other thread uses.
    """
    base, problem, launches = batch
    particles, (budget, exponents) = launches.whole.shape[1], search
    # realization and lift-off of the orbit with rests that was judged last, and the result
    judged, x_judged, doubtful = -1, np.nan, 0
    for t in range(first, last):
        i = t // particles
        fixed = bases.constants(base, problem, i)
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
        state, rests, area, slack = _simulate(fixed, launched, particle, begin, end, budget, g)
        if rests.cycle > 0:
            _, x, u = state
            if judged != i or x != x_judged:
                judged, x_judged = i, x
                doubtful = 0 if trust.is_certain(fixed, x, u, rests.impacts, 0.0) else 1
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


# --- The shortest flight of a cycle ---------------------------------------------------------------


class Shortest(NamedTuple):
    """The impact before the shortest flight of each cycle; every array has shape (cycle,)."""

    landed: Floats  # phase of the landing, turns
    left: Floats  # phase of the lift-off, turns: another one after a rest
    speed: Floats  # at lift-off, relative to the base, in units of g / (2 f)


def empty_shortest(cycles: int) -> Shortest:
    """Allocate the impacts of a batch of cycles."""
    return empty(Shortest, cycles)


@jit
def _plain(x: float) -> float:
    """Phase with -1/2 turned into 1/2, which is the same."""
    return x + 1.0 if x < SAME_ORBIT - 0.5 else x


@uncounted
def shortest_flights(
    first: int,
    last: int,
    base: Base,
    problem: Dimensionless,
    phase: Floats,
    speed: Floats,
    impacts: Integers,
    out: Shortest,
) -> None:
    """Find the shortest flight of cycles first ... last - 1; of equal ones, the one first in phase.

    Phase and speed relative to the base are those of a lift-off on the cycle, `impacts` its length;
    all arrays, those of the problem too, have shape (cycle,).
    """
    for i in range(first, last):
        out.landed[i] = out.left[i] = out.speed[i] = np.nan
        fixed = bases.constants(base, problem, i)
        hit = impact(fixed, 0.0, phase[i], speed[i])
        for _ in range(impacts[i] - 1):
            hit = impact(fixed, 0.0, hit.x_off, hit.u)
        x, u = phase[i], speed[i]
        landed = x if hit.leaves else hit.x
        shortest = np.inf
        for _ in range(impacts[i]):
            hit = impact(fixed, 0.0, x, u)
            longer = hit.flight.time - shortest
            if longer < -SAME_ORBIT or (longer <= SAME_ORBIT and x < out.left[i] - SAME_ORBIT):
                shortest = hit.flight.time
                out.landed[i], out.left[i], out.speed[i] = _plain(landed), _plain(x), u
            landed, x, u = hit.x, hit.x_off, hit.u
