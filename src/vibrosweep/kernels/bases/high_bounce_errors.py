"""Bounds on the errors that an impact on the high-bounce base adds."""

from __future__ import annotations

import numpy as np

from vibrosweep.kernels import noise
from vibrosweep.kernels._jit import fma, implements, jit
from vibrosweep.kernels.bases import Flight, Instant, error_bounds
from vibrosweep.kernels.bases.error_bounds import StateError
from vibrosweep.kernels.bases.high_bounce import Constants
from vibrosweep.kernels.bases.high_bounce_noise import first_lift_error
from vibrosweep.kernels.restitution import ratio, ratio_error, slope_change, straight
from vibrosweep.kernels.rounding import HALF_ULP, KICK_ERROR, REST_ERROR, SMALLEST
from vibrosweep.kernels.waveforms import (
    depth_of,
    kick_bend,
    kick_rounding,
    kick_slope,
    left_out,
    lift_off_error,
    peak_of,
    velocity,
)


@implements(error_bounds.jacobian_error, Constants)
def jacobian_error_high_bounce(
    fixed: Constants, flight: Flight, error: float, spread: StateError
) -> tuple[float, float, float]:
    by_phase = kick_bend(fixed.base.waveform, abs(fixed.a), flight.landing, error)
    change = slope_change(fixed.base.restitution, fixed.e, fixed.scale, flight.v, spread.speed)[1]
    return 0.0, change, by_phase


@implements(error_bounds.launch_error, Constants)
def launch_error_high_bounce(fixed: Constants, x: float, u: float) -> float:
    return KICK_ERROR * u + SMALLEST


@implements(error_bounds.landing_added, Constants)
def landing_added_high_bounce(fixed: Constants, flight: Flight, spread: StateError) -> StateError:
    return StateError(error_bounds.landing_rounding(flight), 0.0)


@implements(error_bounds.rebound_error, Constants)
def rebound_error_high_bounce(
    fixed: Constants, flight: Flight, added: StateError, error: float, spread: StateError
) -> float:
    x, v = flight.landing, flight.v
    law, e, scale = fixed.base.restitution, fixed.e, fixed.scale
    a, shape = fixed.a, fixed.base.waveform
    share, of_base = ratio(law, e, scale, v), velocity(shape, x)
    random, draw = fixed.base.noise, fixed.draw
    kick = a * of_base
    w = fma(noise.slipped(random, share, draw.slip), v, noise.pushed(random, kick, draw.push))
    kicked = abs(kick_slope(shape, a, x)) * added.phase + (HALF_ULP * abs(w) + SMALLEST)
    kicked += ratio_error(law, e, scale, v) * (share * v)
    kicked += kick_rounding(shape, abs(a), of_base)
    kicked += left_out(shape, abs(a), x, error)
    kicked += slope_change(law, e, scale, v, spread.speed)[1] * spread.speed
    kicked += noise.rounding(random, share, v, draw, kick)
    kicked += 2.0 * HALF_ULP * noise.swing(random, a, draw.drive) * abs(of_base)
    clips = not straight(law) and noise.clip_is_doubtful(random, share, draw.slip, spread.speed / v)
    return np.inf if clips or noise.period_is_doubtful(random, x, error) else kicked


@implements(error_bounds.absolute_error, Constants)
def absolute_error_high_bounce(fixed: Constants, x: float, u: float, spread: StateError) -> float:
    return spread.speed


@implements(error_bounds.rest_is_doubtful, Constants)
def rest_is_doubtful_high_bounce(fixed: Constants, x: float, w: float, spread: StateError) -> bool:
    return abs(w - fixed.r) <= spread.speed + REST_ERROR * fixed.r


@implements(error_bounds.liftoff_error, Constants)
def liftoff_error_high_bounce(fixed: Constants) -> StateError:
    shape, a, r = fixed.base.waveform, fixed.a, fixed.r
    most = a * peak_of(shape)
    if abs(most - r) <= KICK_ERROR * most + REST_ERROR * r:
        return StateError(np.inf, np.inf)
    if most < r:  # it is never lifted
        return StateError(0.0, 0.0)
    error = lift_off_error(shape, a, r, fixed.x_lift)
    return StateError(error, REST_ERROR * r if error < np.inf else np.inf)


@implements(error_bounds.random_liftoff_error, Constants)
def random_liftoff_error_high_bounce(
    fixed: Constants, n: float, x: float, error: float, later: Instant
) -> StateError:
    return _random_liftoff(fixed.base.noise, fixed, Instant(n, x), error, later)


@jit
def _random_liftoff(
    random: noise.Noise | None, fixed: Constants, begin: Instant, error: float, later: Instant
) -> StateError:
    if random is None:
        return error_bounds.liftoff_error(fixed)
    return _liftoff(random.drive, random, fixed, begin, error, later)


@jit
def _liftoff(
    on: int | None,
    random: noise.Noise,
    fixed: Constants,
    begin: Instant,
    error: float,
    later: Instant,
) -> StateError:
    n, x = begin
    shape, a, r = fixed.base.waveform, fixed.a, fixed.r
    if on is not None:
        up, down = a * peak_of(shape), a * depth_of(shape)
        most = noise.strongest(random, up, down, fixed.source)
        if abs(most - r) <= 2.0 * KICK_ERROR * most + REST_ERROR * r:
            return StateError(np.inf, np.inf)
        if most < r:
            return StateError(0.0, 0.0)
        return first_lift_error(fixed, n, x, error)
    of_base = velocity(shape, x)
    off = abs(kick_slope(shape, a, x)) * error + left_out(shape, a, x, error)
    off += kick_rounding(shape, a, of_base) + REST_ERROR * r
    if not abs(a * of_base - r) > 2.0 * off:
        return StateError(np.inf, np.inf)
    if a * of_base > r:  # the noise has pushed it down
        return StateError(error, REST_ERROR * r)
    found = error_bounds.liftoff_error(fixed)
    doubtful = later.whole < np.inf and abs(x - later.phase) <= error + found.phase
    return StateError(np.inf, np.inf) if doubtful else found
