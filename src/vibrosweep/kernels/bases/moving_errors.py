"""Derivatives of an impact on the moving base, chords of flights, and bounds on errors."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibrosweep.kernels import bases, noise
from vibrosweep.kernels._jit import fma, generic, implements, jit
from vibrosweep.kernels.arithmetic import (
    COSINE_ERROR,
    HALF_ULP,
    KICK_ERROR,
    LAG_ERROR,
    LAUNCH_ERROR,
    REST_ERROR,
    SINE_ERROR,
    SMALLEST,
    cos_turns,
    sin_and_lag,
    sin_near,
    sin_turns,
)
from vibrosweep.kernels.bases import (
    Flight,
    Instant,
    Jacobian,
    Slopes,
    StateError,
    harmonics,
    moving,
)
from vibrosweep.kernels.bases.harmonics import at_phase, stretch
from vibrosweep.kernels.bases.moving import (
    ANY,
    BORDER,
    SINGLE,
    Moving,
    MovingConstants,
    MovingHarmonics,
    begin_at,
)
from vibrosweep.kernels.noise import noisy_rebound_slope
from vibrosweep.kernels.restitution import (
    arrival_to_repeat,
    is_constant,
    leaving_to_repeat,
    ratio,
    ratio_error,
    rise_to_repeat,
    slack,
    slope,
    slope_change,
)
from vibrosweep.kernels.waveforms import kick_curvature, kick_slope, next_phase, velocity
from vibrosweep.model.shapes import TWO_PI

# --- Bounds of the motion of a base ---------------------------------------------------------------


SURE = 1.0 + 2.0**-30  # factor for the rounding of compared numbers
AT_LIFT_OFF = 2.0**-48  # turns; this near to the phase of lift-off the base counts as falling
UPWARDS = 1.0 + 2.0**-30  # factor for the rounding of extremes of a shape


class MotionLimits(NamedTuple):
    """Bounds of the acceleration G of a base, in units of gravity, and of its velocity."""

    # steep, fall: of |G|, and of -G
    steep: float
    fall: float
    speed: float  # of the velocity, times pi
    angle: float  # of |G'| relative to that of |G|, and so on for each further derivative
    # rounding, slope_rounding: of errors of velocity and G, beyond a few roundings of their values
    rounding: float
    slope_rounding: float


@generic
def limits(fixed: MovingConstants, slack: float) -> MotionLimits:
    """Bound the motion of the base for alpha times the factor `slack`."""


class Bends(NamedTuple):
    """Bounds of changes of the derivatives of a flight, in the notation of `jacobian_moving`.

    They are those of P, of 2 G(x + s), and of 2 (G(x) - G(x + s)).
    """

    of_p: float
    of_pull: float
    of_lost: float


@generic
def bends(fixed: MovingConstants, flight: Flight, dx: float, off: float) -> Bends:
    """Bound changes within dx of the phase of a lift-off and `off` of the duration."""


@generic
def keeps_pressing(fixed: MovingConstants, x: float, pull: float, error: float) -> bool:
    """Return whether a base with 1 + G >= pull at x presses at every phase within an error of x."""


@generic
def below_top(fixed: MovingConstants, x: float, dx: float, slack: float) -> float:
    """Bound of the depth below the top of the base at phases within dx of x.

    The depth is given as pi^2 times the square of the speed with which a particle just reaches the
    top; alpha is enlarged by the factor `slack`.
    """


@generic
def first_stretch(fixed: MovingConstants, x: float) -> tuple[bool, float]:
    """Return whether the base falls faster than gravity at x, and periods until that changes."""


@implements(limits, Moving)
def limits_moving(fixed: MovingConstants, slack: float) -> MotionLimits:
    gamma = math.pi * (fixed.alpha * slack)
    return MotionLimits(gamma, gamma, gamma, TWO_PI, 0.0, 0.0)


@implements(limits, MovingHarmonics)
def limits_harmonics(fixed: MovingConstants, slack: float) -> MotionLimits:
    shape, alpha = fixed.base.waveform, fixed.alpha * slack * UPWARDS
    half = 0.5 * alpha
    return MotionLimits(
        half * shape.steepest,
        half * shape.fall,
        math.pi * alpha * shape.fastest,
        TWO_PI * len(shape.p),
        alpha * shape.rounding,
        half * shape.slope_rounding,
    )


@implements(below_top, Moving)
def below_top_moving(fixed: MovingConstants, x: float, dx: float, slack: float) -> float:
    gamma = math.pi * (fixed.alpha * slack)
    return 2.0 * gamma * (1.0 + cos_turns(x) + TWO_PI * dx + COSINE_ERROR)


@implements(below_top, MovingHarmonics)
def below_top_harmonics(fixed: MovingConstants, x: float, dx: float, slack: float) -> float:
    shape = fixed.base.waveform
    _, _, level = at_phase(shape, sin_turns(x), cos_turns(x))
    below = (shape.top - level) + shape.fastest * UPWARDS * dx + 2.0 * shape.rounding
    return float(4.0 * math.pi * math.pi * (fixed.alpha * slack) * below)


@implements(bends, Moving, MovingHarmonics)
def bends_smooth(fixed: MovingConstants, flight: Flight, dx: float, off: float) -> Bends:
    limit = limits(fixed, 1.0)
    gamma, angle = limit.steep, limit.angle
    q = angle * (flight.time + off)
    turns = min(2.0, q)
    return Bends(
        2.0 * gamma * (turns * off + min(q + turns, 0.5 * q * q) * dx),
        2.0 * angle * gamma * (dx + off),
        2.0 * angle * gamma * (off + turns * dx),
    )


@implements(keeps_pressing, Moving, MovingHarmonics)
def keeps_pressing_smooth(fixed: MovingConstants, x: float, pull: float, error: float) -> bool:
    limit = limits(fixed, 1.0)
    return 2.0 * limit.angle * limit.steep * SURE * error <= pull


@implements(first_stretch, *SINGLE)
def first_stretch_moving(fixed: MovingConstants, x: float) -> tuple[bool, float]:
    falls = abs(x) >= fixed.x_lift
    to_press = (1.0 if x > 0.0 else 0.0) - fixed.x_lift - x
    return falls, to_press if falls else fixed.x_lift - x


@implements(first_stretch, MovingHarmonics)
def first_stretch_harmonics(fixed: MovingConstants, x: float) -> tuple[bool, float]:
    _, to_fall, to_press = stretch(fixed, x)
    falls = to_press < to_fall or to_fall <= AT_LIFT_OFF
    return falls, to_press if falls else to_fall


# --- The Jacobian of an impact, and orbits that land every k periods ------------------------------
# The flight from phase x with relative speed y lasts s and arrives with the speed z.  With the
# velocity w of the base in units of alpha and its acceleration G = alpha w' / 2 in units of gravity
#
#     ds = (P dx + s dy) / z,     P = alpha (w(x) + s w'(x) - w(x + s))
#     dz = 2 (1 + G(x + s)) ds + 2 (G(x + s) - G(x)) dx - dy
#
# The determinant of (dx + ds, dz) is y / z.  For a sine, with q = 2 pi s, P is alpha (cos(2 pi x)
# (q - sin q) + sin(2 pi x) (1 - cos q)), in which nothing cancels; for harmonics it is a sum of
# such terms.
#
# An orbit that lands every k periods meets the base with the relative speed c, where c + E(c) = 2
# k, at a phase x at which the base rises with c - k.  With the slope q of E at c and e = E(c) / c,
# its multipliers are the roots of z^2 - (1 + q e + (1 + q)(1 + e) G) z + q e.


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
def along(fixed: MovingConstants, x: float, y: float, t: float) -> Along:
    """State of a flight from phase x with relative speed y after t periods."""


@implements(along, Moving)
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


@implements(along, MovingHarmonics)
def along_harmonics(fixed: MovingConstants, x: float, y: float, t: float) -> Along:
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
def jacobian_moving(fixed: MovingConstants, flight: Flight) -> Jacobian:
    law, s, z = fixed.base.restitution, flight.time, flight.v
    share, q = ratio(law, fixed.e, fixed.scale, z), slope(law, fixed.e, fixed.scale, z)
    q = noisy_rebound_slope(fixed.base.noise, share, q, fixed.draw, z)
    if s == 0.0:  # it lands at once
        return Jacobian(1.0, 0.0, 0.0, -q, 1.0 + slack(law) * abs(q))
    at = along(fixed, flight.x, flight.u, s)
    by_x, by_y = at.by_x / z, s / z
    pull, lost = 2.0 * (1.0 + at.acceleration), 2.0 * at.lost
    # sum of the moduli of all terms; the rounding error of z is relative to the terms of z
    parts = 1.0 + (2.0 * s + abs(flight.u) + 2.0 * at.of_z) / z
    size = 1.0 + parts * (at.of_x + s) / z
    largest = abs(pull) + 2.0 * limits(fixed, 1.0).steep + 2.0
    size += (
        slack(law) * (abs(q) + abs(fixed.draw.restitution)) * (largest * size + 4.0 * at.of_lost)
    )
    return Jacobian(1.0 + by_x, by_y, q * (pull * by_x - lost), q * (pull * by_y - 1.0), size)


@implements(bases.fixed_residual, *ANY)
def fixed_residual_moving(
    fixed: MovingConstants, x: float, k: float, sign: float
) -> tuple[float, float, float]:
    a, shape = fixed.alpha * (1.0 + fixed.e), fixed.base.waveform
    need = rise_to_repeat(fixed.base.restitution, fixed.e, fixed.scale, k)
    return a * velocity(shape, x) - need, kick_slope(shape, a, x), a


@implements(bases.fixed_attracts, *ANY)
def fixed_attracts_moving(fixed: MovingConstants, x: float, k: float) -> bool:
    # both multipliers are inside the unit circle
    law = fixed.base.restitution
    c = arrival_to_repeat(law, fixed.e, fixed.scale, k)
    q, e = slope(law, fixed.e, fixed.scale, c), ratio(law, fixed.e, fixed.scale, c)
    s = -kick_slope(fixed.base.waveform, 0.5 * fixed.alpha, x)
    return q * e < 1.0 and 0.0 < s < 2.0 * (1.0 + q * e) / ((1.0 + q) * (1.0 + e))


@implements(bases.fixed_holds, *ANY)
def fixed_holds_moving(fixed: MovingConstants, x: float, k: float) -> bool:
    y = leaving_to_repeat(fixed.base.restitution, fixed.e, fixed.scale, k)
    time, _ = bases.fly(fixed, x, y)
    return abs(time - k) <= AT_LANDING and bases.lift_off(fixed, 0.0, x, y).leaves


# --- Flights between two given instants -----------------------------------------------------------


HALVINGS = 30  # the error of a minimum is of the order of the square of the last interval


@generic
def height(fixed: MovingConstants, x: float, y: float, s: float) -> tuple[float, float]:
    """Height above a base that moves, and its derivative, s periods after leaving it."""


@implements(height, Moving)
def height_moving(fixed: MovingConstants, x: float, y: float, s: float) -> tuple[float, float]:
    clear = moving.clearance(fixed, begin_at(x, y), s, *moving.turn(s))
    return clear.f, clear.f1


@implements(height, MovingHarmonics)
def height_harmonics(fixed: MovingConstants, x: float, y: float, s: float) -> tuple[float, float]:
    clear = harmonics.clearance(fixed, begin_at(x, y), s, *harmonics.turn(s))
    return clear.f, clear.f1


@implements(bases.chord, *ANY)
def chord_moving(fixed: MovingConstants, x: float, s: float) -> tuple[float, float]:
    # the height is linear in the speed of lift-off: s y / 2 is added to that of y = 0
    f, f1 = height(fixed, x, 0.0, s)
    y = -2.0 * f / s
    return y, -2.0 * f1 - y


@implements(bases.slopes, *ANY)
def slopes_moving(fixed: MovingConstants, arc: Flight) -> Slopes:
    # as in `jacobian_moving`, without its divisions by the speed of arrival
    s, z = arc.time, arc.v
    q, at = slope(fixed.base.restitution, fixed.e, fixed.scale, z), along(fixed, arc.x, arc.u, s)
    pull, lost = 2.0 * (1.0 + at.acceleration), 2.0 * at.lost
    ux, uu = q * (pull * at.by_x - lost * z), q * (pull * s - z)
    return Slopes(z, z + at.by_x, s, ux, uu, q * arc.u)


@jit
def _least(fixed: MovingConstants, arc: Flight, fall: float, length: float) -> float:
    """Least local minimum in the stretches of a flight in which the base falls faster than gravity.

    They begin at phase `fall`, NaN if there are none.  The height is convex there and concave
    elsewhere: each has one minimum or none, and so has no other time.  Where a flight begins or
    ends in a stretch, it rises from the base or falls onto it, without a minimum.
    """
    least, low = np.inf, fall - arc.x
    low -= np.floor(low)  # unlike math.floor, of NaN too
    while low + length < arc.time:
        first, last = low, low + length
        if height(fixed, arc.x, arc.u, first)[1] < 0.0 < height(fixed, arc.x, arc.u, last)[1]:
            for _ in range(HALVINGS):
                middle = 0.5 * (first + last)
                if height(fixed, arc.x, arc.u, middle)[1] > 0.0:
                    last = middle
                else:
                    first = middle
            least = min(least, height(fixed, arc.x, arc.u, first)[0])
        low += 1.0
    return least


@implements(bases.clearing, *SINGLE)
def clearing_single(fixed: MovingConstants, arc: Flight) -> float:
    return _least(fixed, arc, fixed.x_lift, 1.0 - 2.0 * fixed.x_lift)


@implements(bases.clearing, MovingHarmonics)
def clearing_harmonics(fixed: MovingConstants, arc: Flight) -> float:
    least = np.inf
    for k in range(len(fixed.x_lift.falls)):
        press, passed = next_phase(fixed.x_lift.presses, fixed.x_lift.falls[k])
        least = min(
            least, _least(fixed, arc, fixed.x_lift.falls[k], press - fixed.x_lift.falls[k] + passed)
        )
    return least


# --- Bounds on errors -----------------------------------------------------------------------------
# Gamma is a bound of |G|.  The errors have four sources:
#
# - The duration s.  F is evaluated at s, with a bound of its rounding.  As |F''| <= 1 + Gamma, F
#   has a root within about |F| / |F'| of s if |F| is small against F'^2 (Kantorovich's condition
#   for Newton's iteration).  A graze fails this condition.
# - alpha, which has the roundings of the kick and two more; they count as errors of F and of z.
# - The nonlinear remainder: the change of the Jacobian within the error, by the mean value theorem.
#   For N harmonics |G'| <= 2 pi N Gamma by Bernstein's inequality, and so on for higher
#   derivatives.
# - The choice of the root.  Steps in time that pass no root of any state within the error must
#   reach the interval in which F decreases to the root.
#
# The bound is infinite if a proof fails.


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
def _landed(fixed: MovingConstants, flight: Flight, at: Along) -> Landed:
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
    fixed: MovingConstants, flight: Flight, landed: Landed, spread: StateError
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
    few = 2.0**-20  # for derivatives that happen to be zero
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
def _start(fixed: MovingConstants, flight: Flight, spread: StateError, last: float) -> float:
    """Return a time early in the flight before which no state in a spread lands; or NaN."""
    y = max(0.0, flight.u - spread.speed)
    least = 0.5 * y / (1.0 + limits(fixed, 1.0).steep)
    edge = spread.phase + bases.liftoff_error(fixed).phase + 2.0 * HALF_ULP
    falls, ahead = first_stretch(fixed, flight.x)
    if falls:  # F is convex, and increases, until the base presses again
        return max(least, ahead - edge)
    until = min(ahead - edge, last)
    if not until > least:
        return least
    # F is concave until then
    return until if _lowest(fixed, flight, spread, until)[0] > 0.0 and y > 0.0 else np.nan


@jit
def _lowest(
    fixed: MovingConstants, flight: Flight, spread: StateError, t: float
) -> tuple[float, float]:
    """Lower bounds of F and F' after t periods, of all states in a spread."""
    at, (dx, dy) = along(fixed, flight.x, flight.u, t), spread
    f = at.f - SURE * (at.f_error + 0.5 * (t * dy + at.of_x * dx))
    return f, -0.5 * (at.z + SURE * (at.z_error + dy + 4.0 * limits(fixed, 1.0).steep * dx))


