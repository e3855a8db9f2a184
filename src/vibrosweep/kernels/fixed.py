"""Fixed orbits of the map, one impact every k forcing periods, solved for instead of waited for.

Near the ends of its window an orbit attracts ever more slowly, and outside it does not attract at
all.  Newton's method on the map finds it in either case in a few steps, and the Jacobian of its
impact says whether it attracts.

An orbit that leaves with the flight k lands with it, so that k = sign (e k + a sin 2 pi x), where
the sign is -1 for an orbit that the `reflect` law turns back at every impact.  Its Jacobian

    [[1, 1], [sign s, sign (e + s)]],      s = 2 pi a cos(2 pi x),

has the determinant sign e and the trace 1 + sign (e + s); both its eigenvalues are inside the unit
circle if and only if e < 1 and 0 < -sign s < 2 (1 + sign e).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Flags, Floats, Integers, jit, kernel
from vibrosweep.kernels.bases.high_bounce import kick_slope
from vibrosweep.kernels.laws import LAW_OF, speed_after
from vibrosweep.kernels.rounding import HALF_ULP
from vibrosweep.kernels.sine import sin_turns

__all__ = [
    "ABSENT",
    "ATTRACTS",
    "END_ERROR",
    "REPELS",
    "FixedOrbits",
    "empty_fixed",
    "find_fixed",
    "turns_back",
]

ABSENT, ATTRACTS, REPELS = 0, 1, 2  # in this order along the kick, see `find_fixed`
SEEDS = 32  # phases from which the search starts, evenly over a period
STEPS = 80  # towards a double root the distance only halves in each
RESIDUAL = 16.0 * HALF_ULP  # of a solution, relative to the kick
# Relative error of the kick at which the state is seen to change.  The phase that is found is exact
# for a need that is off by the residual and its rounding, 16 + 5 half ulps of the kick, and neither
# |need| nor sqrt(need^2 + ((1 + sign e) / pi)^2), where the state changes, is off by more.  The
# slope adds 4, and the kick that is made of an amplitude 2.
END_ERROR = 32.0 * HALF_ULP


class FixedOrbits(NamedTuple):
    """Fixed orbits, each array of shape (problem,).

    Attributes
    ----------
    state
        `ABSENT`, `ATTRACTS` or `REPELS`; repels where it does not attract.
    phase
        Phase of impact in turns; NaN where absent.
    """

    state: Flags
    phase: Floats


def empty_fixed(problems: int) -> FixedOrbits:
    """Room for fixed orbits."""
    return FixedOrbits(np.empty(problems, np.int8), np.empty(problems))


def turns_back(rebound: str) -> bool:
    """Whether a law of rebound turns a particle back that is pushed into the base."""
    return speed_after(LAW_OF[rebound], 0.0, 0.0, -1.0) > 0.0


@jit
def _solve(x: float, need: float, a: float) -> tuple[bool, float]:
    """Newton's method from phase x for a kick of `need`: whether it converges, and to where."""
    for _ in range(STEPS):
        off = a * sin_turns(x) - need
        if abs(off) <= RESIDUAL * a:
            return True, x
        slope = kick_slope(x, a)
        if slope == 0.0:
            break
        x -= off / slope
        x -= np.rint(x)
        if not abs(x) <= 0.5:
            break
    return False, np.nan


@kernel
def find_fixed(
    first: int,
    last: int,
    restitution: Floats,
    kick: Floats,
    rest_flight: Floats,
    k: Integers,
    sign: float,
    out: FixedOrbits,
) -> None:
    """Find the fixed orbit of k periods that attracts, or else one that does not.

    With e below 1 and a growing kick it is absent, then attracts, then repels.

    Parameters
    ----------
    first, last
        Range of problems.
    restitution, kick, rest_flight, k
        e, a, r and the number of periods, each of shape (problem,).
    sign
        1, or -1 for the orbit that the `reflect` law turns back.
    out : FixedOrbits
        Only the slots first ... last - 1 are written.
    """
    for t in range(first, last):
        e, a = restitution[t], kick[t]
        out.state[t], out.phase[t] = ABSENT, np.nan
        if not k[t] > rest_flight[t]:
            continue
        # not as the difference of the flights, of which 1 - e would be lost in rounding near 1
        need = (sign - e) * k[t]
        for seed in range(SEEDS):
            found, x = _solve((seed + 0.5) / SEEDS - 0.5, need, a)
            if found:
                out.state[t], out.phase[t] = REPELS, x
                if e < 1.0 and 0.0 < -sign * kick_slope(x, a) < 2.0 * (1.0 + sign * e):
                    out.state[t] = ATTRACTS
                    break
