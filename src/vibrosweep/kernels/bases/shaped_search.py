"""The first landing on a base that moves as a sum of harmonics.

As in `landing_search`, with w(x) = sum u_h, where a harmonic has u = c sin(th), v = c cos(th) at
the phase of the lift-off.  After s periods, which differ by d from the nearest whole number, the
clearance is

    F(s) = s (y - s) / 2 - (alpha / 2) (sum (v_h C_h - u_h D_h) / (2 pi h) - (s - d) sum u_h),
    C_h = 1 - cos(2 pi h d),  D_h = 2 pi h d - sin(2 pi h d),

in which no term is a difference of nearly equal numbers.  The same holds for the recurrences from
one harmonic to the next, C_(h+1) - C_h = C_h - C_(h-1) + 2 C_1 cos(2 pi h d), and for D with the
sine.  G = alpha w' / 2 is the acceleration of the base in units of gravity.  F is concave while
1 + G > 0, where the base presses, and convex elsewhere; a period has several such stretches, whose
ends are known.  F certainly has a single root if the base never falls faster than gravity, or if
the particle falls to the top level of the base faster than the base ever moves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import fma, jit
from vibrosweep.kernels.bases.landing_search import (
    AHEAD,
    BORDER,
    FAST,
    LAST,
    NOISE,
    SLOW,
    ULP,
    Begin,
    Terms,
    across,
    improved,
    phase_after,
    series_step,
)
from vibrosweep.kernels.bases.moving import ShapedConstants
from vibrosweep.kernels.harmonics import Harmonics
from vibrosweep.kernels.sine import rough_lag_and_versine, sin_and_lag, sin_near
from vibrosweep.model.shapes import TWO_PI

# Largest angle by which the highest harmonic turns in the last step; its fifth power is left out
SHORT = 2.0**-9

# Of a harmonic since the lift-off: S = sin(2 pi h d), D and C, and by how much D and C exceed those
# of the harmonic before
Turns = tuple[float, float, float, float, float]


class Guess(NamedTuple):
    """A guess of the landing, from the beginning of the flight alone."""

    sure: bool  # True if the clearance certainly has a single root
    time: float  # a time near the landing
    # rise, u: the particle is above every height of the base from time `rise` until `u - rise`; u
    # is its absolute speed, which is the duration of its flight over a base at rest
    rise: float
    u: float
    apex: float  # greatest height above the lowest level of the base


class Clear(NamedTuple):
    """Clearance above the base, and its derivatives by time."""

    f: float
    f1: float
    f2: float
    f3: float
    f4: float
    f5: float


@jit
def next_harmonic(sine: float, cosine: float, first: tuple[float, float]) -> tuple[float, float]:
    """Sine and cosine of the next multiple of an angle, from those of one and of the angle."""
    s, c = first
    return fma(sine, c, cosine * s), fma(cosine, c, -sine * s)


@jit
def next_turns(turns: Turns, turned: float, c: float) -> Turns:
    """Return how far the next harmonic has turned, given S and C of the first."""
    s_h, d_h, c_h, d_more, c_more = turns
    ahead = 1.0 - c_h
    d_more = fma(2.0 * c, s_h, d_more)
    c_more = fma(2.0 * c, ahead, c_more)
    s_h = fma(s_h, 1.0 - c, ahead * turned)
    return s_h, d_h + d_more, c_h + c_more, d_more, c_more


@jit
def at_phase(shape: Harmonics, sine: float, cosine: float) -> tuple[float, float, float]:
    """Velocity w, its derivative and its integral W at a phase, given by sine and cosine."""
    w, slope, level, turned, ahead = 0.0, 0.0, 0.0, sine, cosine
    for k in range(len(shape.p)):
        angle = TWO_PI * (k + 1)
        p, q = shape.p[k], shape.q[k]
        u, v = fma(p, turned, q * ahead), fma(p, ahead, -q * turned)
        w += u
        slope = fma(angle, v, slope)
        level = fma(-1.0 / angle, v, level)
        turned, ahead = next_harmonic(turned, ahead, (sine, cosine))
    return w, slope, level


@jit
def stretch(fixed: ShapedConstants, x: float) -> tuple[bool, float, float]:
    """Return whether the base presses at phase x, and periods until it falls, or presses again.

    A stretch that is within `BORDER` of its end counts as ended.
    """
    to_fall, to_press = np.inf, np.inf
    for k in range(len(fixed.falls)):
        fall, press = fixed.falls[k] - x, fixed.presses[k] - x
        fall = fall + 1.0 if fall < 0.0 else fall
        press = press + 1.0 if press < 0.0 else press
        to_fall = fall if fall < to_fall else to_fall
        to_press = press if press < to_press else to_press
    presses = not to_press < to_fall
    over = (to_fall if presses else to_press) <= BORDER
    return presses != over, to_fall, to_press


@jit
def clearance(
    fixed: ShapedConstants, begin: Begin, s: float, turned: float, lag: float, c: float
) -> Clear:
    """Clearance after s periods.

    Given sin(2 pi d), 2 pi d - sin(2 pi d) and 1 - cos(2 pi d) for d = s - rint(s).
    """
    shape, half = fixed.base.waveform, 0.5 * fixed.alpha
    sine, cosine, turns = begin.sine, begin.cosine, (turned, lag, c, lag, c)
    back, w, slowed, w1, w2, w3, w4 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(shape.p)):
        angle = TWO_PI * (k + 1)
        p, q = shape.p[k], shape.q[k]
        u, v = fma(p, sine, q * cosine), fma(p, cosine, -q * sine)
        s_h, d_h, c_h, _, _ = turns
        ahead = 1.0 - c_h
        back = fma(1.0 / angle, fma(v, c_h, -u * d_h), back)
        w += u
        slowed = fma(u, c_h, fma(-v, s_h, slowed))
        even, odd = angle * fma(v, ahead, -u * s_h), angle * angle * fma(u, ahead, v * s_h)
        w1 += even
        w2 -= odd
        w3 = fma(-angle * angle, even, w3)
        w4 = fma(angle * angle, odd, w4)
        sine, cosine = next_harmonic(sine, cosine, (begin.sine, begin.cosine))
        turns = next_turns(turns, turned, c)
    return Clear(
        fma(0.5 * s, begin.y - s, half * fma(np.rint(s), w, -back)),
        fma(half, slowed, 0.5 * begin.y - s),
        fma(-half, w1, -1.0),
        -half * w2,
        -half * w3,
        -half * w4,
    )


@jit
def turn(s: float) -> tuple[float, float, float]:
    """Return the functions of s that `clearance` needs."""
    part = s - np.rint(s)
    turned, lag = sin_and_lag(part, part)
    half = sin_near(0.5 * part)
    return turned, lag, 2.0 * half * half


@jit
def rough_turn(s: float) -> tuple[float, float, float]:
    """Return the functions of `turn` to about five digits."""
    part = s - np.rint(s)
    lag, c = rough_lag_and_versine(part)
    return fma(TWO_PI, part, -lag), lag, c


@jit
def first_guess(fixed: ShapedConstants, begin: Begin) -> Guess:
    """Guess when the flight ends."""
    shape, alpha = fixed.base.waveform, fixed.alpha
    w, slope, level = at_phase(shape, begin.sine, begin.cosine)
    u = fma(alpha, w, begin.y)
    pull = fma(0.5 * alpha, slope, 1.0)
    depth = 4.0 * alpha * (shape.top - level)  # below the top, as the square of a speed
    largest = alpha * shape.fastest
    fast = (u > 0.0) & (u * u >= (largest * largest + depth) * (1.0 + 16.0 * ULP))
    sure = fast | (0.5 * alpha * shape.fall <= 1.0 - 16.0 * ULP)
    presses, to_fall, _ = stretch(fixed, begin.x)
    short = u if u > SLOW else SLOW
    most = short if sure else (to_fall if presses else u + AHEAD)
    parabola = begin.y / pull if pull > 0.0 else np.inf
    s = parabola if parabola < most else most
    rising = u if u > 0.0 else 0.0
    return Guess(
        sure,
        u if (u > FAST) & sure else s,
        0.5 * depth / u * (1.0 + 16.0 * ULP) if u > 0.0 else np.inf,
        u,
        fma(rising, rising, 4.0 * alpha * (level - shape.bottom)),
    )


@jit
def first_try(fixed: ShapedConstants, begin: Begin, sure: bool, s: float, rough: Clear) -> float:
    """Return the time to be tried first, from a guess and the clearance at that time."""
    f = rough.f
    s = improved(s, f, rough.f1, rough.f2, rough.f3 * (f * f) / 6.0)
    # F is concave in the present stretch, or in the next one, before which it has no root
    presses, to_fall, to_press = stretch(fixed, begin.x)
    s = s if sure | (s < to_fall) else to_fall
    s = s if sure | presses | (s > to_press) else to_press
    return 0.0 if begin.y < 0.0 else s  # pushed into the base, it lands at once


@jit
def try_landing(
    fixed: ShapedConstants, begin: Begin, guess: Guess, s: float, clear: Clear
) -> tuple[float, float, bool]:
    """Try time s; return the landing or the next time to try, the speed, and whether it lands."""
    f, f1, f2, f3, f4, f5 = clear
    alpha, shape = fixed.alpha, fixed.base.waveform
    inverse = 1.0 / f1
    newton = -f * inverse
    once = newton * inverse
    twice = once * newton
    q, q3, q4 = 0.5 * once * f2, twice * f3 / 6.0, twice * newton * f4 / 24.0
    q5 = twice * newton * newton * f5 / 120.0
    step, tried, small = series_step(s, f1, Terms(newton, q, q3, q4))
    small &= abs(q5) <= LAST * LAST * LAST * LAST
    small &= abs(newton) <= SHORT / (TWO_PI * len(shape.p))
    nears = f1 < 0.0
    last = nears & (small | (abs(newton) <= ULP * s))
    arrival = fma(step, fma(step, fma(step, f5 / 24.0, f4 / 6.0), 0.5 * f3), f2)
    arrival = -2.0 * fma(step, arrival, f1)
    ends, above = stretch(fixed, phase_after(begin.x, s)), (guess.rise, guess.u - guess.rise)
    # the third derivative is at most alpha times the bend
    over = across(ends, above, s, (f1, f2, 0.5 * alpha * shape.bend), newton, step)
    convex = 0.5 * alpha * shape.fall > 1.0 - 16.0 * ULP
    tried = over if (f > 0.0) & convex & (not last) else tried
    swept = 2.0 * s if s < 0.5 else 1.0  # the terms of the base grow with the square of s
    noise = s * (alpha * swept * shape.rounding + NOISE * 0.5 * (abs(begin.y) + s))
    grazes = (f <= 0.0) & (not (guess.sure | last)) & ((-f <= noise) | (not nears))
    tried = s if grazes else tried
    arrival = (-2.0 * f1 if nears else 0.0) if grazes else arrival
    return tried, arrival, last | grazes