@jit
def _above(fixed: MovingConstants, flight: Flight, spread: StateError) -> tuple[bool, float, float]:
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
def _never_falls(fixed: MovingConstants, error: float) -> bool:
    """Return whether the base certainly never falls faster than gravity; `error` is relative."""
    limit = limits(fixed, 1.0)
    return limit.fall * (1.0 + error) + limit.slope_rounding <= 1.0


@jit
def _is_first(fixed: MovingConstants, flight: Flight, spread: StateError, last: float) -> bool:
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
def _pressed(fixed: MovingConstants, flight: Flight, spread: StateError) -> StateError:
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


@implements(bases.landing_added, *ANY)
def landing_added_moving(fixed: MovingConstants, flight: Flight, spread: StateError) -> StateError:
    if flight.time == 0.0:
        return _pressed(fixed, flight, spread)
    at = along(fixed, flight.x, flight.u, flight.time)
    landed = _landed(fixed, flight, at)
    change, off, least = _change(fixed, flight, landed, spread)
    # z changes by 2 (1 + Gamma) in a period at most: since `last`, F has been falling
    last = flight.time - off - 0.4 * least / (1.0 + limits(fixed, 1.0).steep)
    if not (off < np.inf and _is_first(fixed, flight, spread, last)):
        return StateError(np.inf, np.inf)
    rounding, (dx, dy) = landed.time + bases.landing_rounding(flight), spread
    by_phase, by_speed = change.s_x * dx + change.s_y * dy, change.z_x * dx + change.z_y * dy
    return StateError(rounding + by_phase, landed.v + by_speed)


