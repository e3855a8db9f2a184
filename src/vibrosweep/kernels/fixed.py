"""Fixed orbits of the map, with one impact every k forcing periods, found by Newton's method.

Near the ends of its window an orbit attracts ever more slowly, and outside it does not attract at
all.  Newton's method on the map finds it in either case in a few steps, and the Jacobian of its
impact says whether it attracts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels import bases
from vibrosweep.kernels._jit import Flags, Floats, Integers, jit, uncounted
from vibrosweep.kernels.arithmetic import HALF_ULP
from vibrosweep.kernels.bases import Base, Constants
from vibrosweep.kernels.memory import empty
from vibrosweep.kernels.restitution import (
    REBOUND_OF,
    arrival_to_repeat,
    lost_speed,
    ratio,
    ratio_error,
    rise_to_repeat,
    slope_change,
    speed_after,
)
from vibrosweep.model.parameters import Dimensionless

ABSENT, ATTRACTS, REPELS = 0, 1, 2  # in this order along the kick, see `find_fixed`
SEEDS = 32  # phases from which the search starts, evenly over a period
STEPS = 80  # towards a double root the distance only halves in each
RESIDUAL = 16.0 * HALF_ULP  # of a solution, relative to the kick
# Bound of the relative error of the kick at which the state is found to change, for a constant
# restitution; `end_errors` bounds the contribution of another law.  The computed phase is the exact
# one for a need (the right-hand side of the equation) that is off by the residual and its rounding,
# 16 + 5 half ulps of the kick.  The kicks at which the state changes, |need| and
# sqrt(need^2 + ((1 + sign e) / pi)^2), have no larger error.  The slope adds 4 half ulps, and a
# kick computed from an amplitude 2.
END_ERROR = 32.0 * HALF_ULP


class FixedOrbits(NamedTuple):
    """Fixed orbits, each array of shape (problem,)."""

    state: Flags  # `ABSENT`, `ATTRACTS` or `REPELS`; repels where it does not attract
    phase: Floats  # phase of impact in turns; NaN where absent


def empty_fixed(problems: int) -> FixedOrbits:
    """Allocate fixed orbits."""
    return empty(FixedOrbits, problems)


def may_push_back(rebound: str) -> bool:
    """Return whether a law of rebound reflects a particle whose rebound points into the base."""
    return speed_after(REBOUND_OF[rebound], 0.0, 0.0, -1.0) > 0.0


@jit
def _end_error(fixed: Constants, v: float) -> float:
    """Bound the error, as a kick, of the ends of a window whose orbit arrives with speed v.

    The kick at an end is |need|, or the root of need^2 plus another square.  The error of the need,
    and what it adds to the kick, is at most that of the speed after the impact.  The other square
    is that of a quotient of terms such as 1 + q, whose errors are bounded below.
    """
    law, e, scale = fixed.base.restitution, fixed.e, fixed.scale
    rounding = ratio_error(law, e, scale, v) + 8.0 * HALF_ULP
    change = slope_change(law, e, scale, v, rounding * v)[1]
    return 2.0 * rounding * v + 3.0 * change + 6.0 * rounding


@uncounted
def end_errors(base: Base, problem: Dimensionless, k: int, out: Floats) -> None:
    """Bounds on the errors, as kicks, that a law of restitution adds to the ends of windows.

    The windows are those of the orbit of k periods of each problem; the bounds are valid over the
    high-bounce base and over one that moves.
    """
    for t in range(out.size):
        fixed = bases.constants(base, problem, t)
        c = arrival_to_repeat(fixed.base.restitution, fixed.e, fixed.scale, float(k))
        out[t] = max(_end_error(fixed, float(k)), _end_error(fixed, c))


@uncounted
def conditions(base: Base, problem: Dimensionless, k: int, sign: float, out: Floats) -> None:
    """Write the conditions of the orbit of k periods of a single problem.

    These are the fields of `vibrosweep.model.orbit_theory.OrbitConditions`: a w at the landing,
    the least -a w' at which the orbit does not attract, and bounds on their errors; first in the
    high-bounce limit, then over the moving base.  `sign` is that of `find_fixed`.
    """
    fixed = bases.constants(base, problem, 0)
    law, e, scale = fixed.base.restitution, fixed.e, fixed.scale
    for moves in range(2):
        v = arrival_to_repeat(law, e, scale, float(k)) if moves else float(k)
        share, rounding = ratio(law, e, scale, v), ratio_error(law, e, scale, v) + 8.0 * HALF_ULP
        q, change = slope_change(law, e, scale, v, rounding * v)
        need, limit = rise_to_repeat(law, e, scale, float(k)), 0.0
        if moves:
            limit = 4.0 * (1.0 + e) * (1.0 + q * share) / ((1.0 + q) * (1.0 + share))
        else:
            need, limit = sign * lost_speed(law, e, scale, v, sign), 2.0 * (1.0 + sign * q)
        out[4 * moves], out[4 * moves + 1] = need, limit
        # no derivative of the limit by q or the share exceeds 8
        out[4 * moves + 2] = 2.0 * rounding * v
        out[4 * moves + 3] = 8.0 * (change + 2.0 * rounding)


@jit
def _solve(fixed: Constants, x: float, k: float, sign: float) -> tuple[bool, float]:
    """Newton's method from phase x; return whether it converges, and the phase."""
    for _ in range(STEPS):
        off, slope, size = bases.fixed_residual(fixed, x, k, sign)
        if abs(off) <= RESIDUAL * size:
            return True, x
        if slope == 0.0:
            break
        x -= off / slope
        x -= np.rint(x)
        if not abs(x) <= 0.5:
            break
    return False, np.nan


@uncounted
def find_fixed(
    first: int,
    last: int,
    base: Base,
    problem: Dimensionless,
    k: Integers,
    sign: float,
    out: FixedOrbits,
) -> None:
    """Find the fixed orbit of k periods of problems first ... last - 1.

    If there are several, the one that attracts is taken.  As the kick increases, for e below 1, the
    orbit is absent, then attracts, then repels.  `sign` is -1 for the orbit that is reflected at
    every impact.
    """
    for t in range(first, last):
        out.state[t], out.phase[t] = ABSENT, np.nan
        fixed = bases.constants(base, problem, t)
        for seed in range(SEEDS):
            found, x = _solve(fixed, (seed + 0.5) / SEEDS - 0.5, k[t], sign)
            if found and bases.fixed_holds(fixed, x, k[t]):
                out.state[t], out.phase[t] = REPELS, x
                if bases.fixed_attracts(fixed, x, k[t]):
                    out.state[t] = ATTRACTS
                    break


@uncounted
def orbits_hold(
    first: int,
    last: int,
    base: Base,
    problem: Dimensionless,
    k: Integers,
    x: Floats,
    out: FixedOrbits,
) -> None:
    """Check whether particles of problems first ... last - 1 can follow orbits of k periods.

    The orbits land at the phases x and attract.  A particle cannot follow its orbit if it rests or
    lands earlier.
    """
    for t in range(first, last):
        holds = bases.fixed_holds(bases.constants(base, problem, t), x[t], float(k[t]))
        out.state[t], out.phase[t] = ATTRACTS if holds else ABSENT, x[t]
