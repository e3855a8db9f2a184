"""Bounds on the errors that an impact on the moving base adds.

The notation is that of `vibrosweep.kernels.bases.moving_jacobian`; Gamma is a bound of |G|.  The
errors have four sources:

- The duration s.  F is evaluated at s, with a bound of its rounding.  As |F''| <= 1 + Gamma, F has
  a root within about |F| / |F'| of s if |F| is small against F'^2 (Kantorovich's condition for
  Newton's iteration).  A graze fails this condition.
- alpha, which has the roundings of the kick and two more; they count as errors of F and of z.
- The nonlinear remainder: the change of the Jacobian within the error, by the mean value theorem.
  For N harmonics |G'| <= 2 pi N Gamma by Bernstein's inequality, and so on for higher derivatives.
- The choice of the root.  Steps in time that pass no root of any state within the error must reach
  the interval in which F decreases to the root.

The bound is infinite if a proof fails.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibrosweep.kernels import bases, noise
from vibrosweep.kernels._jit import implements, jit
from vibrosweep.kernels.bases import Constants, Flight, Instant, error_bounds
from vibrosweep.kernels.bases.error_bounds import StateError
from vibrosweep.kernels.bases.moving import ANY, SINGLE, MovingConstants
from vibrosweep.kernels.bases.moving_jacobian import ALPHA_ERROR, GAMMA_ERROR, Along, along
from vibrosweep.kernels.bases.moving_limits import (
    SURE,
    below_top,
    bends,
    first_stretch,
    keeps_pressing,
    limits,
)
from vibrosweep.kernels.restitution import ratio, ratio_error, slope, slope_change, straight
from vibrosweep.kernels.rounding import HALF_ULP, KICK_ERROR, LAUNCH_ERROR, REST_ERROR, SMALLEST
from vibrosweep.kernels.sine import SINE_ERROR
from vibrosweep.kernels.waveforms import kick_slope, velocity
from vibrosweep.model.shapes import TWO_PI

# Absolute error of x_lift: the root, the arcsine of at most 1 / sqrt(2), and the difference
ARCSINE_ERROR = 4.0 * HALF_ULP
MARCH = 1000  # steps


class Landed(NamedTuple):
    """Bounds on the errors of the duration and of the speed of arrival, for an exact lift-off."""

    time: float
    v: float


class Change(NamedTuple):
    """Bounds of the change of the derivatives of s and z by x and y, over a spread of states."""

    s_x: float
    s_y: float
    z_x: float
    z_y: float


@jit
def _landed(fixed: Constants, flight: Flight, at: Along) -> Landed:
    """Bound the errors of a landing; `at` is the flight after its computed duration."""
    gamma = limits(fixed, 1.0).steep
    off, z = abs(at.f) + at.f_error, at.z - at.z_error
    kappa = 8.0 * (1.0 + gamma) * SURE * off / (z * z)
    if not (z > 0.0 and kappa <= 0.25):
        return Landed(np.inf, np.inf)
    time = 2.0 * off / z * (1.0 + kappa)
    return Landed(time, abs(flight.v - at.z) + at.z_error + 2.0 * (1.0 + gamma) * SURE * time)


@jit
def _change(
    fixed: Constants, flight: Flight, landed: Landed, spread: StateError
) -> tuple[Change, float, float]:
    """Bound how much the derivatives change over a spread of states.

    Returns also the change of the duration, and the least speed of arrival.

    Within twice the linear changes of s and z, the derivatives are bounded; if by these bounds s
    and z change by less than that, they never leave it.
    """
    dx, dy = spread
    s, z = flight.time, flight.v
    at = along(fixed, flight.x, flight.u, s)
    pull = 2.0 * abs(1.0 + at.acceleration)
    s_x = abs(at.by_x) / z
    s_y = s / z
    z_x = pull * s_x + 2.0 * abs(at.lost)
    z_y = pull * s_y + 1.0
    few = 2.0**-20  # for derivatives that are zero by chance
    ds = 2.0 * ((s_x + few) * dx + (s_y + few) * dy)
    dz = 2.0 * ((z_x + few) * dx + (z_y + few) * dy)
    off, z_off = ds + landed.time, dz + landed.v
    least = z - z_off
    of_p, of_pull, of_lost = bends(fixed, flight, dx, off)
    by_x = (of_p + s_x * z_off) / least
    by_y = (off + s_y * z_off) / least
    change = Change(
        by_x,
        by_y,
        pull * by_x + of_pull * (s_x + by_x) + of_lost,
        pull * by_y + of_pull * (s_y + by_y),
    )
    stays = (s_x + by_x) * dx + (s_y + by_y) * dy <= ds
    stays = stays and (z_x + change.z_x) * dx + (z_y + change.z_y) * dy <= dz
    if not (least > 0.0 and stays):
        return Change(np.inf, np.inf, np.inf, np.inf), np.inf, 0.0
    return change, off, least


@jit
def _start(fixed: Constants, flight: Flight, spread: StateError, last: float) -> float:
    """Return a time early in the flight before which no state in a spread lands; or NaN."""
    y = max(0.0, flight.u - spread.speed)
    least = 0.5 * y / (1.0 + limits(fixed, 1.0).steep)
    edge = spread.phase + error_bounds.liftoff_error(fixed).phase + 2.0 * HALF_ULP
    falls, ahead = first_stretch(fixed, flight.x)
    if falls:  # F is convex, and increases, until the base presses again
        return max(least, ahead - edge)
    until = min(ahead - edge, last)
    if not until > least:
        return least
    # F is concave until then
    return until if _lowest(fixed, flight, spread, until)[0] > 0.0 and y > 0.0 else np.nan


@jit
def _lowest(fixed: Constants, flight: Flight, spread: StateError, t: float) -> tuple[float, float]:
    """Lower bounds of F and F' after t periods, of all states in a spread."""
    at, (dx, dy) = along(fixed, flight.x, flight.u, t), spread
    f = at.f - SURE * (at.f_error + 0.5 * (t * dy + at.of_x * dx))
    return f, -0.5 * (at.z + SURE * (at.z_error + dy + 4.0 * limits(fixed, 1.0).steep * dx))


