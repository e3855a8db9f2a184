"""Closed orbits of p impacts in q forcing periods as solutions of p equations in p phases.

Two landings determine the flight between them, and so its speeds at both ends (`chord`).  An orbit
is closed if each impact turns the speed of arrival of one flight into the initial speed of the
next.  Each equation contains three successive phases, so that Newton's method on all phases is as
well conditioned as one impact, however unstable the orbit.

Landing times are in forcing periods, ascending within q periods; they are not reduced.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibrosweep.kernels import bases
from vibrosweep.kernels._jit import Flags, Floats, Integers, jit, kernel, part
from vibrosweep.kernels.bases import Base, Constants, Flight
from vibrosweep.kernels.impact import impact
from vibrosweep.kernels.memory import unwritten
from vibrosweep.kernels.waveforms import depth_of, falls_of, peak_of, turning
from vibrosweep.model.parameters import Dimensionless

STEPS = 24  # of Newton's method; seeds that lead to an orbit need 10
LONGEST_STEP = 0.15  # periods
# After a step this small one more follows: the error is then below rounding, except near a double
# orbit, which rounding moves by 1e-8
SMALL_STEP = 1e-9
SAME = 1e-7  # periods; closer orbits count as one
ADMISSIBLE, MEETS_BASE, RESTS = 1, 0, -1
AT_LANDING = 1e-9  # periods; an earlier landing is farther than this from the end of the flight


class Tangent(NamedTuple):
    """Trace and determinant of the Jacobian of a whole orbit."""

    trace: float
    determinant: float


@jit
def reduced(time: float) -> float:
    """Phase of a time in periods, in [-1/2, 1/2]."""
    return time - np.rint(time)  # type: ignore[no-any-return]


@jit
def flight(fixed: Constants, times: Floats, p: int, q: int, i: int) -> Flight:
    """Flight from the landing i to the next one."""
    last = i == p - 1
    end = times[0] + q if last else times[i + 1]
    s, x = end - times[i], reduced(times[i])
    u, v = bases.chord(fixed, x, s)
    return Flight(x, u, s, reduced(end), v)


@part
def linearize(
    fixed: Constants, times: Floats, p: int, q: int, off: Floats, matrix: Floats
) -> Tangent:
    """Write the residuals of the speeds after the p impacts, and their derivatives by the times.

    Returns the trace and the determinant of the Jacobian of phase and speed over the orbit.
    """
    off[:p] = 0.0
    matrix[:p, :p] = 0.0
    a, b, c, d = 1.0, 0.0, 0.0, 1.0
    determinant = 1.0
    for i in range(p):
        j = i + 1 if i < p - 1 else 0
        arc = flight(fixed, times, p, q, i)
        xx, xu, ux, uu, _ = bases.jacobian(fixed, arc)
        off[i] += arc.u
        off[j] -= bases.rebound(fixed, arc.landing, arc.v)
        by_end, by_start = 1.0 / xu, -xx / xu  # of the speed at lift-off
        matrix[i, i] += by_start
        matrix[i, j] += by_end
        matrix[j, i] -= ux + uu * by_start
        matrix[j, j] -= uu * by_end
        determinant *= xx * uu - xu * ux
        a, b, c, d = xx * a + xu * c, xx * b + xu * d, ux * a + uu * c, ux * b + uu * d
    return Tangent(a + d, determinant)


@part
def solve(matrix: Floats, b: Floats, n: int) -> bool:
    """Solve n linear equations in place, with pivots; return whether they are regular."""
    for k in range(n):
        most = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[most, k]):
                most = i
        if not abs(matrix[most, k]) > 0.0:
            return False
        if most != k:
            for j in range(k, n):
                matrix[k, j], matrix[most, j] = matrix[most, j], matrix[k, j]
            b[k], b[most] = b[most], b[k]
        for i in range(k + 1, n):
            factor = matrix[i, k] / matrix[k, k]
            for j in range(k + 1, n):
                matrix[i, j] -= factor * matrix[k, j]
            b[i] -= factor * b[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            b[k] -= matrix[k, j] * b[j]
        b[k] /= matrix[k, k]
    return True


@jit
def ascends(times: Floats, p: int, q: int) -> bool:
    """Return whether the landing times ascend."""
    for i in range(p - 1):
        if not times[i + 1] > times[i]:
            return False
    return times[p - 1] < times[0] + q  # type: ignore[no-any-return]


@part
def close(fixed: Constants, times: Floats, p: int, q: int, off: Floats, matrix: Floats) -> bool:
    """Improve landing times by Newton's method; return whether they converge to an orbit."""
    small = 0
    for _ in range(STEPS):
        linearize(fixed, times, p, q, off, matrix)
        if not solve(matrix, off, p):
            return False
        longest = 0.0
        for i in range(p):
            longest = max(longest, abs(off[i]))
        if not longest < math.inf:
            return False
        share = LONGEST_STEP / longest if longest > LONGEST_STEP else 1.0
        for i in range(p):
            times[i] -= share * off[i]
        if not ascends(times, p, q):
            return False
        small = small + 1 if longest < SMALL_STEP else 0
        if small == 2:
            return True
    return False


