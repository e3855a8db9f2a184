"""Search for closed orbits of up to p impacts in up to q periods, for a batch of problems.

Seeds cover the landing times of p impacts in q periods evenly: quasi-random points of the unit cube
of p dimensions (the sequence of the generalised golden ratio) give the phase of the first landing
and the times of the others.  The regions from which Newton's method leads to an orbit shrink with
the falls of the velocity of the base, by whose number, squared for two impacts or more, the least
number of seeds is multiplied.  The search ends at twice the number of the seed that led to the last
new orbit and, for the map, not before the orbits balance, unless `PATIENCE` ends it.

Orbits of one impact are found by the changes of sign of their equation, and trajectories lead to
more orbits (`vibrosweep.kernels.close_returns`).

For e < 1 the p equations of the map have no solution at the boundary of the region u > 0 of all
flights, and none without kicks: their topological degree is zero.  Hence as many points have a real
multiplier above 1 as have none, counting every point of an orbit and including repeated shorter
orbits.  If these numbers differ, orbits were missed; if a pair was, they do not.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, jit, kernel, part
from vibrosweep.kernels.bases import Base, Constants, constants
from vibrosweep.kernels.close_returns import follow_launches
from vibrosweep.kernels.closed import Tangent, close, linearize, power_trace
from vibrosweep.kernels.orbit_list import Closed, add, blank
from vibrosweep.kernels.unwritten import unwritten
from vibrosweep.kernels.waveforms import depth_of, falls_of, peak_of, turning
from vibrosweep.model.parameters import Dimensionless

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
    roomy, turns = True, turning(fixed.base.waveform)
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
            roomy = roomy and add(fixed, i, times, 1, q, 0, out) < out.impacts.shape[1]
    return roomy


@part
def _search_all(fixed: Constants, i: int, wanted: Wanted, worth: float, out: Closed) -> bool:
    """Search for the orbits of all (p, q) from seeds; False where they exceed the capacity."""
    roomy = True
    for p in range(1, wanted.impacts + 1):
        for q in range(1, wanted.periods + 1):
            roomy = roomy and _search(fixed, i, p, q, wanted, worth, out)
    return roomy


@kernel
def find_closed(
    first: int, last: int, base: Base, problem: Dimensionless, wanted: Wanted, out: Closed
) -> None:
    """Find the closed orbits of problems first ... last - 1.

    A problem whose orbits exceed the capacity is not written completely.
    """
    for i in range(first, last):
        out.orbits[i] = 0
        fixed = constants(base, problem, i)
        shape = fixed.base.waveform
        worth = WORTH * problem.kick[i] * max(peak_of(shape), depth_of(shape))
        out.seeds[i] = 0
        roomy = _search_all(fixed, i, wanted, worth, out)
        for q in range(1, wanted.periods + 1):
            roomy = roomy and _search_single(fixed, i, q, out)
        roomy = roomy and follow_launches(fixed, i, LAUNCHES * wanted.seeds, out)
        if wanted.balances:  # what trajectories found may have no partner yet
            roomy = roomy and _search_all(fixed, i, wanted, worth, out)
        for p in range(1, wanted.impacts + 1):
            for q in range(1, wanted.periods + 1):
                _balance(out, i, p, q)
        for k in range(out.orbits[i], out.impacts.shape[1]):
            blank(i, k, out)
        if not roomy:
            out.orbits[i] = -1