@jit
def _above(fixed: Constants, flight: Flight, spread: StateError) -> tuple[bool, float, float]:
    """Return whether all states land faster than the base moves, and when all are above its top."""
    alpha, most, (dx, dy) = fixed.alpha * SURE, limits(fixed, SURE), spread
    u = flight.u + fixed.alpha * velocity(fixed.base.waveform, flight.x)
    u_off = dy + 2.0 * most.steep * dx + 8.0 * HALF_ULP * (abs(flight.u) + alpha)
    u_off += most.rounding
    u_low = u - u_off
    rise = below_top(fixed, flight.x, dx, SURE) * SURE
    square = math.pi * math.pi * u_low * u_low - rise
    if not (u_low > 0.0 and square > 0.0):
        return False, np.inf, -np.inf
    root = math.sqrt(square) / (math.pi * SURE)
    return (
        square >= most.speed * most.speed * SURE,
        0.5 * (u + u_off - root) * SURE,
        0.5 * (u_low + root),
    )


@jit
def _never_falls(fixed: Constants, error: float) -> bool:
    """Return whether the base certainly never falls faster than gravity; `error` is relative."""
    limit = limits(fixed, 1.0)
    return limit.fall * (1.0 + error) + limit.slope_rounding <= 1.0


@jit
def _is_first(fixed: Constants, flight: Flight, spread: StateError, last: float) -> bool:
    """Return whether no state in a spread has landed before the time `last`."""
    if _never_falls(fixed, GAMMA_ERROR):  # F is concave
        return flight.u > spread.speed
    fast, begin, end = _above(fixed, flight, spread)
    if fast:
        return True
    curvature = (1.0 + limits(fixed, 1.0).steep) * SURE
    t = _start(fixed, flight, spread, last)
    for _ in range(MARCH):
        t = end / SURE if begin <= t < end / SURE else t
        if t >= last:
            return True
        f, f1 = _lowest(fixed, flight, spread, t)
        if not f > 0.0:
            return False
        root = math.sqrt(f1 * f1 + 2.0 * curvature * f)
        t += (2.0 * f / (root - f1) if f1 < 0.0 else (f1 + root) / curvature) / SURE
    return False