@jit
def primitive(times: Floats, p: int, q: int) -> int:
    """Return after how many impacts the orbit repeats."""
    for d in range(1, p):
        if p % d == 0 and (q * d) % p == 0:
            off = 0.0
            for i in range(p - d):
                off = max(off, abs(times[i + d] - times[i] - q * d // p))
            if off < SAME:
                return d
    return p


@jit
def same(one: Floats, other: Floats, p: int, q: int) -> bool:
    """Return whether two orbits are the same, whichever impact and period they begin with."""
    for k in range(p):
        first = reduced(other[k] - one[0])
        off = abs(first)
        for i in range(1, p):
            j = i + k
            passed = other[j] if j < p else other[j - p] + q
            off = max(off, abs(passed - other[k] + first - (one[i] - one[0])))
        if off < SAME:
            return True
    return False


@part
def begin_shortest(times: Floats, p: int, q: int, scratch: Floats) -> None:
    """Reorder the landing times so that the shortest flight is the first.

    Of equally short flights the one with the smallest phase is taken.  The first time becomes its
    phase, in [-1/2, 1/2).
    """
    shortest, best, phase = math.inf, 0, math.inf
    for i in range(p):
        s = (times[i + 1] if i < p - 1 else times[0] + q) - times[i]
        x = reduced(times[i])
        x = x + 1.0 if x < SAME - 0.5 else x
        if s < shortest - SAME or (s <= shortest + SAME and x < phase):
            shortest, best, phase = s, i, x
    whole = np.rint(times[best])
    for i in range(p):
        j = i + best
        scratch[i] = (times[j] if j < p else times[j - p] + q) - whole
    times[:p] = scratch[:p]


@part
def admits(fixed: Constants, times: Floats, p: int, q: int) -> int:
    """Return whether a particle can follow the orbit: `ADMISSIBLE`, `MEETS_BASE` or `RESTS`."""
    for i in range(p):
        arc = flight(fixed, times, p, q, i)
        w = bases.rebound(fixed, arc.landing, arc.v)
        if not bases.lift_off(fixed, 0.0, arc.landing, w).leaves:
            return RESTS
    for i in range(p):
        arc = flight(fixed, times, p, q, i)
        time, _ = bases.fly(fixed, arc.x, arc.u)
        if not (arc.v > 0.0 and abs(time - arc.time) <= AT_LANDING * max(1.0, arc.time)):
            return MEETS_BASE
    return ADMISSIBLE


@jit
def power_trace(tangent: Tangent, d: int) -> Tangent:
    """Trace and determinant of an orbit that is traversed d times."""
    before, trace, determinant = 2.0, tangent.trace, tangent.determinant
    for _ in range(d - 1):
        before, trace = trace, tangent.trace * trace - tangent.determinant * before
    return Tangent(trace, determinant**d)


# --- The list of orbits ---------------------------------------------------------------------------


NO_ORBIT = -2  # in addition to the codes of `admits`


class Closed(NamedTuple):
    """Orbits; the first dimension of every array is (problem,), the second (orbit,) or (p, q)."""

    orbits: Integers  # (problem,): their number, -1 where they exceed the capacity
    impacts: Integers  # 0 past the last orbit, like the periods
    periods: Integers
    admissible: Flags  # `NO_ORBIT` past the last one
    trace: Floats  # of the Jacobian of phase and speed over the orbit
    determinant: Floats
    # times, speed, arrival: (problem, orbit, impact): landing times in periods, the first one a
    # phase; absolute speed at the lift-off; relative speed at the landing that ends its flight
    times: Floats
    speed: Floats
    arrival: Floats
    born: Integers  # number of the seed that led to it, 0 for those found otherwise
    # seeds, late: (problem, p, q): seeds, and new orbits found by their last half
    seeds: Integers
    late: Integers
    # saddles, others: points with a real multiplier above 1, and without; see above
    saddles: Integers
    others: Integers


@jit
def _place(i: int, times: Floats, p: int, q: int, out: Closed) -> int:
    """Index of an orbit among those that are stored, or their number if it is not among them."""
    for k in range(out.orbits[i]):
        alike = out.impacts[i, k] == p and out.periods[i, k] == q
        if alike and same(out.times[i, k], times, p, q):
            return k
    return out.orbits[i]  # type: ignore[no-any-return]


@part
def add(fixed: Constants, i: int, times: Floats, p: int, q: int, number: int, out: Closed) -> int:
    """Store the orbit of p impacts with these times, or the shorter one that they repeat.

    Returns its index, which is the former number of orbits if it is new, and the capacity if there
    is no room for it.
    """
    d = primitive(times, p, q)
    begin_shortest(times, d, q * d // p, np.empty(p))
    k = _place(i, times, d, q * d // p, out)
    if k == out.orbits[i] and k < out.impacts.shape[1]:
        _store(fixed, i, times, d, q * d // p, number, out)
    return k


@part
def _store(
    fixed: Constants, i: int, times: Floats, p: int, q: int, number: int, out: Closed
) -> None:
    """Store a new orbit, with the properties that follow from its times."""
    k = out.orbits[i]
    out.orbits[i] += 1
    blank(i, k, out)
    out.impacts[i, k], out.periods[i, k], out.born[i, k] = p, q, number
    out.times[i, k, :p] = times[:p]
    tangent = linearize(fixed, times, p, q, np.empty(p), np.empty((p, p)))
    out.trace[i, k], out.determinant[i, k] = tangent.trace, tangent.determinant
    out.admissible[i, k] = admits(fixed, times, p, q)
    for j in range(p):
        arc = flight(fixed, times, p, q, j)
        out.speed[i, k, j] = bases.speed(fixed, arc.x, arc.u)
        out.arrival[i, k, j] = arc.v


@jit
def blank(i: int, k: int, out: Closed) -> None:
    """Write that there is no orbit at a place."""
    out.impacts[i, k] = out.periods[i, k] = out.born[i, k] = 0
    out.admissible[i, k] = NO_ORBIT
    out.trace[i, k] = out.determinant[i, k] = np.nan
    for j in range(out.times.shape[2]):
        out.times[i, k, j] = out.speed[i, k, j] = out.arrival[i, k, j] = np.nan


# --- Near returns of trajectories -----------------------------------------------------------------
# A trajectory that settles on an attractor, or passes an unstable orbit, returns nearly to the same
# phases after p landings and q periods.  Newton's method starts from those p landings.  So every
# attractor is found to which one of the launches leads, however small the region of the landing
# times from which Newton's method leads to it.
#
# Launches cover phase and speed evenly, more densely at low speeds.  Their number grows with the
# square of the number of falls of the waveform, on which the attractors are, and to twice the
# number of the launch that led to the last new attractor, unless `LAUNCH_PATIENCE` limits it.


# Number of launches, relative to the least of a sine, beyond which it does not grow
LAUNCH_PATIENCE = 32
LANDINGS = 400  # of a trajectory, at most
MOST_RESTS = 4  # at which a trajectory ends
NEAR = 0.02  # periods; Newton's method starts after returns as near as this
CLOSER = 1.0 / 16.0  # distance of the next return from which it starts, relative to the last one
CAPTURED = 1e-4  # periods; a trajectory that returns so nearly to an attracting orbit stays there
GOLDEN = 1.324717957244746  # root of g^3 = g + 1, by which points of a plane are spread


@jit
def _return(
    landed: Floats, k: int, impacts: int, periods: int, near: float
) -> tuple[int, int, float]:
    """Numbers of impacts and periods after which two landings return so nearly, and the distance.

    `landed` are k landing times; without a return there are 0 impacts.
    """
    for p in range(1, min(impacts, k - 2) + 1):
        one, other = landed[k - 1] - landed[k - 1 - p], landed[k - 2] - landed[k - 2 - p]
        q = np.rint(one)
        off = max(abs(one - q), abs(other - q))
        if off <= near and 1 <= q <= periods:
            return p, int(q), off
    return 0, 0, math.inf


@part
def _simulate(fixed: Constants, i: int, number: int, out: Closed) -> int:
    """Simulate a trajectory, and find the orbits to which it nearly returns.

    Returns the number of new ones that attract, -1 where orbits exceed the capacity.
    """
    impacts, periods = out.seeds.shape[1], out.seeds.shape[2]
    landed, times = np.empty(LANDINGS), np.empty(impacts)
    off, matrix = np.empty(impacts), np.empty((impacts, impacts))
    x, u = reduced(number / GOLDEN), periods * ((number / (GOLDEN * GOLDEN)) % 1.0) ** 2
    n, k, rests, near, attracting = 0.0, 0, 0, NEAR, 0
    for _ in range(LANDINGS):
        hit = impact(fixed, n, x, u)
        n, x, u = hit.n_off, hit.x_off, hit.u
        if not hit.leaves:
            rests, k = rests + 1, 0
        if rests == MOST_RESTS or not abs(n) < math.inf:
            break
        if not hit.leaves:
            continue
        landed[k] = hit.n + hit.x
        k += 1
        p, q, distance = _return(landed, k, impacts, periods, near)
        if p == 0:
            continue
        near = CLOSER * distance
        times[:p] = landed[k - 1 - p : k - 1]
        if ascends(times, p, q) and close(fixed, times, p, q, off, matrix):
            orbits = out.orbits[i]
            at = add(fixed, i, times, p, q, 0, out)
            if at == out.impacts.shape[1]:
                return -1
            bound = 1.0 + out.determinant[i, at]
            attracts = out.admissible[i, at] == ADMISSIBLE and abs(out.trace[i, at]) < bound
            attracting += attracts and at == orbits
            if attracts and distance < CAPTURED:
                break
    return attracting


@part
def search_from_launches(fixed: Constants, i: int, launches: int, out: Closed) -> bool:
    """Find the orbits near which trajectories return; False where they exceed the capacity.

    `launches` is their least number under a sine.
    """
    most = LAUNCH_PATIENCE * launches
    number, until = 0, min(launches * falls_of(fixed.base.waveform) ** 2, most)
    while number < until:
        number += 1
        found = _simulate(fixed, i, number, out)
        if found < 0:
            return False
        if found > 0:
            until = max(until, min(2 * number, most))
    return True


# --- Search ---------------------------------------------------------------------------------------
# Seeds cover the landing times of p impacts in q periods evenly: quasi-random points of the unit
# cube of p dimensions (the sequence of the generalised golden ratio) give the phase of the first
# landing and the times of the others.  The regions from which Newton's method leads to an orbit
# shrink with the falls of the velocity of the base, by whose number, squared for two impacts or
# more, the least number of seeds is multiplied.  The search ends at twice the number of the seed
# that led to the last new orbit and, for the map, not before the orbits balance, unless `PATIENCE`
# limits it.
#
# Orbits of one impact are found by the changes of sign of their equation, and trajectories lead to
# more orbits.
#
# For e < 1 the p equations of the map have no solution at the boundary of the region u > 0 of all
# flights, and none without kicks: their topological degree is zero.  Hence as many points have a
# real multiplier above 1 as have none, counting every point of an orbit and including repeated
# shorter orbits.  If these numbers differ, orbits were missed; if a pair was, they do not.


WORTH = 2.5  # kicks; a seed with a larger residual is not tried
LEAST = 8  # impacts beyond which the number of seeds does not grow
PATIENCE = 32  # number of seeds, relative to the least, beyond which it does not grow
HALVINGS = 52  # of an interval in which an orbit of one impact is searched for
LAUNCHES = 8  # of trajectories for each seed of orbits with one impact, at least


class Wanted(NamedTuple):
    """Range of the search."""

    impacts: int  # at most, of an orbit
    periods: int  # at most
    # under a sine at least, of each (p, q), times 4 for each impact beyond the first, up to `LEAST`
    seeds: int
    balances: bool  # whether the orbits of each (p, q) balance if none is missing


def empty_closed(problems: int, capacity: int, wanted: Wanted) -> Closed:
    """Allocate memory for so many orbits of each problem, all of which `find_closed` writes."""
    shape, pairs = (problems, capacity), (problems, wanted.impacts, wanted.periods)
    landings = (*shape, wanted.impacts)
    return Closed(
        orbits=unwritten(problems, np.int64),
        impacts=unwritten(shape, np.int64),
        periods=unwritten(shape, np.int64),
        admissible=unwritten(shape, np.int8),
        trace=unwritten(shape),
        determinant=unwritten(shape),
        times=unwritten(landings),
        speed=unwritten(landings),
        arrival=unwritten(landings),
        born=unwritten(shape, np.int64),
        seeds=unwritten(pairs, np.int64),
        late=unwritten(pairs, np.int64),
        saddles=unwritten(pairs, np.int64),
        others=unwritten(pairs, np.int64),
    )


@jit
def _seed(number: int, golden: float, p: int, q: int, times: Floats) -> None:
    """Write landing times of a seed, ascending."""
    step = 1.0 / golden
    phase = (0.5 + number * step) % 1.0
    times[0] = phase
    for i in range(1, p):
        step /= golden
        at = phase + q * ((0.5 + number * step) % 1.0)
        j = i
        while j > 1 and times[j - 1] > at:
            times[j] = times[j - 1]
            j -= 1
        times[j] = at


@jit
def _golden(p: int) -> float:
    """Root of g^(p + 1) = g + 1, by which points of p dimensions are spread."""
    g = 1.5
    for _ in range(60):
        g = (1.0 + g) ** (1.0 / (p + 1))
    return g


@part
def _balance(out: Closed, i: int, p: int, q: int) -> None:
    """Count the points of all solutions of (p, q), shorter orbits included."""
    saddles = others = 0
    for k in range(out.orbits[i]):
        d = p // out.impacts[i, k]
        if d * out.impacts[i, k] == p and d * out.periods[i, k] == q:
            tangent = power_trace(Tangent(out.trace[i, k], out.determinant[i, k]), d)
            if 1.0 - tangent.trace + tangent.determinant < 0.0:
                saddles += out.impacts[i, k]
            else:
                others += out.impacts[i, k]
    out.saddles[i, p - 1, q - 1], out.others[i, p - 1, q - 1] = saddles, others


@part
def _search(
    fixed: Constants, i: int, p: int, q: int, wanted: Wanted, worth: float, out: Closed
) -> bool:
    """Find the orbits of (p, q), shorter ones among them; False where they exceed the capacity.

    Goes on after the seeds that were tried before if the orbits do not balance.
    """
    times, off, matrix = np.empty(p), np.empty(p), np.empty((p, p))
    golden = _golden(p)
    plain = wanted.seeds * 4 ** (min(p, LEAST) - 1)
    most = PATIENCE * plain
    begun, before = out.seeds[i, p - 1, q - 1], out.orbits[i]
    number, until = begun, max(begun, min(plain * falls_of(fixed.base.waveform) ** min(p, 2), most))
    while True:
        if number == until:
            _balance(out, i, p, q)
            even = out.saddles[i, p - 1, q - 1] == out.others[i, p - 1, q - 1]
            if even or until >= most or not wanted.balances:
                break
            until = min(2 * until, most)
        number += 1
        _seed(number, golden, p, q, times)
        linearize(fixed, times, p, q, off, matrix)
        worst = 0.0
        for j in range(p):
            worst = max(worst, abs(off[j]))
        if worst <= worth and close(fixed, times, p, q, off, matrix):
            orbits = out.orbits[i]
            k = add(fixed, i, times, p, q, number, out)
            if k == out.impacts.shape[1]:
                return False
            if k == orbits:
                until = max(until, min(2 * number, most))
    out.seeds[i, p - 1, q - 1] = number
    if number > begun:
        out.late[i, p - 1, q - 1] = 0
        for k in range(before, out.orbits[i]):
            out.late[i, p - 1, q - 1] += 2 * out.born[i, k] > number
    return True


@part
def _search_single(fixed: Constants, i: int, q: int, out: Closed) -> bool:
    """Find the orbits of one impact in q periods; False where they exceed the capacity.

    Their equation is monotone between extremes of the velocity of the base: it has a root there if
    its signs at the ends differ.  Under the law `reflect` it may have two where they do not.
    """
    times, off, matrix = np.empty(1), np.empty(1), np.empty((1, 1))
    fits, turns = True, turning(fixed.base.waveform)
    for k in range(len(turns)):
        low, high = (turns[k - 1] if k else turns[len(turns) - 1] - 1.0), turns[k]
        times[0] = low
        linearize(fixed, times, 1, q, off, matrix)
        sign = math.copysign(1.0, off[0])
        times[0] = high
        linearize(fixed, times, 1, q, off, matrix)
        if sign * off[0] > 0.0:
            continue
        for _ in range(HALVINGS):
            times[0] = 0.5 * (low + high)
            linearize(fixed, times, 1, q, off, matrix)
            low, high = (times[0], high) if sign * off[0] > 0.0 else (low, times[0])
        if close(fixed, times, 1, q, off, matrix):
            fits = fits and add(fixed, i, times, 1, q, 0, out) < out.impacts.shape[1]
    return fits


@part
def _search_all(fixed: Constants, i: int, wanted: Wanted, worth: float, out: Closed) -> bool:
    """Search for the orbits of all (p, q) from seeds; False where they exceed the capacity."""
    fits = True
    for p in range(1, wanted.impacts + 1):
        for q in range(1, wanted.periods + 1):
            fits = fits and _search(fixed, i, p, q, wanted, worth, out)
    return fits


@kernel
def find_closed(
    first: int, last: int, base: Base, problem: Dimensionless, wanted: Wanted, out: Closed
) -> None:
    """Find the closed orbits of problems first ... last - 1.

    A problem whose orbits exceed the capacity is not written completely.
    """
    for i in range(first, last):
        out.orbits[i] = 0
        fixed = bases.constants(base, problem, i)
        shape = fixed.base.waveform
        worth = WORTH * problem.kick[i] * max(peak_of(shape), depth_of(shape))
        out.seeds[i] = 0
        fits = _search_all(fixed, i, wanted, worth, out)
        for q in range(1, wanted.periods + 1):
            fits = fits and _search_single(fixed, i, q, out)
        fits = fits and search_from_launches(fixed, i, LAUNCHES * wanted.seeds, out)
        if wanted.balances:  # what trajectories found may have no partner yet
            fits = fits and _search_all(fixed, i, wanted, worth, out)
        for p in range(1, wanted.impacts + 1):
            for q in range(1, wanted.periods + 1):
                _balance(out, i, p, q)
        for k in range(out.orbits[i], out.impacts.shape[1]):
            blank(i, k, out)
        if not fits:
            out.orbits[i] = -1
