"""The list of closed orbits that a search fills, for a batch of problems."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Flags, Floats, Integers, jit, part
from vibrosweep.kernels.bases import Constants, speed
from vibrosweep.kernels.closed import admits, begin_shortest, flight, linearize, primitive, same

NO_ORBIT = -2  # beside the codes of `vibrosweep.kernels.closed.admits`


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
    """Index of an orbit among those that are kept, or their number if it is not among them."""
    for k in range(out.orbits[i]):
        alike = out.impacts[i, k] == p and out.periods[i, k] == q
        if alike and same(out.times[i, k], times, p, q):
            return k
    return out.orbits[i]  # type: ignore[no-any-return]


@part
def add(fixed: Constants, i: int, times: Floats, p: int, q: int, number: int, out: Closed) -> int:
    """Keep the orbit of p impacts that times close, or a shorter one of which they consist.

    Returns its index, which is the former number of orbits if it is new, and the capacity if there
    is no room for it.
    """
    d = primitive(times, p, q)
    begin_shortest(times, d, q * d // p, np.empty(p))
    k = _place(i, times, d, q * d // p, out)
    if k == out.orbits[i] and k < out.impacts.shape[1]:
        _keep(fixed, i, times, d, q * d // p, number, out)
    return k


@part
def _keep(
    fixed: Constants, i: int, times: Floats, p: int, q: int, number: int, out: Closed
) -> None:
    """Keep a new orbit, with the properties that follow from its times."""
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
        out.speed[i, k, j] = speed(fixed, arc.x, arc.u)
        out.arrival[i, k, j] = arc.v


@jit
def blank(i: int, k: int, out: Closed) -> None:
    """Write that there is no orbit at a place."""
    out.impacts[i, k] = out.periods[i, k] = out.born[i, k] = 0
    out.admissible[i, k] = NO_ORBIT
    out.trace[i, k] = out.determinant[i, k] = np.nan
    for j in range(out.times.shape[2]):
        out.times[i, k, j] = out.speed[i, k, j] = out.arrival[i, k, j] = np.nan
