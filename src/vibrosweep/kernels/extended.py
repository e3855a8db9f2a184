"""Equations of an orbit with two more conditions, for Newton's method.

A point z holds the p landing times of an orbit, the restitution, and the drive: the kick, or the
kick divided by 1 + e if the velocity of the base is given.  Two conditions in addition to the p
equations of the orbit determine the point.  For a bifurcation at a fixed parameter, Newton's method
solves for orbit and multiplier together, which is regular at a fold.

Derivatives by the parameters, and those of conditions, are central differences.  Their error of
1e-10 costs no step of Newton's method, and its solution is as exact as the equations.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, jit, kernel, part
from vibrosweep.kernels.bases import Base, Constants, constants, lift_off, rebound
from vibrosweep.kernels.bases.chords import clearing
from vibrosweep.kernels.closed import ascends, flight, linearize, solve
from vibrosweep.model.parameters import Dimensionless

# Conditions: a multiplier is 1, or -1; a flight touches the base; an impact just rests; a landing
# falls on a corner of the velocity of the base, or has the speed at which the law of restitution
# has a kink.  FIX_E and FIX_DRIVE hold a parameter, ALONG the distance from a point in a direction.
SADDLE_NODE, DOUBLING, GRAZE, REST = range(4)
CORNER, YIELD = 5, 6
FIX_E, FIX_DRIVE, ALONG = -3, -2, -1
DIFFERENCE = 1e-6
STEPS = 8  # of Newton's method, from points so near that 4 suffice
SMALL_STEP = 1e-9  # after a step this small one more follows
FARTHEST = 0.2  # largest correction of a point


class Range(NamedTuple):
    """The line that is followed, its range, and its longest step."""

    p: int
    q: int
    condition: int  # of all points of the line: FIX_E, FIX_DRIVE, or a bifurcation
    relative: bool  # whether the drive is that of the velocity of the base
    # low_e, high_e, low_drive, high_drive: of the parameters
    low_e: float
    high_e: float
    low_drive: float
    high_drive: float
    longest: float  # step
    # corner, kink: phase of one corner of the waveform, the other being its negative, and speed of
    # the kink of the law; infinite if there is none
    corner: float
    kink: float


class Work(NamedTuple):
    """Memory for the equations."""

    matrix: Floats
    off: Floats
    inner: Floats
    plus: Floats
    minus: Floats


@jit
def work_for(p: int) -> Work:
    """Allocate memory for an orbit of p impacts."""
    n = p + 2
    return Work(np.empty((n, n)), np.empty(n), np.empty((p, p)), np.empty(p), np.empty(p))


# loops over elements: numba takes half a second to compile an expression of whole arrays


@jit
def put_between(out: Floats, z: Floats, other: Floats, share: float) -> None:
    """Write the point between two others, or beyond them."""
    for c in range(out.size):
        out[c] = z[c] + share * (other[c] - z[c])


@jit
def put_ahead(out: Floats, z: Floats, step: float, direction: Floats) -> None:
    """Write the point that is a step away from another in a direction."""
    for c in range(out.size):
        out[c] = z[c] + step * direction[c]


@jit
def normalize(direction: Floats) -> float:
    """Make the length of a direction 1; return its length before."""
    length = 0.0
    for value in direction:
        length += value * value
    length = math.sqrt(length)
    for c in range(direction.size):
        direction[c] /= length
    return length


@part
def place(base: Base, problem: Dimensionless, z: Floats, p: int, relative: bool) -> Constants:
    """Constants at the parameters of a point, as realization 0 of the problem."""
    # of the problem's other numbers, an orbit without rests needs only the threshold of rest
    problem.restitution[0] = z[p]
    problem.kick[0] = z[p + 1] * (1.0 + z[p]) if relative else z[p + 1]
    return constants(base, problem, 0)


@part
def value_of(
    base: Base, problem: Dimensionless, span: Range, z: Floats, condition: int, work: Work
) -> float:
    """Value of a condition, which changes sign at the bifurcation."""
    p, q = span.p, span.q
    fixed = place(base, problem, z, p, span.relative)
    if condition <= DOUBLING:
        tangent = linearize(fixed, z, p, q, work.plus, work.inner)
        sign = -1.0 if condition == SADDLE_NODE else 1.0
        return 1.0 + sign * tangent.trace + tangent.determinant
    least, product = math.inf, 1.0
    for i in range(p):
        arc = flight(fixed, z, p, q, i)
        if condition == CORNER:
            product *= abs(arc.x) - span.corner
        elif condition == YIELD:
            product *= arc.v - span.kink
        elif condition == GRAZE:
            least = min(least, clearing(fixed, arc))
        else:
            w = rebound(fixed, arc.landing, arc.v)
            if w > fixed.r or not lift_off(fixed, 0.0, arc.landing, w).leaves:
                least = min(least, w - fixed.r)
    return product if condition >= CORNER else least


@part
def _row(
    base: Base, problem: Dimensionless, span: Range, z: Floats, condition: int, work: Work, row: int
) -> None:
    """Write a bifurcation as an equation, with its derivatives."""
    n, above = span.p + 2, 0.0
    for k in range(2 * n + 1):
        c, kept = k // 2, z[min(k // 2, n - 1)]
        if k < 2 * n:
            z[c] = kept + (DIFFERENCE if k % 2 == 0 else -DIFFERENCE)
        value = value_of(base, problem, span, z, condition, work)
        if k == 2 * n:
            work.off[row] = value
            continue
        z[c] = kept
        if k % 2 == 0:
            above = value
        else:
            work.matrix[row, c] = (above - value) / (2.0 * DIFFERENCE)


@part
def _equations(
    base: Base,
    problem: Dimensionless,
    span: Range,
    z: Floats,
    condition: int,
    held: Floats,
    direction: Floats,
    work: Work,
) -> None:
    """Write the equations of the orbit, and those of the line and of one more condition."""
    p, q, n = span.p, span.q, span.p + 2
    for row, fixes in ((p, span.condition), (p + 1, condition)):
        if fixes >= SADDLE_NODE:
            _row(base, problem, span, z, fixes, work, row)
            continue
        work.off[row] = 0.0
        for c in range(n):
            at = direction[c] if fixes == ALONG else 0.0
            if (fixes == FIX_E and c == p) or (fixes == FIX_DRIVE and c == p + 1):
                at = 1.0
            work.matrix[row, c] = at
            work.off[row] += at * (z[c] - held[c])
    for k in range(5):
        c, kept = p + k // 2, z[min(p + k // 2, n - 1)]
        if k < 4:
            z[c] = kept + (DIFFERENCE if k % 2 == 0 else -DIFFERENCE)
        fixed = place(base, problem, z, p, span.relative)
        linearize(fixed, z, p, q, work.minus if k % 2 else work.plus, work.inner)
        if k < 4:
            z[c] = kept
        for i in range(p):
            if k == 4:
                work.off[i] = work.plus[i]
                for j in range(p):
                    work.matrix[i, j] = work.inner[i, j]
            elif k % 2:
                work.matrix[i, c] = (work.plus[i] - work.minus[i]) / (2.0 * DIFFERENCE)


@part
def correct(
    base: Base,
    problem: Dimensionless,
    span: Range,
    z: Floats,
    condition: int,
    held: Floats,
    direction: Floats,
    work: Work,
) -> bool:
    """Correct a point to meet the line's condition and one more; return whether that converges.

    `held` and `direction` are the point and the direction for FIX_E, FIX_DRIVE and ALONG.
    """
    n, small = span.p + 2, 0
    for _ in range(STEPS):
        _equations(base, problem, span, z, condition, held, direction, work)
        if not solve(work.matrix, work.off, n):
            return False
        longest = 0.0
        for c in range(n):
            longest = max(longest, abs(work.off[c]))
            z[c] -= work.off[c]
        if not (longest < FARTHEST and ascends(z, span.p, span.q)):
            return False
        small = small + 1 if longest < SMALL_STEP else 0
        if small == 2:
            return True
    return False


@part
def turn_along(
    base: Base, problem: Dimensionless, span: Range, z: Floats, direction: Floats, work: Work
) -> bool:
    """Set the direction to the tangent of the line at a point, keeping its orientation."""
    n = span.p + 2
    _equations(base, problem, span, z, ALONG, z, direction, work)
    for c in range(n):
        work.off[c] = 1.0 if c == n - 1 else 0.0
    if not solve(work.matrix, work.off, n):
        return False
    put_ahead(direction, work.off, 0.0, work.off)
    return normalize(direction) < math.inf


@kernel
def correct_point(
    base: Base, problem: Dimensionless, span: Range, z: Floats, condition: int
) -> bool:
    """Correct a point with its parameters fixed; return whether that converges."""
    return correct(base, problem, span, z, condition, z.copy(), z, work_for(span.p))


@kernel
def directions(
    base: Base, problem: Dimensionless, span: Range, z: Floats, direction: Floats
) -> bool:
    """Turn a direction, any that is not normal to the line, into the tangent at a point."""
    return turn_along(base, problem, span, z, direction, work_for(span.p))


@kernel
def splitting(base: Base, problem: Dimensionless, span: Range, z: Floats, split: Floats) -> bool:
    """Find the direction, shape (2 p + 2,), in which the doubled orbit branches off."""
    p, n = span.p, 2 * span.p
    fixed = place(base, problem, z, p, span.relative)
    times, off, matrix = np.empty(n), np.empty(n), np.empty((n, n))
    for i in range(n):
        times[i] = z[i] if i < p else z[i - p] + span.q
        off[i] = (1.0 if i < p else -1.0) / (1.0 + i % p)
        split[i] = off[i]
    split[n] = split[n + 1] = 0.0
    for _ in range(2):  # inverse iteration
        linearize(fixed, times, n, 2 * span.q, off, matrix)
        for i in range(n):
            off[i] = split[i]
        if not solve(matrix, off, n):
            return False
        normalize(off)
        for i in range(n):
            split[i] = off[i]
    return True
