"""Bounds on errors at the rests on a base that moves as a sum of harmonics."""

from __future__ import annotations

import numpy as np

from vibrosweep.kernels._jit import implements, jit
from vibrosweep.kernels.bases import error_bounds
from vibrosweep.kernels.bases.error_bounds import StateError
from vibrosweep.kernels.bases.landing_search import BORDER
from vibrosweep.kernels.bases.moving import ShapedConstants
from vibrosweep.kernels.bases.moving_jacobian import GAMMA_ERROR
from vibrosweep.kernels.bases.moving_limits import limits
from vibrosweep.kernels.bases.shaped_search import stretch
from vibrosweep.kernels.harmonics import kick_curvature
from vibrosweep.kernels.rounding import HALF_ULP, REST_ERROR
from vibrosweep.kernels.waveforms import kick_slope


@jit
def _nearest_end(fixed: ShapedConstants, x: float) -> float:
    """Periods between phase x and the nearest end of a stretch in which the base presses."""
    nearest = np.inf
    for k in range(len(fixed.falls)):
        for end in (fixed.falls[k], fixed.presses[k]):
            apart = abs(x - end)
            apart = min(apart, 1.0 - apart)
            nearest = apart if apart < nearest else nearest
    return nearest


@implements(error_bounds.rest_is_doubtful, ShapedConstants)
def rest_is_doubtful_shaped(fixed: ShapedConstants, x: float, w: float, spread: StateError) -> bool:
    w_error = spread.speed + REST_ERROR * fixed.r
    if w - fixed.r > w_error:
        return False
    edge = spread.phase + error_bounds.liftoff_error(fixed).phase
    if _nearest_end(fixed, x) <= edge + 2.0 * BORDER:
        return True
    presses, _, _ = stretch(fixed, x)
    return not edge < np.inf or (presses and not fixed.r - w > w_error)


@implements(error_bounds.liftoff_error, ShapedConstants)
def liftoff_error_shaped(fixed: ShapedConstants) -> StateError:
    shape, half, limit = fixed.base.waveform, 0.5 * fixed.alpha, limits(fixed, 1.0)
    off = 4.0 * GAMMA_ERROR * (1.0 + limit.steep) + 2.0 * limit.slope_rounding
    if limit.fall + off <= 1.0:  # it is never lifted
        return StateError(0.0, 0.0)
    jolt = limit.angle * limit.angle * limit.steep  # of |G''|
    worst = 0.0
    for k in range(len(fixed.falls)):
        for x in (shape.dip[k], shape.before[k], shape.after[k]):
            if abs(1.0 + kick_slope(shape, half, x - np.rint(x))) <= off:
                return StateError(np.inf, np.inf)
        x = fixed.falls[k]
        if x == x:
            wrong = abs(1.0 + kick_slope(shape, half, x)) + off
            slope = abs(kick_curvature(shape, half, x)) - limit.angle * limit.slope_rounding
            # Kantorovich's condition for Newton's method
            if not (slope > 0.0 and wrong * jolt <= 0.25 * slope * slope):
                return StateError(np.inf, np.inf)
            worst = max(worst, 2.0 * wrong / slope + HALF_ULP)
    return StateError(worst, 0.0)
