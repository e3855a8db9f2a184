"""A cycle proved to exist, and its multipliers as balls.

The state (x, u), phase and speed relative to the base at lift-off, lies on a cycle of p
impacts in q periods if p impacts lead to (x + q, u).  Newton's method finds it next to a state of
an orbit; the interval Newton operator (Krawczyk 1969; Moore 1966) then maps a box around it into
its interior, which proves that one and only one such state lies in the box, and the Jacobians over
the box enclose the cycle's own.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

from vibrosweep.proof.reference._flint import arb, ctx
from vibrosweep.proof.reference.motion import PeriodMap

# Impacts; a longer cycle would take too long to verify.
MAX_CYCLE: Final = 1000
# Periods; if the cycle found by Newton's method is farther from the orbit, it is another one.
NEAR: Final = 2.0**-20
ROUNDS: Final = 40


class _Return(NamedTuple):
    """Image of a state after one cycle, and the Jacobian along it, by rows."""

    x: arb
    u: arb
    jacobian: tuple[arb, arb, arb, arb]
    determinant: arb


def largest_exponent(
    map_of: Callable[[], PeriodMap],
    state: tuple[arb, arb],
    impacts: int,
    periods: int,
) -> arb | None:
    """Largest Lyapunov exponent per impact of the cycle without rests that passes next to a state.

    The state, phase in turns and speed at lift-off, is one of an orbit that has come near to the
    cycle; `map_of` returns the map in forcing periods, at the current precision.  None if no such
    cycle is proved: a decision along it is uncertain, a multiplier may be 1 or all may be 0, or it
    is longer than `MAX_CYCLE`.
    """
    if impacts > MAX_CYCLE:
        return None
    with ctx.workprec(128 + 4 * math.ceil(impacts * map_of().lost())):
        found = _proved_return(map_of(), state, impacts, periods)
        return None if found is None else _exponent(found, impacts)


def _proved_return(
    m: PeriodMap, state: tuple[arb, arb], impacts: int, periods: int
) -> _Return | None:
    """Return from a box in which the cycle is proved to pass, or None."""
    x, u = state[0].mid(), state[1].mid()
    radius = arb(2) ** (-ctx.prec // 2)
    for _ in range(ROUNDS):
        back = _once_round(m, x, u, impacts)
        step = None if back is None else _newton(back, back, x, u, periods)
        if step is None:
            return None
        x, u = (x + step[0]).mid(), (u + step[1]).mid()
        if not (abs(x - state[0]) < NEAR and abs(u - state[1]) < NEAR):
            return None
        if abs(step[0]) < radius and abs(step[1]) < radius:
            break
    back = _once_round(m, x, u, impacts)
    wide = arb(0, radius)
    box = _once_round(m, x + wide, u + wide, impacts)
    if back is None or box is None:
        return None
    step = _newton(back, box, x, u, periods)
    inside = step is not None and abs(step[0]) < radius and abs(step[1]) < radius
    return box if inside else None


def _once_round(m: PeriodMap, x: arb, u: arb, impacts: int) -> _Return | None:
    """Follow a ball of states round the cycle; None if one may rest, or a decision is uncertain."""
    j00, j01, j10, j11 = arb(1), arb(0), arb(0), arb(1)
    determinant = arb(1)
    for _ in range(impacts):
        step = m.step(x, u)
        if step is None:
            return None
        (xx, xu), (ux, uu) = step.rows
        j00, j10 = xx * j00 + xu * j10, ux * j00 + uu * j10
        j01, j11 = xx * j01 + xu * j11, ux * j01 + uu * j11
        determinant *= step.determinant
        x, u = x + step.duration, step.speed
    return _Return(x, u, (j00, j01, j10, j11), determinant)


def _newton(back: _Return, slope: _Return, x: arb, u: arb, periods: int) -> tuple[arb, arb] | None:
    """Step to the fixed point from the residual of `back` and the Jacobian of `slope`."""
    j00, j01, j10, j11 = slope.jacobian
    j00, j11 = j00 - 1, j11 - 1
    determinant = j00 * j11 - j01 * j10
    if determinant.contains(0):
        return None
    g, h = x + periods - back.x, u - back.u
    return (j11 * g - j01 * h) / determinant, (j00 * h - j10 * g) / determinant


def _exponent(found: _Return, impacts: int) -> arb | None:
    """Logarithm of the largest modulus of the eigenvalues, per impact."""
    trace = abs(found.jacobian[0] + found.jacobian[3])
    discriminant = trace * trace - 4 * found.determinant
    if discriminant < 0:
        modulus = found.determinant.sqrt()
    else:  # where it may be 0, the modulus is between those of both cases
        root = discriminant.abs_upper().sqrt()
        least = discriminant.abs_lower().sqrt() if discriminant > 0 else arb(0)
        modulus = (trace + least.union(root)) / 2
    return modulus.log() / impacts if modulus > 0 else None
