"""Fixed orbits of the map, one impact every k forcing periods, solved for instead of waited for.

Near the ends of its window an orbit attracts ever more slowly, and outside it does not attract at
all.  Newton's method on the map itself, with the Jacobian of an impact, finds it in either case in
a few steps, and the eigenvalues of that Jacobian say whether it attracts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels._jit import Flags, Floats, Integers, fma, jit, kernel
from vibrosweep.kernels.impact import land
from vibrosweep.kernels.orbits import leading_eigenvalue
from vibrosweep.kernels.rounding import HALF_ULP
from vibrosweep.kernels.sine import cos_turns, sin_turns

__all__ = ["ABSENT", "ATTRACTS", "REPELS", "FixedOrbits", "empty_fixed", "find_fixed"]

ABSENT, REPELS, ATTRACTS = 0, 1, 2
SEEDS = 32  # phases from which the search starts, evenly over a period
STEPS = 80  # towards a double root the distance only halves in each
RESIDUAL = 16.0 * HALF_ULP  # of a solution, relative to the terms of the equation


class FixedOrbits(NamedTuple):
    """Fixed orbits, each array of shape (problem,).

    Attributes
    ----------
    state
        `ABSENT`, `REPELS` or `ATTRACTS`.
    phase
        Phase of impact in turns; NaN where absent.
    multiplier
        Its leading multiplier; NaN where absent.
    """

    state: Flags
    phase: Floats
    multiplier: NDArray[np.complex128]


def empty_fixed(problems: int) -> FixedOrbits:
    """Room for fixed orbits."""
    return FixedOrbits(
        np.empty(problems, np.int8), np.empty(problems), np.empty(problems, np.complex128)
    )


@jit
def _solve(
    x: float, k: float, e: float, a: float, reflect: int | None
) -> tuple[bool, float, complex]:
    """Newton's method from phase x: whether it converges, the phase and the leading multiplier."""
    u = k
    for _ in range(STEPS):
        landed, passed = land(x, u)
        w = fma(e, u, a * sin_turns(landed))
        sign = -1.0 if reflect is not None and w < 0.0 else 1.0
        slope = sign * (2.0 * math.pi * a * cos_turns(landed))
        off_x, off_u = (passed - k) + (landed - x), sign * w - u
        if abs(off_x) <= RESIDUAL * k and abs(off_u) <= RESIDUAL * (k + a):
            return True, x, leading_eigenvalue(1.0 + sign * e + slope, sign * e)
        if slope == 0.0:
            break
        # the Jacobian of the residual is [[0, 1], [slope, sign e + slope - 1]]
        step = (off_u - (sign * e + slope - 1.0) * off_x) / slope
        x -= step
        u -= off_x
        x -= np.rint(x)
        if not abs(x) <= 0.5:
            break
    return False, np.nan, complex(np.nan, np.nan)


@kernel
def find_fixed(
    first: int,
    last: int,
    restitution: Floats,
    kick: Floats,
    rest_flight: Floats,
    k: Integers,
    reflect: int | None,
    out: FixedOrbits,
) -> None:
    """Find the fixed orbit of k periods that attracts most, or repels least.

    Parameters
    ----------
    first, last
        Range of problems.
    restitution, kick, rest_flight, k
        e, a, r and the number of periods, each of shape (problem,).
    reflect
        None, or 1 for the `reflect` law; chosen at compile time.
    out : FixedOrbits
        Only the slots first ... last - 1 are written.
    """
    for t in range(first, last):
        out.state[t], out.phase[t] = ABSENT, np.nan
        out.multiplier[t] = complex(np.nan, np.nan)
        least = np.inf
        if not k[t] > rest_flight[t]:
            continue
        for seed in range(SEEDS):
            x = (seed + 0.5) / SEEDS - 0.5
            found, phase, multiplier = _solve(x, float(k[t]), restitution[t], kick[t], reflect)
            if found and abs(multiplier) < least:
                least = abs(multiplier)
                out.state[t] = ATTRACTS if least < 1.0 else REPELS
                out.phase[t], out.multiplier[t] = phase, multiplier
