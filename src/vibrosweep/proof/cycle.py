"""A cycle proved to exist, and its multipliers as balls.

The state (x, u), phase at lift-off and flight that follows in forcing periods, lies on a cycle of p
impacts in q periods if p impacts lead to (x + q, u).  Newton's method finds it next to a state of
an orbit; the interval Newton operator (Krawczyk 1969; Moore 1966) then maps a box around it into
its interior, which proves that one and only one such state lies in the box, and the Jacobians over
the box enclose the cycle's own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

from vibrosweep.proof.reference._flint import arb, ctx
from vibrosweep.proof.reference.high_bounce import PeriodMap

__all__ = ["MAX_CYCLE", "largest_exponent"]

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
    parameters: Mapping[str, float],
    rebound: str,
    state: tuple[arb, arb],
    impacts: int,
    periods: int,
) -> arb | None:
    """Largest Lyapunov exponent per impact of the cycle without rests that passes next to a state.

    Parameters
    ----------
    parameters
        Every parameter of `vibrosweep.model.parameters.PARAMETERS`.
    rebound
        ``"rest"`` or ``"reflect"``.
    state
        Phase at lift-off in turns and flight that follows in forcing periods, of an orbit that has
        come near to the cycle.
    impacts, periods
        Of the cycle.

    Returns
    -------
    arb or None
        None if no such cycle is proved: a decision along it is within the error, its multiplier is
        1 or its modulus 0, or it is longer than `MAX_CYCLE`.
    """
    if impacts > MAX_CYCLE:
        return None
    kick = float(PeriodMap.of(parameters, rebound).a)
    lost = 1.0 + math.log2(3.0 + 4.0 * math.pi * kick)  # bits, by the Jacobian of one impact
    with ctx.workprec(128 + 4 * math.ceil(impacts * lost)):
        m = PeriodMap.of(parameters, rebound)
        found = _proved_return(m, state, impacts, periods)
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
    box = _once_round(m, x + _ball(radius), u + _ball(radius), impacts)
    if back is None or box is None:
        return None
    step = _newton(back, box, x, u, periods)
    inside = step is not None and abs(step[0]) < radius and abs(step[1]) < radius
    return box if inside else None


def _ball(radius: arb) -> arb:
    return arb(0, radius.abs_upper())


def _once_round(m: PeriodMap, x: arb, u: arb, impacts: int) -> _Return | None:
    """Follow a ball of states round the cycle; None where it may rest or turn on the way."""
    j00, j01, j10, j11 = arb(1), arb(0), arb(0), arb(1)
    determinant = arb(1)
    for _ in range(impacts):
        x = x + u
        w = m.speed(x, u)
        s, f = m.slopes(x, u)
        j10, j11, j00, j01 = (
            s * j00 + (f + s) * j10,
            s * j01 + (f + s) * j11,
            j00 + j10,
            j01 + j11,
        )
        determinant *= f
        if m.law.turns_back and w < 0:
            w, j10, j11, determinant = -w, -j10, -j11, -determinant
        if not w > m.r:
            return None
        u = w
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
