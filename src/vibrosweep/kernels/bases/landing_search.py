"""The first landing on a base that moves as a sine.

The base has the velocity alpha sin(2 pi x) and the height -alpha / (4 pi) cos(2 pi x), alpha = a /
(1 + e), in units in which a flight with speed u is s (u - s) / 2 high after s periods; its largest
acceleration is Gamma = pi alpha in units of gravity.  A particle that leaves it at phase x with the
speed y relative to it has, after s periods, the clearance

    F(s) = s (y - s) / 2 + alpha / (4 pi) (sin(2 pi x) D - cos(2 pi x) C),
    D = 2 pi s - sin(2 pi s),  C = 1 - cos(2 pi s),

in which no term is a difference of nearly equal numbers: a chattering particle is followed as
accurately as a fast one.  It lands at the first s > 0 with F = 0, with the relative speed -2 F'(s).

Where 1 + Gamma cos(2 pi x) > 0, the base presses a particle that rests on it, and F is concave;
elsewhere F is convex.  No root is missed:

- If Gamma <= 1, F is concave and has one root.  F also has one root if the particle arrives faster
  than the base ever moves, (pi u)^2 >= Gamma^2 + 2 Gamma (1 + cos(2 pi x)) for its absolute speed
  u > 0.  Any iteration that converges has found this root.  Where F almost touches zero before the
  root, steps from F > 0 may go far beyond the root and return without end; for Gamma > 1 steps from
  F > 0 are therefore those of the next item.  Steps from beyond the root, where F' < 0, return.
- Otherwise the search goes through successive stretches of time in which F is concave or convex.
  In a concave stretch any time may be tried: if F > 0 there, no root precedes it; if F <= 0, a root
  does.  In a convex stretch Newton's step from the left passes no root, and for F' >= 0 there is no
  root.  While the particle is above every height of the base it cannot land.

The iteration inverts the Taylor polynomial of fourth degree, because the sine that each step needs
costs more than all the terms.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibrosweep.kernels import bases
from vibrosweep.kernels._jit import fma, implements, jit
from vibrosweep.kernels.bases.moving import TRIES, MovingConstants
from vibrosweep.kernels.rounding import HALF_ULP
from vibrosweep.kernels.sine import (
    cos_turns,
    rough_lag_and_versine,
    sin_and_lag,
    sin_near,
    sin_turns,
)
from vibrosweep.model.shapes import TWO_PI

FAST = 0.6  # speed above which a flight with one root is guessed to last as over a base at rest
SLOW = 0.15  # periods within which a slower particle is guessed to land
AHEAD = 0.25  # periods beyond the flight over a base at rest, if the base falls faster than gravity
# A step ends the iteration if the terms of its series decrease so fast that the remainder is below
# half an ulp of the step, and of the flight
LAST = 2.0**-12
BORDER = 2.0**-30  # turns; a stretch this near to its end counts as ended
ULP = 2.0**-52
NOISE = 8.0 * HALF_ULP  # rounding error of the clearance, relative to its terms


class Begin(NamedTuple):
    """Beginning of a flight."""

    # x, y, sine, cosine: phase and speed relative to the base, and sine and cosine of the phase
    x: float
    y: float
    sine: float
    cosine: float


class Guess(NamedTuple):
    """A guess of the landing, from the beginning of the flight alone."""

    sure: bool  # True if the clearance certainly has a single root
    time: float  # a time near the landing
    # The particle is above every height of the base from time `rise` until u - rise, u being the
    # duration of the flight over a base at rest; used only with arcs
    rise: float


class Clearance(NamedTuple):
    """Height above the base during a flight."""

    # f, f1: the clearance and its derivative by time
    f: float
    f1: float
    # sine, cosine: of the phase of the base
    sine: float
    cosine: float


class Terms(NamedTuple):
    """Newton's step, and the second, third and fourth derivative relative to it."""

    newton: float
    q: float
    q3: float
    q4: float


