"""Continuation of orbits along one parameter, and of their bifurcations in two parameters.

The method is pseudo-arclength continuation, which passes folds, of the equations of
`vibrosweep.kernels.extended`.
"""

from __future__ import annotations

import math

import numpy as np

from vibrosweep.kernels._jit import Floats, jit, kernel, part
from vibrosweep.kernels.bases import Base, speed
from vibrosweep.kernels.closed import ADMISSIBLE, SAME, admits, flight, linearize
from vibrosweep.kernels.extended import (
    ALONG,
    CORNER,
    DOUBLING,
    FIX_DRIVE,
    FIX_E,
    GRAZE,
    REST,
    SADDLE_NODE,
    YIELD,
    Range,
    Work,
    correct,
    normalize,
    place,
    put_ahead,
    put_between,
    turn_along,
    value_of,
    work_for,
)
from vibrosweep.kernels.orbit_points import Line
from vibrosweep.model.parameters import Dimensionless

CONDITIONS = (SADDLE_NODE, DOUBLING, GRAZE, REST, CORNER, YIELD)  # of events on a line
BORN = 4  # another event: the orbit coincides with one of half its length
# Ends of a line: border of the range, its own beginning, a period doubling from which it branches,
# a graze or a rest, no next point found, too many points
LEFT, RETURNED, DOUBLED, TOUCHED, LOST, SPENT = range(6)
SHORTEST, SHRINKS, GROWS = 1e-7, 0.5, 1.3  # of steps along a line
STRAIGHT = 0.9  # least cosine of the angle between the directions at neighbouring points
TRIES = 30  # to find a bifurcation between two points
AT_ONCE = len(CONDITIONS)  # most points, and most events, that one step adds


