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

from vibrosweep.kernels._jit import Floats, jit, part
from vibrosweep.kernels.bases import Constants, Flight, fly, jacobian, lift_off, rebound
from vibrosweep.kernels.bases.chords import chord

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
    u, v = chord(fixed, x, s)
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
        xx, xu, ux, uu, _ = jacobian(fixed, arc)
        off[i] += arc.u
        off[j] -= rebound(fixed, arc.landing, arc.v)
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
        w = rebound(fixed, arc.landing, arc.v)
        if not lift_off(fixed, 0.0, arc.landing, w).leaves:
            return RESTS
    for i in range(p):
        arc = flight(fixed, times, p, q, i)
        time, _ = fly(fixed, arc.x, arc.u)
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