@jit
def begin_at(x: float, y: float) -> Begin:
    """Beginning of the flight that leaves phase x with speed y."""
    return Begin(x, y, sin_turns(x), cos_turns(x))


@jit
def phase_after(x: float, s: float) -> float:
    """Phase of the base s periods after phase x."""
    moved = x + (s - np.rint(s))
    return moved - np.rint(moved)  # type: ignore[no-any-return]


@jit
def absolute(fixed: MovingConstants, begin: Begin) -> float:
    """Absolute speed at the lift-off."""
    return fma(fixed.alpha, begin.sine, begin.y)


@jit
def apex(fixed: MovingConstants, begin: Begin) -> float:
    """Greatest height above the lowest level of the base, at the apex or at lift-off."""
    u = absolute(fixed, begin)
    rising = u if u > 0.0 else 0.0
    return fma(rising, rising, (2.0 / math.pi) * fixed.alpha * (1.0 - begin.cosine))


@jit
def clearance(
    fixed: MovingConstants, begin: Begin, s: float, turned: float, lag: float, c: float
) -> Clearance:
    """Clearance after s periods, given sin(2 pi s), 2 pi s - sin(2 pi s) and 1 - cos(2 pi s)."""
    sine, cosine = begin.sine, begin.cosine
    slowed = fma(sine, c, -cosine * turned)  # the base, since the lift-off
    sunk = (0.25 / math.pi) * fixed.alpha * fma(sine, lag, -cosine * c)
    return Clearance(
        fma(0.5 * s, begin.y - s, sunk),
        fma(0.5 * fixed.alpha, slowed, 0.5 * begin.y - s),
        sine - slowed,
        cosine - fma(cosine, c, sine * turned),
    )


@jit
def series_terms(fixed: MovingConstants, clear: Clearance) -> Terms:
    """Newton's step from where the clearance is known, and the further terms of the series."""
    f, f1, sine, cosine = clear
    gamma = math.pi * fixed.alpha
    inverse = 1.0 / f1
    newton = -f * inverse
    once = newton * inverse
    twice = once * newton
    return Terms(
        newton,
        0.5 * once * fma(-gamma, cosine, -1.0),
        (math.pi / 3.0 * gamma) * twice * sine,
        (math.pi * math.pi / 6.0 * gamma) * twice * newton * cosine,
    )


@jit
def turn(s: float) -> tuple[float, float, float]:
    """Return sin(2 pi s), 2 pi s - sin(2 pi s) and 1 - cos(2 pi s), which `clearance` needs."""
    part = s - np.rint(s)
    turned, lag = sin_and_lag(s, part)
    half = sin_near(0.5 * part)
    return turned, lag, 2.0 * half * half


@jit
def first_guess(fixed: MovingConstants, begin: Begin, arcs: int | None) -> Guess:
    """Guess when the flight ends.

    If `arcs` is None, the code that only flights with Gamma > 1 need is not compiled.
    """
    alpha, x_lift, (x, y, _, cosine) = fixed.alpha, fixed.x_lift, begin
    gamma, u = math.pi * alpha, absolute(fixed, begin)
    pull = fma(gamma, cosine, 1.0)
    parabola = y / pull if pull > 0.0 else np.inf
    sure, most, rise = True, u if u > SLOW else SLOW, np.inf
    if arcs is not None:
        w = math.pi * u
        fast = (u > 0.0) & (w * w >= gamma * (gamma + 2.0 * (1.0 + cosine)))
        sure = fast | (gamma <= 1.0)
        most = most if sure else (u + AHEAD if abs(x) >= x_lift else x_lift - x)
        rise = (alpha / math.pi) * (1.0 + cosine) / u if u > 0.0 else np.inf
    s = parabola if parabola < most else most
    return Guess(sure, u if (u > FAST) & sure else s, rise)


