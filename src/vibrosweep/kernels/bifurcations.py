"""Closed orbits and their bifurcations as equations, for Newton's method along lines of orbits.

A point z holds the p landing times of an orbit, the restitution, and the drive: the kick, or the
kick divided by 1 + e if the velocity of the base is given.  Two conditions in addition to the p
equations of the orbit determine the point.

All functions are smooth where the speed of a landing passes 0, at which the Jacobian of an impact
over a moving base is infinite.  Derivatives by the parameters, and those of conditions, are central
differences.  Their error of 1e-10 costs no step of Newton's method, and its solution is as exact as
the equations.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibrosweep.kernels import bases
from vibrosweep.kernels._jit import Floats, Integers, kernel, part
from vibrosweep.kernels.bases import Base, Constants
from vibrosweep.kernels.closed import ADMISSIBLE, admits, ascends, flight, solve
from vibrosweep.model.parameters import Dimensionless

__all__ = ["BORN", "CORNER", "DOUBLING", "GRAZE", "LANDING", "REST", "SADDLE_NODE", "YIELD"]

# Conditions, each of which is 0 at its event: a multiplier is 1, or -1; a flight touches the base;
# an impact just rests; the orbit is one of half its length (left to the caller); a landing falls on
# a corner of the velocity of the base, or has the speed at which the law of restitution has a kink,
# or the speed 0; and one that only changes sign: whether a particle can follow the orbit.
SADDLE_NODE, DOUBLING, GRAZE, REST, BORN, CORNER, YIELD, LANDING, FOLLOWED = range(9)
CONDITIONS = 9
DIFFERENCE = 1e-6
SMALL_STEP = 1e-11  # of Newton's method, after which rounding is all that is left
FARTHEST = 0.2  # largest correction of a point


class OrbitType(NamedTuple):
    """Impacts and periods of orbits, and what their conditions depend on."""

    p: int
    q: int
    relative: bool  # whether the drive is that of the velocity of the base
    # phase of one corner of the waveform, the other being its negative; infinite if there is none
    corner: float
    kinks: Floats  # speeds of the kinks of the law


class Scaled(NamedTuple):
    """Trace and determinant of the Jacobian of a whole orbit, times the product of all scales."""

    scale: float
    trace: float
    determinant: float


class Added(NamedTuple):
    """Conditions in addition to the equations of an orbit, each a bifurcation or a linear one.

    A linear condition is that the product of a row with the distance from a point is 0.
    """

    kinds: Integers  # -1 for a linear condition
    rows: Floats  # (condition, p + 2)
    points: Floats  # (condition, p + 2)


class Residuals(NamedTuple):
    """Memory for the p equations and their derivatives."""

    off: Floats
    matrix: Floats


@part
def _place(base: Base, problem: Dimensionless, cycle: OrbitType, z: Floats) -> Constants:
    """Constants at the parameters of a point, as realization 0 of the problem."""
    # of the problem's other numbers, an orbit without rests needs only the threshold of rest
    p = cycle.p
    problem.restitution[0] = z[p]
    problem.kick[0] = z[p + 1] * (1.0 + z[p]) if cycle.relative else z[p + 1]
    return bases.constants(base, problem, 0)


@part
def _linearize(fixed: Constants, times: Floats, cycle: OrbitType, work: Residuals) -> Scaled:
    """Write the residuals of the speeds after the p impacts, and their derivatives by the times."""
    p, off, matrix = cycle.p, work.off, work.matrix
    off[:p] = 0.0
    matrix[:p, :p] = 0.0
    a, b, c, d, scale, determinant = 1.0, 0.0, 0.0, 1.0, 1.0, 1.0
    for i in range(p):
        j = i + 1 if i < p - 1 else 0
        arc = flight(fixed, times, p, cycle.q, i)
        by = bases.slopes(fixed, arc)
        off[i] += arc.u
        off[j] -= bases.rebound(fixed, arc.landing, arc.v)
        matrix[i, i] -= by.xx / by.xu
        matrix[i, j] += by.scale / by.xu
        matrix[j, i] += by.determinant / by.xu
        matrix[j, j] -= by.uu / by.xu
        scale, determinant = scale * by.scale, determinant * by.determinant
        a, c = by.xx * a + by.xu * c, by.ux * a + by.uu * c
        b, d = by.xx * b + by.xu * d, by.ux * b + by.uu * d
    return Scaled(scale, a + d, determinant)


@part
def _put_values(
    base: Base, problem: Dimensionless, cycle: OrbitType, z: Floats, work: Residuals, values: Floats
) -> None:
    """Write the values of all conditions but the last."""
    p, q = cycle.p, cycle.q
    fixed = _place(base, problem, cycle, z)
    whole = _linearize(fixed, z, cycle, work)
    values[SADDLE_NODE] = whole.scale - whole.trace + whole.determinant
    values[DOUBLING] = whole.scale + whole.trace + whole.determinant
    values[GRAZE] = values[REST] = math.inf
    values[BORN] = np.nan
    values[CORNER] = values[YIELD] = values[LANDING] = 1.0
    for i in range(p):
        arc = flight(fixed, z, p, q, i)
        w = bases.rebound(fixed, arc.landing, arc.v)
        values[GRAZE] = min(values[GRAZE], bases.clearing(fixed, arc))
        if w > fixed.r or not bases.lift_off(fixed, 0.0, arc.landing, w).leaves:
            values[REST] = min(values[REST], w - fixed.r)
        if cycle.corner < math.inf:
            values[CORNER] *= abs(arc.x) - cycle.corner
        for k in range(cycle.kinks.size):
            values[YIELD] *= arc.v - cycle.kinks[k]
        values[LANDING] *= arc.v


@part
def _put_condition(
    base: Base, problem: Dimensionless, cycle: OrbitType, z: Floats, kind: int, row: Floats
) -> float:
    """Write the derivatives of a condition, shape (p + 2,), and return its value."""
    p = cycle.p
    work, values = Residuals(np.empty(p), np.empty((p, p))), np.empty((2, CONDITIONS))
    for c in range(p + 2):
        kept = z[c]
        for side in range(2):
            z[c] = kept + (DIFFERENCE if side == 0 else -DIFFERENCE)
            _put_values(base, problem, cycle, z, work, values[side])
        z[c] = kept
        row[c] = (values[0, kind] - values[1, kind]) / (2.0 * DIFFERENCE)
    _put_values(base, problem, cycle, z, work, values[0])
    return values[0, kind]  # type: ignore[no-any-return]


@part
def _put_system(
    base: Base,
    problem: Dimensionless,
    cycle: OrbitType,
    z: Floats,
    added: Added,
    off: Floats,
    matrix: Floats,
) -> None:
    """Write residuals and derivatives of the equations of an orbit and of the conditions added."""
    p = cycle.p
    work = Residuals(np.empty(p), np.empty((p, p)))
    for c in range(p, p + 2):  # derivatives by both parameters
        kept = z[c]
        for side in range(2):
            z[c] = kept + (DIFFERENCE if side == 0 else -DIFFERENCE)
            _linearize(_place(base, problem, cycle, z), z, cycle, work)
            for i in range(p):
                before = matrix[i, c]
                matrix[i, c] = (
                    work.off[i] if side == 0 else (before - work.off[i]) / (2.0 * DIFFERENCE)
                )
        z[c] = kept
    _linearize(_place(base, problem, cycle, z), z, cycle, Residuals(off, matrix))
    for k in range(added.kinds.size):
        row = matrix[p + k]
        if added.kinds[k] >= 0:
            off[p + k] = _put_condition(base, problem, cycle, z, added.kinds[k], row)
            continue
        off[p + k] = 0.0
        for c in range(p + 2):
            row[c] = added.rows[k, c]
            off[p + k] += row[c] * (z[c] - added.points[k, c])


@kernel
def correct(
    base: Base,
    problem: Dimensionless,
    cycle: OrbitType,
    z: Floats,
    added: Added,
    steps: int,
    matrix: Floats,
) -> bool:
    """Correct a point by at most so many steps of Newton's method; return whether it converges.

    Writes the matrix of the last step; without steps, that at the point.
    """
    n = matrix.shape[0]
    off, left = np.empty(n), np.empty((n, n))
    if steps == 0:
        _put_system(base, problem, cycle, z, added, off, matrix)
    for _ in range(steps):
        _put_system(base, problem, cycle, z, added, off, matrix)
        left[:] = matrix
        if not solve(left, off, n):
            return False
        longest = 0.0
        for c in range(n):
            longest = max(longest, abs(off[c]))
            z[c] -= off[c]
        if not (longest < FARTHEST and ascends(z, cycle.p, cycle.q)):
            return False
        if longest < SMALL_STEP:
            return True
    return False


@kernel
def put_values(
    base: Base,
    problem: Dimensionless,
    cycle: OrbitType,
    z: Floats,
    direction: Floats,
    values: Floats,
    along: Floats,
) -> None:
    """Write the values of all conditions, and their derivatives in a direction."""
    p = cycle.p
    work, moved = Residuals(np.empty(p), np.empty((p, p))), np.empty(p + 2)
    found = np.empty((3, CONDITIONS))
    for k in range(3):
        for c in range(p + 2):
            moved[c] = z[c] + (1 - k) * DIFFERENCE * direction[c]
        _put_values(base, problem, cycle, moved, work, found[k])
    for k in range(CONDITIONS):
        values[k] = found[1, k]
        along[k] = (found[0, k] - found[2, k]) / (2.0 * DIFFERENCE)
    taken = admits(_place(base, problem, cycle, z), z, p, cycle.q)
    values[FOLLOWED], along[FOLLOWED] = 1.0 if taken == ADMISSIBLE else -1.0, 0.0


@kernel
def describe(
    base: Base, problem: Dimensionless, cycle: OrbitType, z: Floats, speeds: Floats
) -> tuple[float, float, int]:
    """Trace and determinant of the Jacobian of an orbit, and whether a particle can follow it.

    Writes the absolute speed at each lift-off, shape (p,).
    """
    p, q = cycle.p, cycle.q
    fixed = _place(base, problem, cycle, z)
    whole = _linearize(fixed, z, cycle, Residuals(np.empty(p), np.empty((p, p))))
    determinant = 1.0
    for i in range(p):
        arc = flight(fixed, z, p, q, i)
        speeds[i] = bases.speed(fixed, arc.x, arc.u)
        determinant *= bases.contraction(fixed, arc.v) * bases.reverses(fixed, arc.landing, arc.v)
    return whole.trace / whole.scale, determinant, admits(fixed, z, p, q)
