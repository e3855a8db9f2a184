"""The Jacobian of an impact on the moving base, and orbits that land every k periods.

The flight from phase x with relative speed y lasts s and arrives with the speed z.  With the
velocity w of the base in units of alpha and its acceleration G = alpha w' / 2 in units of gravity

    ds = (P dx + s dy) / z,     P = alpha (w(x) + s w'(x) - w(x + s))
    dz = 2 (1 + G(x + s)) ds + 2 (G(x + s) - G(x)) dx - dy

The determinant of (dx + ds, dz) is y / z.  For a sine, with q = 2 pi s, P is alpha (cos(2 pi x)
(q - sin q) + sin(2 pi x) (1 - cos q)), in which nothing cancels; for harmonics it is a sum of such
terms.

An orbit that lands every k periods meets the base with the relative speed c, where c + E(c) = 2 k,
at a phase x at which the base rises with c - k.  With the slope q of E at c and e = E(c) / c, its
multipliers are the roots of z^2 - (1 + q e + (1 + q)(1 + e) G) z + q e.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibrosweep.kernels import bases
from vibrosweep.kernels._jit import fma, generic, implements
from vibrosweep.kernels.bases import Constants, Flight, Jacobian
from vibrosweep.kernels.bases.moving import ANY, MovingConstants, ShapedConstants
from vibrosweep.kernels.bases.moving_limits import limits
from vibrosweep.kernels.noise import slope_of
from vibrosweep.kernels.restitution import (
    arrival_to_repeat,
    leaving_to_repeat,
    ratio,
    rise_to_repeat,
    slack,
    slope,
)
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
from vibrosweep.kernels.waveforms import kick_slope, velocity
from vibrosweep.model.shapes import TWO_PI

# Relative errors of alpha = a / (1 + e) and of Gamma = pi alpha, which takes two roundings more.
ALPHA_ERROR = KICK_ERROR + 2.0 * HALF_ULP
GAMMA_ERROR = ALPHA_ERROR + 2.0 * HALF_ULP
# Relative error of sin t (q - sin q), sin t (1 - cos q) and so on, for an exact cosine: that of the
# functions, 1 - cos q = 2 sin^2(q / 2), the products, their sum, and alpha.
TERM_ERROR = SINE_ERROR + LAG_ERROR + ALPHA_ERROR + 6.0 * HALF_ULP
# The same for harmonics, relative to |p| + |q| of each: both functions, nine roundings of p and q,
# five of the phase, with their effect on 2 pi h s - sin and 1 - cos; one more for each term.
SUM_ERROR = SINE_ERROR + COSINE_ERROR + LAG_ERROR + ALPHA_ERROR + 32.0 * HALF_ULP
AT_LANDING = 2.0**-20  # periods; an earlier landing is farther than this from the end of the flight


class Along(NamedTuple):
    """A flight after t periods."""

    # f, f_error, z, z_error: clearance F, speed z = -2 F' towards the base, and their errors
    f: float
    f_error: float
    z: float
    z_error: float
    # by_x, acceleration, lost: P, G(x + t), and G(x) - G(x + t)
    by_x: float
    acceleration: float
    lost: float
    # of_x, of_z, of_lost: bounds, at any phase of the lift-off, of the sums of the moduli of the
    # terms of P, of the base's part of z, and of `lost`
    of_x: float
    of_z: float
    of_lost: float


@generic
def along(fixed: Constants, x: float, y: float, t: float) -> Along:
    """State of a flight from phase x with relative speed y after t periods."""


@implements(along, MovingConstants)
def along_moving(fixed: MovingConstants, x: float, y: float, t: float) -> Along:
    alpha, sine, cosine = fixed.alpha, sin_turns(x), cos_turns(x)
    gamma = math.pi * alpha
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
    by_x = alpha * fma(cosine, lag, sine * c)
    dropped, turns = cosine * c + sine * turned, c + abs(turned)
    then, lost = gamma * (cosine - dropped), gamma * dropped
    of_x, of_z, of_lost = alpha * (lag + c), alpha * turns, gamma * turns
    return Along(f, f_error, z, z_error, by_x, then, lost, of_x, of_z, of_lost)


@implements(along, ShapedConstants)
def along_shaped(fixed: ShapedConstants, x: float, y: float, t: float) -> Along:
    shape, alpha, half = fixed.base.waveform, fixed.alpha, 0.5 * fixed.alpha
    sunk, slowed, by_x, at_first, dropped = 0.0, 0.0, 0.0, 0.0, 0.0
    of_f, of_z, of_x, of_lost = 0.0, 0.0, 0.0, 0.0
    for k in range(len(shape.p)):
        h, angle = k + 1.0, TWO_PI * (k + 1)
        p, q = shape.p[k], shape.q[k]
        size, begin = abs(p) + abs(q), fma(h, x, -np.rint(h * x))
        part = fma(h, t, -np.rint(h * t))
        sine, cosine = sin_turns(begin), cos_turns(begin)
        turned, lag = sin_and_lag(h * t, part)
        over = sin_near(0.5 * part)
        c = 2.0 * over * over
        u, v = fma(p, sine, q * cosine), fma(p, cosine, -q * sine)
        sunk += fma(u, lag, -v * c) / angle
        slowed += fma(u, c, -v * turned)
        by_x += fma(v, lag, u * c)
        at_first = fma(angle, v, at_first)
        dropped = fma(angle, fma(v, c, u * turned), dropped)
        of_f += size * (lag + c) / angle
        of_z += size * (c + abs(turned))
        of_x += size * (lag + c)
        of_lost += angle * size * (c + abs(turned))
    relative = SUM_ERROR + HALF_ULP * len(shape.p)
    f = fma(0.5 * t, y - t, half * sunk)
    f_error = HALF_ULP * (0.5 * t * abs(y - t) + abs(f)) + half * relative * of_f
    z = fma(-alpha, slowed, 2.0 * t - y)
    z_error = HALF_ULP * (abs(2.0 * t - y) + abs(z)) + alpha * relative * of_z
    then, lost = half * (at_first - dropped), half * dropped
    of_x, of_z, of_lost = alpha * of_x, alpha * of_z, half * of_lost
    return Along(f, f_error, z, z_error, alpha * by_x, then, lost, of_x, of_z, of_lost)


@implements(bases.jacobian, *ANY)
def jacobian_moving(fixed: Constants, flight: Flight) -> Jacobian:
    law, s, z = fixed.base.restitution, flight.time, flight.v
    share, q = ratio(law, fixed.e, fixed.scale, z), slope(law, fixed.e, fixed.scale, z)
    q = slope_of(fixed.base.noise, share, q, fixed.draw, z)
    if s == 0.0:  # it lands at once
        return Jacobian(1.0, 0.0, 0.0, -q, 1.0 + slack(law) * abs(q))
    at = along(fixed, flight.x, flight.u, s)
    by_x, by_y = at.by_x / z, s / z
    pull, lost = 2.0 * (1.0 + at.acceleration), 2.0 * at.lost
    # sum of the moduli of all terms; the rounding error of z is relative to the terms of z
    parts = 1.0 + (2.0 * s + abs(flight.u) + 2.0 * at.of_z) / z
    size = 1.0 + parts * (at.of_x + s) / z
    largest = abs(pull) + 2.0 * limits(fixed, 1.0).steep + 2.0
    size += slack(law) * (abs(q) + abs(fixed.draw.slip)) * (largest * size + 4.0 * at.of_lost)
    return Jacobian(1.0 + by_x, by_y, q * (pull * by_x - lost), q * (pull * by_y - 1.0), size)


@implements(bases.fixed_residual, *ANY)
def fixed_residual_moving(
    fixed: Constants, x: float, k: float, sign: float
) -> tuple[float, float, float]:
    a, shape = fixed.alpha * (1.0 + fixed.e), fixed.base.waveform
    need = rise_to_repeat(fixed.base.restitution, fixed.e, fixed.scale, k)
    return a * velocity(shape, x) - need, kick_slope(shape, a, x), a


@implements(bases.fixed_attracts, *ANY)
def fixed_attracts_moving(fixed: Constants, x: float, k: float) -> bool:
    # both multipliers are inside the unit circle
    law = fixed.base.restitution
    c = arrival_to_repeat(law, fixed.e, fixed.scale, k)
    q, e = slope(law, fixed.e, fixed.scale, c), ratio(law, fixed.e, fixed.scale, c)
    s = -kick_slope(fixed.base.waveform, 0.5 * fixed.alpha, x)
    return q * e < 1.0 and 0.0 < s < 2.0 * (1.0 + q * e) / ((1.0 + q) * (1.0 + e))


@implements(bases.fixed_holds, *ANY)
def fixed_holds_moving(fixed: Constants, x: float, k: float) -> bool:
    y = leaving_to_repeat(fixed.base.restitution, fixed.e, fixed.scale, k)
    time, _ = bases.fly(fixed, x, y)
    return abs(time - k) <= AT_LANDING and bases.lift_off(fixed, 0.0, x, y).leaves