@jit
def _pressed(fixed: Constants, flight: Flight, spread: StateError) -> StateError:
    """Return `landing_added` for a particle that lands at once, or after a very short flight."""
    dx, dy = spread
    if flight.u < -dy:
        return StateError(0.0, 0.0)
    most, limit = abs(flight.u) + dy, limits(fixed, 1.0)
    gamma = limit.steep
    pull = 1.0 + kick_slope(fixed.base.waveform, 0.5 * fixed.alpha, flight.x)
    pull -= 8.0 * HALF_ULP * (1.0 + gamma) + limit.slope_rounding
    time = 2.0 * most / pull
    if not (pull > 0.0 and keeps_pressing(fixed, flight.x, pull, time + dx)):
        return StateError(np.inf, np.inf)
    return StateError(time, 2.0 * most + 2.0 * (1.0 + gamma) * time)


@implements(error_bounds.landing_added, *ANY)
def landing_added_moving(fixed: Constants, flight: Flight, spread: StateError) -> StateError:
    if flight.time == 0.0:
        return _pressed(fixed, flight, spread)
    at = along(fixed, flight.x, flight.u, flight.time)
    landed = _landed(fixed, flight, at)
    change, off, least = _change(fixed, flight, landed, spread)
    # z changes by 2 (1 + Gamma) in a period at most: since `last`, F has been falling
    last = flight.time - off - 0.4 * least / (1.0 + limits(fixed, 1.0).steep)
    if not (off < np.inf and _is_first(fixed, flight, spread, last)):
        return StateError(np.inf, np.inf)
    rounding, (dx, dy) = landed.time + error_bounds.landing_rounding(flight), spread
    by_phase, by_speed = change.s_x * dx + change.s_y * dy, change.z_x * dx + change.z_y * dy
    return StateError(rounding + by_phase, landed.v + by_speed)


@implements(error_bounds.rebound_error, *ANY)
def rebound_error_moving(
    fixed: Constants, flight: Flight, added: StateError, error: float, spread: StateError
) -> float:
    law, e, scale, z = fixed.base.restitution, fixed.e, fixed.scale, flight.v
    share, (random, draw) = ratio(law, e, scale, z), (fixed.base.noise, fixed.draw)
    left, of_noise = noise.slipped(random, share, draw.slip), noise.rounding(random, share, z, draw)
    if straight(law) or share == 0.0:
        error = left * (added.speed + HALF_ULP * abs(z)) + SMALLEST + of_noise
        return _unless_turned(random, fixed, flight, spread, error)
    q = noise.slipped_slope(random, share, slope(law, e, scale, z), draw.slip)
    _, _, by_x, by_y, _ = bases.jacobian(fixed, flight)
    linear = SURE * (abs(by_x) * spread.phase + abs(by_y) * spread.speed) / abs(q)
    _, change = slope_change(law, e, scale, z, linear + added.speed)
    rounding = (HALF_ULP + ratio_error(law, e, scale, z)) * share * abs(z)
    error = (abs(q) + change) * added.speed + change * linear + rounding + SMALLEST + of_noise
    if noise.clip_is_doubtful(random, share, draw.slip, (linear + added.speed) / abs(z)):
        return np.inf
    return _unless_turned(random, fixed, flight, spread, error)


@jit
def _unless_turned(
    random: noise.Noise | None,
    fixed: Constants,
    flight: Flight,
    spread: StateError,
    error: float,
) -> float:
    """Return the error, or infinity if it decides whether noise reverses a rebound."""
    if random is None:
        return error
    _, _, by_x, by_y, _ = bases.jacobian(fixed, flight)
    every = error + SURE * (abs(by_x) * spread.phase + abs(by_y) * spread.speed)
    share = ratio(fixed.base.restitution, fixed.e, fixed.scale, flight.v)
    w = noise.slipped(random, share, fixed.draw.slip) * flight.v + fixed.draw.push
    return error if abs(w) > 2.0 * every else np.inf