@part
def _half(z: Floats, p: int, q: int, i: int) -> float:
    """Return how far an orbit differs, at landing i, from itself half a cycle later."""
    return z[i + p // 2] - z[i] - 0.5 * q  # type: ignore[no-any-return]


@part
def _births(old: Floats, new: Floats, p: int, q: int) -> bool:
    """Return whether a line has passed an orbit of half the length between two points."""
    if p % 2 or q % 2:
        return False
    product, least = 0.0, 0.0
    for i in range(p // 2):
        product += _half(old, p, q, i) * _half(new, p, q, i)
        least = max(least, abs(_half(old, p, q, i)))
    return product < 0.0 and least > SAME  # a line may begin at one


@part
def _locate(
    base: Base, problem: Dimensionless, span: Range, old: Floats, new: Floats, kind: int, work: Work
) -> bool:
    """Find a bifurcation between two points; the new point becomes the bifurcation."""
    n = span.p + 2
    low, high, middle = old.copy(), new.copy(), np.empty(n)
    tried, direction = np.empty(n), np.empty(n)
    put_ahead(direction, new, -1.0, old)
    apart = normalize(direction)
    below = value_of(base, problem, span, low, kind, work)
    above = value_of(base, problem, span, high, kind, work)
    for k in range(2 * TRIES):
        # Newton's method from the interpolated zero; if that fails, bisection along the line
        straight = abs(below) < math.inf and abs(above) < math.inf and k % 4 == 0
        if k % 2 == 0:
            put_between(middle, low, high, below / (below - above) if straight else 0.5)
        put_ahead(tried, middle, 0.0, middle)
        condition = kind if k % 2 == 0 else ALONG
        good = correct(base, problem, span, tried, condition, middle, direction, work)
        if k % 2 == 0:
            off = 0.0
            for c in range(n):
                off = max(off, abs(tried[c] - middle[c]))
            if good and off < apart:
                put_ahead(new, tried, 0.0, tried)
                return True
            continue
        if not good:
            return False
        at = value_of(base, problem, span, tried, kind, work)
        if (at > 0.0) == (below > 0.0):
            below = at
            put_ahead(low, tried, 0.0, tried)
        else:
            above = at
            put_ahead(high, tried, 0.0, tried)
    return False


@part
def _locate_birth(
    base: Base, problem: Dimensionless, span: Range, old: Floats, new: Floats, work: Work
) -> bool:
    """Find the period doubling from which an orbit branches; the new point becomes that orbit."""
    p, q = span.p, span.q
    short = p // 2
    z, middle, before, after = np.empty(short + 2), np.empty(p + 2), 0.0, 0.0
    for i in range(short):
        before += abs(_half(old, p, q, i))
        after += abs(_half(new, p, q, i))
    put_between(middle, old, new, before / (before + after))
    for i in range(short):
        z[i] = 0.5 * (middle[i] + middle[i + short] - 0.5 * q)
    z[short], z[short + 1] = middle[p], middle[p + 1]
    far = math.inf
    half = Range(short, q // 2, span.condition, span.relative, 0.0, 0.0, 0.0, 0.0, 0.0, far, far)
    if not correct(base, problem, half, z, DOUBLING, z.copy(), z, work_for(short)):
        return False
    for i in range(short):
        new[i], new[i + short] = z[i], z[i] + q // 2
    new[p], new[p + 1] = z[short], z[short + 1]
    return True


@part
def _record(
    base: Base, problem: Dimensionless, span: Range, z: Floats, out: Line, work: Work
) -> bool:
    """Add a point to a line; return whether its orbit is admissible."""
    k = out.ends[0]
    out.ends[0] += 1
    fixed = place(base, problem, z, span.p, span.relative)
    tangent = linearize(fixed, z, span.p, span.q, work.plus, work.inner)
    for c in range(z.size):
        out.z[k, c] = z[c]
    out.trace[k], out.determinant[k] = tangent.trace, tangent.determinant
    for i in range(span.p):
        arc = flight(fixed, z, span.p, span.q, i)
        out.speed[k, i] = speed(fixed, arc.x, arc.u)
    out.admissible[k] = admits(fixed, z, span.p, span.q)
    return out.admissible[k] == ADMISSIBLE  # type: ignore[no-any-return]


@jit
def _meet(out: Line, kind: int, z: Floats) -> None:
    """Add an event to a line."""
    k = out.ends[1]
    out.ends[1] += 1
    out.kind[k] = kind
    for c in range(z.size):
        out.at[k, c] = z[c]


@jit
def _outside(span: Range, z: Floats) -> int:
    """Return the parameter that has left its range, as the condition to hold it; 0 if none has."""
    p = span.p
    if span.condition != FIX_E and not span.low_e <= z[p] <= span.high_e:
        return FIX_E
    if span.condition != FIX_DRIVE and not span.low_drive <= z[p + 1] <= span.high_drive:
        return FIX_DRIVE
    return 0


@part
def _finish(
    base: Base, problem: Dimensionless, span: Range, old: Floats, z: Floats, work: Work
) -> bool:
    """Replace the last point of a line by the one at the border that it has passed."""
    border = _outside(span, z)
    c = span.p if border == FIX_E else span.p + 1
    low, high = span.low_e, span.high_e
    if border == FIX_DRIVE:
        low, high = span.low_drive, span.high_drive
    edge = low if z[c] < low else high
    put_between(z, old, z, (edge - old[c]) / (z[c] - old[c]))
    z[c] = edge
    return correct(base, problem, span, z, border, z.copy(), z, work)


@part
def _next(
    base: Base,
    problem: Dimensionless,
    span: Range,
    z: Floats,
    along: Floats,
    step: float,
    work: Work,
) -> bool:
    """Move along a line by about one step and update the direction; return whether it succeeds."""
    n = span.p + 2
    new, ahead = np.empty(n), along.copy()
    put_ahead(new, z, step, along)
    if not correct(base, problem, span, new, ALONG, new.copy(), along, work):
        return False
    if not turn_along(base, problem, span, new, ahead, work):
        return False
    cosine = 0.0
    for c in range(n):
        cosine += ahead[c] * along[c]
    if cosine > STRAIGHT:
        put_ahead(z, new, 0.0, new)
        put_ahead(along, ahead, 0.0, ahead)
    return cosine > STRAIGHT


@part
def _meet_events(
    base: Base,
    problem: Dimensionless,
    span: Range,
    old: Floats,
    z: Floats,
    out: Line,
    values: Floats,
    work: Work,
) -> bool:
    """Add the events of a step to a line; return whether the line ends there.

    `values` are those of the conditions at the old point, if that is not the first one, and become
    those at the new one.
    """
    at, before = np.empty(z.size), np.empty(len(CONDITIONS))
    for k, kind in enumerate(CONDITIONS):
        before[k] = values[k]
        if out.ends[0] == 1:  # a line may begin at a bifurcation, whose value is rounding
            value = value_of(base, problem, span, old, kind, work)
            before[k] = value if abs(value) > SAME else 0.0
        values[k] = value_of(base, problem, span, z, kind, work)
    # a multiplier may pass -1 and 1 in one step
    node, double = before[SADDLE_NODE], before[DOUBLING]
    swapped = double * (node - values[SADDLE_NODE]) < node * (double - values[DOUBLING])
    for turn in range(len(CONDITIONS)):
        k = 1 - turn if swapped and turn < GRAZE else turn
        kind = CONDITIONS[k]
        put_ahead(at, z, 0.0, z)
        changes = before[k] * values[k] < 0.0
        if changes and _locate(base, problem, span, old, at, kind, work):
            _meet(out, kind, at)
            _record(base, problem, span, at, out, work)
            if GRAZE <= kind < BORN:
                return True
    return False


@kernel
def follow_line(
    base: Base, problem: Dimensionless, span: Range, start: Floats, direction: Floats, out: Line
) -> None:
    """Follow a line from a point on it in one direction until it ends; see `Line.ends`.

    The problem has one realization, whose restitution and kick are overwritten.  If a parameter is
    fixed, events are searched for, and the line ends where no particle can follow its orbit.
    """
    p, q, work, step = span.p, span.q, work_for(span.p), 0.1 * span.longest
    events = span.condition < ALONG
    z, old, at, along = start.copy(), start.copy(), start.copy(), direction.copy()
    values = np.empty(len(CONDITIONS))
    out.ends[0], out.ends[1], out.ends[2] = 0, 0, SPENT
    _record(base, problem, span, z, out, work)
    while out.ends[0] < out.trace.size - AT_ONCE and out.ends[1] < out.kind.size - AT_ONCE:
        put_ahead(old, z, 0.0, z)
        if not _next(base, problem, span, z, along, step, work):
            step *= SHRINKS
            if step < SHORTEST:
                out.ends[2] = LOST
                return
            continue
        put_ahead(at, z, 0.0, z)
        if _births(old, z, p, q) and _locate_birth(base, problem, span, old, at, work):
            _meet(out, BORN, at)
            _record(base, problem, span, at, out, work)
            out.ends[2] = DOUBLED
            return
        passed = _outside(span, z) != 0
        if passed and not _finish(base, problem, span, old, z, work):
            out.ends[2] = LOST
            return
        if events and _meet_events(base, problem, span, old, z, out, values, work):
            out.ends[2] = TOUCHED
            return
        if not _record(base, problem, span, z, out, work) and events:
            out.ends[2] = LOST
            return
        if passed:
            out.ends[2] = LEFT
            return
        if out.ends[0] > 8 and _returns(start, z, p, step):
            out.ends[2] = RETURNED
            return
        step = min(step * GROWS, span.longest)


@jit
def _returns(start: Floats, z: Floats, p: int, step: float) -> bool:
    """Return whether a line has returned to its beginning."""
    off = 0.0
    for c in range(p + 2):
        apart = z[c] - start[c] - (np.rint(z[0] - start[0]) if c < p else 0.0)
        off = max(off, abs(apart))
    return off < 0.5 * step
