"""Search for all closed orbits of up to p impacts in up to q periods, for a batch of problems.

Seeds cover the landing times of p impacts in q periods evenly: quasi-random points of the unit cube
of p dimensions (the sequence of the generalised golden ratio) give the phase of the first landing
and the times of the others.  The search ends at twice the number of the seed that led to the last
new orbit and, for the map, not before the orbits balance, unless `PATIENCE` ends it.

For e < 1 the p equations of the map have no solution at the boundary of the region u > 0 of all
flights, and none without kicks: their topological degree is zero.  Hence as many points have a real
multiplier above 1 as have none, counting every point of an orbit and including repeated shorter
orbits.  If these numbers differ, orbits were missed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Flags, Floats, Integers, jit, kernel, part
from vibrosweep.kernels.bases import Base, Constants, constants, speed
from vibrosweep.kernels.closed import (
    Tangent,
    admits,
    begin_shortest,
    close,
    flight,
    linearize,
    power_trace,
    primitive,
    same,
)
from vibrosweep.kernels.unwritten import unwritten
from vibrosweep.model.parameters import Dimensionless

WORTH = 2.5  # kicks; a seed with a larger residual is not tried
LEAST = 8  # impacts beyond which the number of seeds does not grow
NO_ORBIT = -2  # beside the codes of `vibrosweep.kernels.closed.admits`
PATIENCE = 32  # number of seeds, relative to the least, beyond which it does not grow


class Wanted(NamedTuple):
    """Range of the search."""

    impacts: int  # at most, of an orbit
    periods: int  # at most
    seeds: int  # at least, of each (p, q), times 4 for each impact beyond the first, up to `LEAST`
    balances: bool  # whether the orbits of each (p, q) balance once all are found


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
    born: Integers  # number of the seed that led to it
    # seeds, late: (problem, p, q): seeds, and new orbits found by their last half
    seeds: Integers
    late: Integers
    # saddles, others: points with a real multiplier above 1, and without; see above
    saddles: Integers
    others: Integers


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


@jit
def _known(i: int, times: Floats, p: int, q: int, out: Closed) -> bool:
    """Return whether an orbit is among those that are kept."""
    for k in range(out.orbits[i]):
        alike = out.impacts[i, k] == p and out.periods[i, k] == q
        if alike and same(out.times[i, k], times, p, q):
            return True
    return False


@part
def _search(
    fixed: Constants, i: int, p: int, q: int, wanted: Wanted, kick: float, out: Closed
) -> bool:
    """Find the orbits of (p, q), shorter ones among them; False where they exceed the capacity."""
    times, scratch, off, matrix = np.empty(p), np.empty(p), np.empty(p), np.empty((p, p))
    golden = _golden(p)
    least = wanted.seeds * 4 ** (min(p, LEAST) - 1)
    number, until, before = 0, least, out.orbits[i]
    while number < until:
        number += 1
        _seed(number, golden, p, q, times)
        linearize(fixed, times, p, q, off, matrix)
        worst = 0.0
        for j in range(p):
            worst = max(worst, abs(off[j]))
        if worst <= WORTH * kick and close(fixed, times, p, q, off, matrix):
            d = primitive(times, p, q)
            begin_shortest(times, d, q * d // p, scratch)
            if not _known(i, times, d, q * d // p, out):
                if out.orbits[i] == out.impacts.shape[1]:
                    return False
                _keep(fixed, i, times, d, q * d // p, number, out)
                until = max(until, min(2 * number, PATIENCE * least))
        if number == until and wanted.balances and until < PATIENCE * least:
            _balance(out, i, p, q)
            if out.saddles[i, p - 1, q - 1] != out.others[i, p - 1, q - 1]:
                until *= 2
    out.seeds[i, p - 1, q - 1] = number
    out.late[i, p - 1, q - 1] = 0
    for k in range(before, out.orbits[i]):
        out.late[i, p - 1, q - 1] += 2 * out.born[i, k] > number
    return True


@part
def _keep(
    fixed: Constants, i: int, times: Floats, p: int, q: int, number: int, out: Closed
) -> None:
    """Keep a new orbit, with the properties that follow from its times."""
    k = out.orbits[i]
    out.orbits[i] += 1
    _blank(i, k, out)
    out.impacts[i, k], out.periods[i, k], out.born[i, k] = p, q, number
    out.times[i, k, :p] = times[:p]
    tangent = linearize(fixed, times, p, q, np.empty(p), np.empty((p, p)))
    out.trace[i, k], out.determinant[i, k] = tangent.trace, tangent.determinant
    out.admissible[i, k] = admits(fixed, times, p, q)
    for j in range(p):
        arc = flight(fixed, times, p, q, j)
        out.speed[i, k, j] = speed(fixed, arc.x, arc.u)
        out.arrival[i, k, j] = arc.v


@jit
def _blank(i: int, k: int, out: Closed) -> None:
    """Write that there is no orbit at a place."""
    out.impacts[i, k] = out.periods[i, k] = out.born[i, k] = 0
    out.admissible[i, k] = NO_ORBIT
    out.trace[i, k] = out.determinant[i, k] = np.nan
    for j in range(out.times.shape[2]):
        out.times[i, k, j] = out.speed[i, k, j] = out.arrival[i, k, j] = np.nan


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
        roomy = True
        for p in range(1, wanted.impacts + 1):
            for q in range(1, wanted.periods + 1):
                roomy = roomy and _search(fixed, i, p, q, wanted, problem.kick[i], out)
        for p in range(1, wanted.impacts + 1):
            for q in range(1, wanted.periods + 1):
                _balance(out, i, p, q)
        for k in range(out.orbits[i], out.impacts.shape[1]):
            _blank(i, k, out)
        if not roomy:
            out.orbits[i] = -1