@implements(error_bounds.jacobian_error, *ANY)
def jacobian_error_moving(
    fixed: Constants, flight: Flight, error: float, spread: StateError
) -> tuple[float, float, float]:
    if flight.time == 0.0:
        return 0.0, 0.0, 0.0
    landed = _landed(fixed, flight, along(fixed, flight.x, flight.u, flight.time))
    derivatives, _, least = _change(fixed, flight, landed, spread)
    law = fixed.base.restitution
    q, change = slope_change(law, fixed.e, fixed.scale, flight.v, flight.v - least)
    u_x, u_y = q * derivatives.z_x, q * derivatives.z_y
    if change > 0.0:
        _, _, by_x, by_y, _ = bases.jacobian(fixed, flight)
        u_x += change * (derivatives.z_x + abs(by_x) / q)
        u_y += change * (derivatives.z_y + abs(by_y) / q)
    return max(derivatives.s_x, u_x), max(derivatives.s_y, u_y), 0.0


@implements(error_bounds.launch_error, *ANY)
def launch_error_moving(fixed: Constants, x: float, u: float) -> float:
    base, limit = fixed.alpha * abs(velocity(fixed.base.waveform, x)), limits(fixed, 1.0)
    error = KICK_ERROR * (abs(u) + base) + (SINE_ERROR + ALPHA_ERROR + HALF_ULP) * base
    error += HALF_ULP * abs(u) + 2.0 * limit.steep * LAUNCH_ERROR + SMALLEST + limit.rounding
    # within its error it may fly or land at once; where the base presses, both are nearly the same
    presses = 1.0 + kick_slope(fixed.base.waveform, 0.5 * fixed.alpha, x) > limit.slope_rounding
    return error if abs(u) > error or presses else np.inf


@implements(error_bounds.absolute_error, *ANY)
def absolute_error_moving(fixed: Constants, x: float, u: float, spread: StateError) -> float:
    base, limit = fixed.alpha * abs(velocity(fixed.base.waveform, x)), limits(fixed, 1.0)
    rounding = (SINE_ERROR + ALPHA_ERROR + HALF_ULP) * base + HALF_ULP * (abs(u) + base)
    error: float = (
        spread.speed + 2.0 * limit.steep * SURE * spread.phase + rounding + limit.rounding
    )
    return error


@implements(error_bounds.rest_is_doubtful, *SINGLE)
def rest_is_doubtful_moving(fixed: MovingConstants, x: float, w: float, spread: StateError) -> bool:
    w_error = spread.speed + REST_ERROR * fixed.r
    if w - fixed.r > w_error:
        return False
    edge = spread.phase + error_bounds.liftoff_error(fixed).phase
    if abs(x) - fixed.x_lift > edge:  # it leaves whatever its speed
        return False
    within = not abs(x) + edge >= fixed.x_lift
    return not (within and fixed.r - w > w_error)


@implements(error_bounds.liftoff_error, MovingConstants)
def liftoff_error_moving(fixed: MovingConstants) -> StateError:
    gamma = math.pi * fixed.alpha
    if gamma * (1.0 + 2.0 * GAMMA_ERROR) <= 1.0:  # it is never lifted
        return StateError(0.0, 0.0)
    if gamma - 1.0 <= 8.0 * GAMMA_ERROR:
        return StateError(np.inf, np.inf)
    slope = TWO_PI * math.sqrt((gamma - 1.0) * (gamma + 1.0))  # of ln(Gamma) by x_lift
    return StateError(2.0 * GAMMA_ERROR / slope + ARCSINE_ERROR, 0.0)


@implements(error_bounds.random_liftoff_error, *ANY)
def random_liftoff_error_moving(
    fixed: Constants, n: float, x: float, error: float, later: Instant
) -> StateError:
    found = error_bounds.liftoff_error(fixed)
    doubtful = later.whole < np.inf and abs(x - later.phase) <= error + found.phase
    return StateError(np.inf, np.inf) if doubtful else found
