"""The Jacobian of an impact on the moving base.

The flight from phase x with relative speed y lasts s and arrives with the speed z; F is the
clearance (`landing_search`), with the angles t = 2 pi x, t' = 2 pi (x + s), q = 2 pi s.  Then

    ds = (P dx + s dy) / z,     P = alpha (cos t (q - sin q) + sin t (1 - cos q))
    dz = 2 (1 + Gamma cos t') ds + 2 Gamma (cos t' - cos t) dx - dy

with the determinant y / z of (dx + ds, dz).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibrosweep.kernels import bases
from vibrosweep.kernels._jit import fma, implements, jit
from vibrosweep.kernels.bases import Flight, Jacobian
from vibrosweep.kernels.bases.moving import MovingConstants
from vibrosweep.kernels.noise import slope_of
from vibrosweep.kernels.restitution import ratio, slack, slope
from vibrosweep.kernels.rounding import HALF_ULP, KICK_ERROR
from vibrosweep.kernels.sine import (
    COSINE_ERROR,
    LAG_ERROR,
    SINE_ERROR,
    cos_turns,
    sin_and_lag,
    sin_near,
    sin_turns,
)

# alpha = a / (1 + e), relative; Gamma = pi alpha takes two roundings more.
ALPHA_ERROR = KICK_ERROR + 2.0 * HALF_ULP
GAMMA_ERROR = ALPHA_ERROR + 2.0 * HALF_ULP
# Of sin t (q - sin q), sin t (1 - cos q) and so on, where the cosine is exact, relative: the
# functions, 1 - cos q = 2 sin^2(q / 2), the products, their sum, and alpha.
TERM_ERROR = SINE_ERROR + LAG_ERROR + ALPHA_ERROR + 6.0 * HALF_ULP


class Along(NamedTuple):
    """A flight after t periods: clearance F, speed z = -2 F' towards the base, and their errors.

    With them the sine and cosine of the lift-off, sin q, q - sin q and 1 - cos q.
    """

    f: float
    f_error: float
    z: float
    z_error: float
    sine: float
    cosine: float
    turned: float
    lag: float
    c: float


@jit
def along(fixed: MovingConstants, x: float, y: float, t: float) -> Along:
    """Where a flight is after t periods."""
    alpha, sine, cosine = fixed.alpha, sin_turns(x), cos_turns(x)
    part = t - np.rint(t)
    turned, lag = sin_and_lag(t, part)
    half = sin_near(0.5 * part)
    c = 2.0 * half * half
    level = (0.25 / math.pi) * alpha
    f = fma(0.5 * t, y - t, level * fma(sine, lag, -cosine * c))
    f_error = HALF_ULP * (0.5 * t * abs(y - t) + abs(f)) + level * (
        TERM_ERROR * (abs(sine) * lag + abs(cosine) * c) + COSINE_ERROR * c
    )
    slowed = fma(sine, c, -cosine * turned)
    z = fma(-alpha, slowed, 2.0 * t - y)
    z_error = HALF_ULP * (abs(2.0 * t - y) + abs(z)) + alpha * (
        TERM_ERROR * (abs(sine) * c + abs(cosine * turned)) + COSINE_ERROR * abs(turned)
    )
    return Along(f, f_error, z, z_error, sine, cosine, turned, lag, c)


@implements(bases.jacobian, MovingConstants)
def jacobian_moving(fixed: MovingConstants, flight: Flight) -> Jacobian:
    law, alpha, gamma = fixed.base.restitution, fixed.alpha, math.pi * fixed.alpha
    s, z = flight.time, flight.v
    share, q = ratio(law, fixed.e, fixed.scale, z), slope(law, fixed.e, fixed.scale, z)
    q = slope_of(fixed.base.noise, share, q, fixed.draw, z)
    if s == 0.0:  # it lands at once
        return 1.0, 0.0, 0.0, -q, 1.0 + slack(law) * abs(q)
    at = along(fixed, flight.x, flight.u, s)
    by_x = alpha * fma(at.cosine, at.lag, at.sine * at.c) / z
    by_y = s / z
    dropped = at.cosine * at.c + at.sine * at.turned  # cos t - cos t'
    pull = 2.0 * (1.0 + gamma * (at.cosine - dropped))
    lost = 2.0 * gamma * dropped
    # of all terms, of which a rounding error of z makes a part of those it is made of
    turns = at.c + abs(at.turned)
    parts = 1.0 + (2.0 * s + abs(flight.u) + 2.0 * alpha * turns) / z
    size = 1.0 + parts * (alpha * (at.lag + at.c) + s) / z
    size += slack(law) * abs(q) * ((abs(pull) + 2.0 * gamma + 2.0) * size + 4.0 * gamma * turns)
    return 1.0 + by_x, by_y, q * (pull * by_x - lost), q * (pull * by_y - 1.0), size
