"""The base with the velocity alpha w(x), where w is the triangle: its height consists of parabolas.

Its acceleration in units of gravity, G, is 2 alpha in the half period around phase 0 and -2 alpha
in the other.  In each half, called a stretch, the clearance is a parabola, and the landing is the
first root of a sequence of quadratic equations:

    F(t + s) = F(t) + F'(t) s - (1 + G) s^2 / 2

F and F' are computed from the beginning of the flight, F(t) = t (y - t) / 2 - (alpha / 2)
(W(x + t) - W(x) - t w(x)), in which nothing cancels while t is small.  In the vector kernel a pass
solves one of the equations in each lane.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibrosweep.kernels import bases
from vibrosweep.kernels._jit import Floats, fma, implements, jit, wide_vectors
from vibrosweep.kernels.arithmetic import HALF_ULP
from vibrosweep.kernels.bases import Counted, Flight, StateError, moving, moving_errors
from vibrosweep.kernels.bases.moving import MovingConstants, MovingParabolic
from vibrosweep.kernels.bases.moving_errors import Along, Bends, MotionLimits
from vibrosweep.kernels.memory import ROW, STRIDE
from vibrosweep.kernels.waveforms import Parabolic, velocity
from vibrosweep.model.parameters import Dimensionless

TOP = 0.125  # largest height W; the lowest is its negative
CORNER = 0.25  # phase at which the acceleration turns downwards; upwards at its negative


class ParabolicGuess(NamedTuple):
    """A guess of the landing, from the beginning of the flight alone."""

    begin: float  # time at which the search begins
    # rise, until: the particle is above every height of the base from `rise` until `until`
    rise: float
    until: float
    apex: float  # greatest height above the lowest level of the base


implements(moving.lift_phases, Parabolic)(
    lambda shape, alpha: CORNER if 2.0 * alpha > 1.0 else np.nan
)


@jit
def stretch_at(x: float) -> tuple[float, float]:
    """Sign of the acceleration from phase x on, and x relative to the middle of that stretch."""
    rises = (x >= -CORNER) & (x < CORNER)
    return 1.0 if rises else -1.0, x if rises else x - math.copysign(0.5, x)


@jit
def level_at(x: float) -> float:
    """Height W."""
    sign, y = stretch_at(x)
    return sign * fma(2.0 * y, y, -TOP)


@jit
def since(x: float, t: float) -> tuple[float, float, float]:
    """W(x + t) - W(x) - t w(x), w(x + t) - w(x), and the size of the terms of the first."""
    sign, y = stretch_at(x)
    past = t - (CORNER - y)
    past = past if past > 0.0 else 0.0  # since the first corner
    then, w = moving.phase_after(x, t), velocity(Parabolic(), x)
    near = past <= 0.5
    rise = sign * fma(2.0 * t, t, -4.0 * past * past)
    far = fma(-t, w, level_at(then) - level_at(x))
    gain = sign * fma(-8.0, past, 4.0 * t)
    turned = velocity(Parabolic(), then) - w
    size = fma(2.0 * t, t, 4.0 * t * past) if near else 1.0 + t
    return rise if near else far, gain if near else turned, size


@jit
def clearance(alpha: float, x: float, y: float, t: float) -> tuple[float, float]:
    """Clearance F after t periods, and its derivative."""
    rise, gain, _ = since(x, t)
    half = 0.5 * alpha
    return fma(0.5 * t, y - t, -half * rise), fma(-half, gain, 0.5 * y - t)


@jit
def first_guess(alpha: float, x: float, y: float) -> ParabolicGuess:
    """Guess when the flight from phase x with speed y ends."""
    u, level = fma(alpha, velocity(Parabolic(), x), y), level_at(x)
    depth = 4.0 * alpha * (TOP - level)  # below the top, as the square of a speed
    rise = 0.5 * depth / u * (1.0 + 16.0 * moving.ULP) if u > 0.0 else np.inf
    # it falls to the top level faster than the base ever moves, and cannot land before that
    fast = (u > 0.0) & (u * u >= fma(alpha, alpha, depth) * (1.0 + 16.0 * moving.ULP))
    rising = u if u > 0.0 else 0.0
    until = u - rise
    return ParabolicGuess(
        until if fast & (until > 0.0) else 0.0,
        rise,
        until,
        fma(rising, rising, 4.0 * alpha * (level + TOP)),
    )


@jit
def try_stretch(
    alpha: float, x: float, y: float, guess: ParabolicGuess, t: float
) -> tuple[float, float, bool, float]:
    """Solve the equation of the stretch that begins after t periods without a landing.

    Returns the time of the landing, or of the next stretch to try; the speed of arrival; whether
    the particle lands; and the clearance after t periods.
    """
    clear, f1 = clearance(alpha, x, y, t)
    f = clear if clear > 0.0 else 0.0
    sign, place = stretch_at(moving.phase_after(x, t))
    left = CORNER - place
    ends = left <= moving.BORDER
    left = left + 0.5 if ends else left
    bend = fma(2.0 * alpha, -sign if ends else sign, 1.0)
    inside = fma(f1, f1, 2.0 * bend * f)
    root = math.sqrt(inside if inside > 0.0 else 0.0)
    falls = f1 < 0.0
    step = 2.0 * f / (root - f1) if falls else (f1 + root) / bend
    lands = (inside >= 0.0) & (falls | (bend > 0.0)) & (step <= left)
    following = t + left
    skips = (following > guess.rise) & (guess.until > following)
    following = guess.until if skips else following
    return t + step if lands else following, 2.0 * root, lands, clear


@implements(bases.fly, MovingParabolic)
def fly_parabolic(fixed: MovingConstants, x: float, u: float) -> tuple[float, float]:
    if not abs(x) <= 0.5:  # NaN: the particle rests for good
        return np.nan, np.nan
    if u == 0.0 and not abs(x) >= fixed.x_lift:  # the base presses the particle
        return 0.0, 0.0
    guess = first_guess(fixed.alpha, x, u)
    time, v, landed, tries = guess.begin, 0.0, False, 0.0
    while not landed and tries <= moving.TRIES:
        time, v, landed, clear = try_stretch(fixed.alpha, x, u, guess, time)
        tries += 1.0 if clear == clear else moving.TRIES
    return time if landed else np.nan, v


@implements(bases.counted, MovingParabolic)
def counted_parabolic(fixed: MovingConstants, flight: Flight, u_off: float) -> Counted:
    return Counted(flight.time, first_guess(fixed.alpha, flight.x, flight.u).apex, 1.0)


@bases.lowest.register(MovingParabolic)
def lowest_parabolic(base: MovingParabolic, problem: Dimensionless) -> Floats | None:
    return 4.0 * TOP * (problem.kick / (1.0 + problem.restitution))


@implements(bases.prepare, MovingParabolic)
def prepare_parabolic(base: MovingParabolic, s: Floats, lanes: int) -> None:
    wide_vectors()
    for j in range(lanes):
        alpha, x, y = s[ROW.CONSTANTS + STRIDE + j], s[ROW.X + j], s[ROW.U + j]
        guess, following = first_guess(alpha, x, y), s[ROW.NEXT + j]
        reached = guess.begin if following < 0.0 else following
        time, v, lands, clear = try_stretch(alpha, x, y, guess, reached)
        s[ROW.TIME + j] = time
        s[ROW.SPEED + j] = v
        s[ROW.LANDED + j] = 1.0 if lands else 0.0
        s[ROW.CLEAR + j] = clear


@implements(bases.counted_now, MovingParabolic)
def counted_now_parabolic(
    fixed: MovingConstants, s: Floats, j: int, time: float, u_off: float
) -> Counted:
    return Counted(time, first_guess(fixed.alpha, s[ROW.X + j], s[ROW.U + j]).apex, 1.0)


# --- Derivatives, and bounds on errors ------------------------------------------------------------
# The acceleration jumps at the corners of the velocity.  Between them derivatives do not depend on
# the phase; where an error reaches across a corner, they change by a bounded step.


# Error of W(x + t) - W(x) - t w(x) and of w(x + t) - w(x), relative to the size of their terms:
# that of alpha, half an ulp of 1 in a phase, which moves w by 4 times as much, four roundings each
TERM_ERROR = moving_errors.ALPHA_ERROR + 16.0 * HALF_ULP


@implements(moving_errors.along, MovingParabolic)
def along_parabolic(fixed: MovingConstants, x: float, y: float, t: float) -> Along:
    alpha, half = fixed.alpha, 0.5 * fixed.alpha
    rise, gain, size = since(x, t)
    f = fma(0.5 * t, y - t, -half * rise)
    f_error = HALF_ULP * (0.5 * t * abs(y - t) + abs(f)) + half * TERM_ERROR * size
    z = fma(alpha, gain, 2.0 * t - y)
    turns = min(12.0 * t, 2.0)
    z_error = HALF_ULP * (abs(2.0 * t - y) + abs(z)) + alpha * TERM_ERROR * turns
    first, last = stretch_at(x)[0], stretch_at(moving.phase_after(x, t))[0]
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


@implements(moving_errors.height, MovingParabolic)
def height_parabolic(fixed: MovingConstants, x: float, y: float, s: float) -> tuple[float, float]:
    return clearance(fixed.alpha, x, y, s)


@implements(moving_errors.limits, MovingParabolic)
def limits_parabolic(fixed: MovingConstants, slack: float) -> MotionLimits:
    alpha = fixed.alpha * slack
    return MotionLimits(2.0 * alpha, 2.0 * alpha, math.pi * alpha, np.inf, 0.0, 0.0)


@implements(moving_errors.below_top, MovingParabolic)
def below_top_parabolic(fixed: MovingConstants, x: float, dx: float, slack: float) -> float:
    below = (TOP - level_at(x)) + dx + HALF_ULP
    return 4.0 * math.pi * math.pi * (fixed.alpha * slack) * below


@implements(moving_errors.bends, MovingParabolic)
def bends_parabolic(fixed: MovingConstants, flight: Flight, dx: float, off: float) -> Bends:
    step = 4.0 * fixed.alpha  # of G at a corner
    begins = abs(abs(flight.x) - CORNER) < dx
    ends = abs(abs(flight.landing) - CORNER) <= dx + off + HALF_ULP
    of_p = 2.0 * step * (dx + off)
    of_p += 2.0 * step * (flight.time + off) if begins else 0.0
    jumps = (1.0 if begins else 0.0) + (1.0 if ends else 0.0)
    return Bends(of_p, 2.0 * step if ends else 0.0, 2.0 * step * jumps)


@implements(moving_errors.keeps_pressing, MovingParabolic)
def keeps_pressing_parabolic(fixed: MovingConstants, x: float, pull: float, error: float) -> bool:
    return (
        not abs(abs(x) - CORNER) <= error
        or 2.0 * fixed.alpha * (1.0 + moving_errors.GAMMA_ERROR) < 1.0
    )


@implements(bases.liftoff_error, MovingParabolic)
def liftoff_error_parabolic(fixed: MovingConstants) -> StateError:
    doubtful = abs(2.0 * fixed.alpha - 1.0) <= 8.0 * moving_errors.GAMMA_ERROR
    return StateError(np.inf if doubtful else 0.0, 0.0)