@jit
def rough_clearance(fixed: MovingConstants, begin: Begin, s: float) -> Clearance:
    """Clearance after s periods to about five digits, enough for a guess."""
    whole = np.rint(s)
    part = s - whole
    lag, c = rough_lag_and_versine(part)
    return clearance(fixed, begin, s, fma(TWO_PI, part, -lag), fma(TWO_PI, whole, lag), c)


@jit
def improved(s: float, f: float, f1: float, f2: float, third: float) -> float:
    """Return a time nearer to the root than s, by one step of Householder's method of third order.

    `third` is a sixth of the third derivative times f^2.  A long step, or one away from the root,
    is not made.
    """
    bend, square = 0.5 * f * f2, f1 * f1
    step = -f * (square - bend) / fma(f1, fma(-2.0, bend, square), third)
    far = 0.5 * s if s < 0.5 else 0.25
    return s + step if (f1 < 0.0) & (abs(step) < far) else s


@jit
def first_try(
    fixed: MovingConstants, begin: Begin, guess: Guess, rough: Clearance, arcs: int | None
) -> float:
    """Return the time to be tried first, from a guess and the clearance at that time."""
    alpha, x_lift, x, sure, f = fixed.alpha, fixed.x_lift, begin.x, guess.sure, rough.f
    third = (math.pi * math.pi / 3.0) * alpha * rough.sine * (f * f)
    s = improved(guess.time, f, rough.f1, fma(-math.pi * alpha, rough.cosine, -1.0), third)
    if arcs is not None:
        # F is concave in the present stretch, or in the next one, before which it has no root
        falls = abs(x) >= x_lift
        to_press = (1.0 if x > 0.0 else 0.0) - x_lift - x
        to_fall = to_press + 2.0 * x_lift if falls else x_lift - x
        s = s if sure | (s < to_fall) else to_fall
        s = to_press if falls & (not (sure | (s > to_press))) else s
    return 0.0 if begin.y < 0.0 else s  # pushed into the base, it lands at once


@jit
def _ends(x: float, x_lift: float) -> tuple[bool, float, float]:
    """Return whether the base presses at phase x, and periods until it falls, or presses again.

    A stretch that is within `BORDER` of its end counts as ended.
    """
    presses = not abs(x) > x_lift
    to_fall = x_lift - x
    to_press = (1.0 if x > 0.0 else 0.0) - x_lift - x
    over = (to_fall if presses else to_press) <= BORDER
    to_press = (1.0 - 2.0 * x_lift) + to_fall if over & presses else to_press
    to_fall = 2.0 * x_lift + to_press if over & (not presses) else to_fall
    return presses != over, to_fall, to_press


@jit
def across(
    ends: tuple[bool, float, float],
    above: tuple[float, float],
    s: float,
    slopes: tuple[float, float, float],
    newton: float,
    step: float,
) -> float:
    """Return the time to be tried after s, if the base may fall faster than gravity.

    The clearance is positive at s and before.  `ends` is whether the base presses at s, and the
    periods until it falls, or presses again.  Between the times `above` the particle is above every
    height of the base.  `slopes` are F', F'', and half a bound of F'''.
    """
    (presses, to_fall, to_press), (rise, until), (f1, f2, jolt) = ends, above, slopes
    nears = f1 < 0.0
    into = step if nears else s
    into = into if into < to_fall else to_fall
    # whether the slope stays negative for this long
    beyond = 1.01 * (step if step > newton else newton)
    bend = f2 if f2 > 0.0 else 0.0
    falls = f1 + beyond * (bend + jolt * beyond) < 0.0
    convex = step if falls else newton
    convex = convex if nears & (convex < to_press) else to_press
    tried = s + (into if presses else convex)
    return until if (s > rise) & (until > tried) else tried