@implements(bases.rebound_error, *ANY)
def rebound_error_moving(
    fixed: MovingConstants, flight: Flight, added: StateError, error: float, spread: StateError
) -> float:
    law, e, scale, z = fixed.base.restitution, fixed.e, fixed.scale, flight.v
    share, (random, draw) = ratio(law, e, scale, z), (fixed.base.noise, fixed.draw)
    left, of_noise = (
        noise.noisy_restitution(random, share, draw.restitution),
        noise.rounding(random, share, z, draw),
    )
    if is_constant(law) or share == 0.0:
        error = left * (added.speed + HALF_ULP * abs(z)) + SMALLEST + of_noise
        return _unless_turned(random, fixed, flight, spread, error)
    q = noise.noisy_slope(random, share, slope(law, e, scale, z), draw.restitution)
    _, _, by_x, by_y, _ = bases.jacobian(fixed, flight)
    linear = SURE * (abs(by_x) * spread.phase + abs(by_y) * spread.speed) / abs(q)
    _, change = slope_change(law, e, scale, z, linear + added.speed)
    rounding = (HALF_ULP + ratio_error(law, e, scale, z)) * share * abs(z)
    error = (abs(q) + change) * added.speed + change * linear + rounding + SMALLEST + of_noise
    if noise.clip_is_doubtful(random, share, draw.restitution, (linear + added.speed) / abs(z)):
        return np.inf
    return _unless_turned(random, fixed, flight, spread, error)


