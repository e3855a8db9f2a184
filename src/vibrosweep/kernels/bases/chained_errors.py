"""Bounds on errors, and derivatives, over the base of parabolas.

The acceleration jumps at the corners of the velocity.  Between them derivatives do not depend on
the phase; where an error reaches across a corner, they change by a bounded step.
"""

from __future__ import annotations

import math

import numpy as np

from vibrosweep.kernels._jit import fma, implements
from vibrosweep.kernels.bases import Flight, error_bounds
from vibrosweep.kernels.bases.chained import CORNER, TOP, clearance, level_at, since, stretch_at
from vibrosweep.kernels.bases.chords import height
from vibrosweep.kernels.bases.error_bounds import StateError
from vibrosweep.kernels.bases.landing_search import phase_after
from vibrosweep.kernels.bases.moving import ChainedConstants
from vibrosweep.kernels.bases.moving_jacobian import ALPHA_ERROR, GAMMA_ERROR, Along, along
from vibrosweep.kernels.bases.moving_limits import (
    Bends,
    Limits,
    below_top,
    bends,
    keeps_pressing,
    limits,
)
from vibrosweep.kernels.rounding import HALF_ULP

# Error of W(x + t) - W(x) - t w(x) and of w(x + t) - w(x), relative to the size of their terms:
# that of alpha, half an ulp of 1 in a phase, which moves w by 4 times as much, four roundings each
TERM_ERROR = ALPHA_ERROR + 16.0 * HALF_ULP


@implements(along, ChainedConstants)
def along_chained(fixed: ChainedConstants, x: float, y: float, t: float) -> Along:
    alpha, half = fixed.alpha, 0.5 * fixed.alpha
    rise, gain, size = since(x, t)
    f = fma(0.5 * t, y - t, -half * rise)
    f_error = HALF_ULP * (0.5 * t * abs(y - t) + abs(f)) + half * TERM_ERROR * size
    z = fma(alpha, gain, 2.0 * t - y)
    turns = min(12.0 * t, 2.0)
    z_error = HALF_ULP * (abs(2.0 * t - y) + abs(z)) + alpha * TERM_ERROR * turns
    first, last = stretch_at(x)[0], stretch_at(phase_after(x, t))[0]
    return Along(
        f,
        f_error,
        z,
        z_error,
        alpha * fma(4.0 * first, t, -gain),
        2.0 * alpha * last,
        2.0 * alpha * (first - last),
        8.0 * alpha * t,
        alpha * turns,
        4.0 * alpha,
    )


@implements(height, ChainedConstants)
def height_chained(fixed: ChainedConstants, x: float, y: float, s: float) -> tuple[float, float]:
    return clearance(fixed.alpha, x, y, s)


@implements(limits, ChainedConstants)
def limits_chained(fixed: ChainedConstants, slack: float) -> Limits:
    alpha = fixed.alpha * slack
    return Limits(2.0 * alpha, 2.0 * alpha, math.pi * alpha, np.inf, 0.0, 0.0)


@implements(below_top, ChainedConstants)
def below_top_chained(fixed: ChainedConstants, x: float, dx: float, slack: float) -> float:
    below = (TOP - level_at(x)) + dx + HALF_ULP
    return 4.0 * math.pi * math.pi * (fixed.alpha * slack) * below


@implements(bends, ChainedConstants)
def bends_chained(fixed: ChainedConstants, flight: Flight, dx: float, off: float) -> Bends:
    step = 4.0 * fixed.alpha  # of G at a corner
    begins = abs(abs(flight.x) - CORNER) < dx
    ends = abs(abs(flight.landing) - CORNER) <= dx + off + HALF_ULP
    of_p = 2.0 * step * (dx + off)
    of_p += 2.0 * step * (flight.time + off) if begins else 0.0
    jumps = (1.0 if begins else 0.0) + (1.0 if ends else 0.0)
    return Bends(of_p, 2.0 * step if ends else 0.0, 2.0 * step * jumps)


@implements(keeps_pressing, ChainedConstants)
def keeps_pressing_chained(fixed: ChainedConstants, x: float, pull: float, error: float) -> bool:
    return not abs(abs(x) - CORNER) <= error or 2.0 * fixed.alpha * (1.0 + GAMMA_ERROR) < 1.0


@implements(error_bounds.liftoff_error, ChainedConstants)
def liftoff_error_chained(fixed: ChainedConstants) -> StateError:
    doubtful = abs(2.0 * fixed.alpha - 1.0) <= 8.0 * GAMMA_ERROR
    return StateError(np.inf if doubtful else 0.0, 0.0)