@jit
def series_step(s: float, f1: float, terms: Terms) -> tuple[float, float, bool]:
    """Return the step from s to the root, the time to try, and whether the terms decrease fast.

    The step is between 1/2 and 3/2 of Newton's.
    """
    newton, q, q3, q4 = terms
    third = fma(q, q, -q3)
    series = 1.0 - q + (fma(q, q, third) - fma(5.0 * q, third, q4))  # in steps of Newton's
    small = (abs(q) <= LAST) & (abs(q3) <= LAST * LAST) & (abs(q4) <= LAST * LAST * LAST)
    series = series if series > 0.5 else 0.5
    step = newton * (series if series < 1.5 else 1.5)
    back = step if step > -0.75 * s else -0.75 * s
    forth = back if back < s else s
    return step, s + (forth if f1 < 0.0 else (s if s < 0.25 else 0.25)), small


@jit
def try_landing(
    fixed: MovingConstants,
    begin: Begin,
    guess: Guess,
    s: float,
    clear: Clearance,
    terms: Terms,
    arcs: int | None,
) -> tuple[float, float, bool]:
    """Try time s; return the landing or the next time to try, the speed, and whether it lands.

    `clear` is the clearance at that time, and `terms` are those of its series.
    """
    f, f1, sine, cosine = clear
    alpha, newton, sure = fixed.alpha, terms.newton, guess.sure
    gamma = math.pi * alpha
    f2 = fma(-gamma, cosine, -1.0)
    f3, f4 = (TWO_PI * gamma) * sine, (TWO_PI * TWO_PI * gamma) * cosine
    step, tried, small = series_step(s, f1, terms)
    nears = f1 < 0.0
    last = nears & (small | (abs(newton) <= ULP * s))
    # the fifth and sixth derivatives are -(2 pi)^2 times the third and fourth; the last step may
    # be long where only gravity bends the flight
    turned = (TWO_PI * TWO_PI) * step * step
    third, fourth = f3 * fma(turned, -1.0 / 24.0, 0.5), f4 * fma(turned, -1.0 / 120.0, 1.0 / 6.0)
    arrival = -2.0 * fma(step, fma(step, fma(step, fourth, third), f2), f1)
    if arcs is not None:
        ends = _ends(phase_after(begin.x, s), fixed.x_lift)
        above = guess.rise, absolute(fixed, begin) - guess.rise
        # the third derivative is at most 2 pi Gamma
        over = across(ends, above, s, (f1, f2, math.pi * math.pi * alpha), newton, step)
        tried = over if (f > 0.0) & (gamma > 1.0) & (not last) else tried
        swept = 2.0 * s if s < 0.5 else 1.0  # the terms of the base grow with the square of s
        noise = NOISE * s * (alpha * swept + 0.5 * (abs(begin.y) + s))
        grazes = (f <= 0.0) & (not (sure | last)) & ((-f <= noise) | (not nears))
        tried = s if grazes else tried
        arrival = (-2.0 * f1 if nears else 0.0) if grazes else arrival
        last = last | grazes
    return tried, arrival, last


@implements(bases.fly, MovingConstants)
def fly_moving(fixed: MovingConstants, x: float, u: float) -> tuple[float, float]:
    if not abs(x) <= 0.5:  # NaN: the particle rests for good
        return np.nan, np.nan
    if u == 0.0 and not abs(x) >= fixed.x_lift:  # the base presses the particle
        return 0.0, 0.0
    begin, arcs = begin_at(x, u), fixed.base.arcs
    guess = first_guess(fixed, begin, arcs)
    time = first_try(fixed, begin, guess, rough_clearance(fixed, begin, guess.time), arcs)
    v, landed, tries = 0.0, False, 0.0
    while not landed and tries <= TRIES:
        clear = clearance(fixed, begin, time, *turn(time))
        terms = series_terms(fixed, clear)
        time, v, landed = try_landing(fixed, begin, guess, time, clear, terms, arcs)
        tries += 1.0 if clear.f == clear.f else TRIES
    return time if landed else np.nan, v