@jit
def _unless_turned(
    random: noise.Noise | None,
    fixed: MovingConstants,
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
    w = noise.noisy_restitution(random, share, fixed.draw.restitution) * flight.v + fixed.draw.kick
    return error if abs(w) > 2.0 * every else np.inf


@implements(bases.jacobian_error, *ANY)
def jacobian_error_moving(
    fixed: MovingConstants, flight: Flight, error: float, spread: StateError
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


@implements(bases.launch_error, *ANY)
def launch_error_moving(fixed: MovingConstants, x: float, u: float) -> float:
    base, limit = fixed.alpha * abs(velocity(fixed.base.waveform, x)), limits(fixed, 1.0)
    error = KICK_ERROR * (abs(u) + base) + (SINE_ERROR + ALPHA_ERROR + HALF_ULP) * base
    error += HALF_ULP * abs(u) + 2.0 * limit.steep * LAUNCH_ERROR + SMALLEST + limit.rounding
    # within its error it may fly or land at once; where the base presses, both are nearly the same
    presses = 1.0 + kick_slope(fixed.base.waveform, 0.5 * fixed.alpha, x) > limit.slope_rounding
    return error if abs(u) > error or presses else np.inf


@implements(bases.absolute_error, *ANY)
def absolute_error_moving(fixed: MovingConstants, x: float, u: float, spread: StateError) -> float:
    base, limit = fixed.alpha * abs(velocity(fixed.base.waveform, x)), limits(fixed, 1.0)
    rounding = (SINE_ERROR + ALPHA_ERROR + HALF_ULP) * base + HALF_ULP * (abs(u) + base)
    error: float = (
        spread.speed + 2.0 * limit.steep * SURE * spread.phase + rounding + limit.rounding
    )
    return error


@implements(bases.rest_is_doubtful, *SINGLE)
def rest_is_doubtful_moving(fixed: MovingConstants, x: float, w: float, spread: StateError) -> bool:
    w_error = spread.speed + REST_ERROR * fixed.r
    if w - fixed.r > w_error:
        return False
    edge = spread.phase + bases.liftoff_error(fixed).phase
    if abs(x) - fixed.x_lift > edge:  # it leaves whatever its speed
        return False
    within = not abs(x) + edge >= fixed.x_lift
    return not (within and fixed.r - w > w_error)


@implements(bases.liftoff_error, Moving)
def liftoff_error_moving(fixed: MovingConstants) -> StateError:
    gamma = math.pi * fixed.alpha
    if gamma * (1.0 + 2.0 * GAMMA_ERROR) <= 1.0:  # it is never lifted
        return StateError(0.0, 0.0)
    if gamma - 1.0 <= 8.0 * GAMMA_ERROR:
        return StateError(np.inf, np.inf)
    slope = TWO_PI * math.sqrt((gamma - 1.0) * (gamma + 1.0))  # of ln(Gamma) by x_lift
    return StateError(2.0 * GAMMA_ERROR / slope + ARCSINE_ERROR, 0.0)


@implements(bases.liftoff_error_after, *ANY)
def liftoff_error_after_moving(
    fixed: MovingConstants, n: float, x: float, error: float, later: Instant
) -> StateError:
    return bases.unless_doubtful(bases.liftoff_error(fixed), x, error, later)


# --- Rests on a base that moves as a sum of harmonics ---------------------------------------------


@jit
def _nearest_end(fixed: MovingConstants, x: float) -> float:
    """Periods between phase x and the nearest end of a stretch in which the base presses."""
    nearest = np.inf
    for k in range(len(fixed.x_lift.falls)):
        for end in (fixed.x_lift.falls[k], fixed.x_lift.presses[k]):
            apart = abs(x - end)
            apart = min(apart, 1.0 - apart)
            nearest = apart if apart < nearest else nearest
    return nearest


@implements(bases.rest_is_doubtful, MovingHarmonics)
def rest_is_doubtful_harmonics(
    fixed: MovingConstants, x: float, w: float, spread: StateError
) -> bool:
    w_error = spread.speed + REST_ERROR * fixed.r
    if w - fixed.r > w_error:
        return False
    edge = spread.phase + bases.liftoff_error(fixed).phase
    if _nearest_end(fixed, x) <= edge + 2.0 * BORDER:
        return True
    presses, _, _ = stretch(fixed, x)
    return not edge < np.inf or (presses and not fixed.r - w > w_error)


@implements(bases.liftoff_error, MovingHarmonics)
def liftoff_error_harmonics(fixed: MovingConstants) -> StateError:
    shape, half, limit = fixed.base.waveform, 0.5 * fixed.alpha, limits(fixed, 1.0)
    off = 4.0 * GAMMA_ERROR * (1.0 + limit.steep) + 2.0 * limit.slope_rounding
    if limit.fall + off <= 1.0:  # it is never lifted
        return StateError(0.0, 0.0)
    jolt = limit.angle * limit.angle * limit.steep  # of |G''|
    worst = 0.0
    for k in range(len(fixed.x_lift.falls)):
        for x in (shape.dip[k], shape.before[k], shape.after[k]):
            if abs(1.0 + kick_slope(shape, half, x - np.rint(x))) <= off:
                return StateError(np.inf, np.inf)
        x = fixed.x_lift.falls[k]
        if x == x:
            wrong = abs(1.0 + kick_slope(shape, half, x)) + off
            slope = abs(kick_curvature(shape, half, x)) - limit.angle * limit.slope_rounding
            # Kantorovich's condition for Newton's method
            if not (slope > 0.0 and wrong * jolt <= 0.25 * slope * slope):
                return StateError(np.inf, np.inf)
            worst = max(worst, 2.0 * wrong / slope + HALF_ULP)
    return StateError(worst, 0.0)
