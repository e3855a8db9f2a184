"""The base that moves with the velocity alpha w(x), alpha = a / (1 + e), for every waveform w.

Speeds are relative to the base: a particle arrives with z and leaves with E(z), by the law of
restitution.  It comes to rest if E(z) is at most r and the base presses it, 1 + G > 0 with the
acceleration G = alpha w'(x) / 2 of the base in units of gravity.  It lifts off, with speed 0, when
the base begins to fall faster than gravity, where 1 + G falls through 0.

Each kind of waveform has a named tuple for the base.  This file contains what does not depend on
the waveform, or is valid for both waveforms with a single lift-off in a period, and the flights
over the sine; those over harmonics are in `harmonics`, those over parabolas in `parabolic`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels import arithmetic, bases, noise
from vibrosweep.kernels._jit import Floats, fma, generic, implements, jit, uncompiled, wide_vectors
from vibrosweep.kernels.bases import Base, Counted, Flight, LiftOff
from vibrosweep.kernels.memory import ROW, STRIDE
from vibrosweep.kernels.noise import SILENT, STILL, Draw, Noise, Source, drawn_in
from vibrosweep.kernels.restitution import Constant, Law, Restitution, ratio, scale_of, slope
from vibrosweep.kernels.waveforms import Harmonics, Parabolic, Shape, Sine, steepness, velocity
from vibrosweep.model.parameters import Dimensionless, arcsin_turns
from vibrosweep.model.shapes import TWO_PI

_arcsin_turns = jit(arcsin_turns)
TRIES = 20000.0  # passes after which the search for a landing is abandoned
LARGEST_GAMMA = 1e9  # beyond it a slow particle meets the base too often for a search
TINY = 1e-300  # modulus of a relative speed that points into the base


class Moving(NamedTuple):
    """The base that moves as a sine."""

    law: Law  # `Rest`, the only law of rebound with a meaning here
    restitution: Restitution = Constant()
    # None if Gamma <= 1 in all realizations: the base never falls faster than gravity
    beyond_gravity: int | None = 1
    noise: Noise | None = None
    waveform: Sine = Sine()


class MovingHarmonics(NamedTuple):
    """The base that moves as a sum of harmonics."""

    law: Law
    waveform: Harmonics
    restitution: Restitution = Constant()
    noise: Noise | None = None


class MovingParabolic(NamedTuple):
    """The base whose height consists of parabolas."""

    law: Law
    waveform: Parabolic
    restitution: Restitution = Constant()
    noise: Noise | None = None


class MovingConstants(NamedTuple):
    """Numbers that decide the impacts of one realization."""

    base: Base
    # e, alpha, r: restitution, factor of the velocity of the base, and threshold of rest
    e: float
    alpha: float
    r: float
    scale: float  # of speeds, in the law of restitution
    # Phase at which the base begins to fall faster than gravity and a resting particle lifts off,
    # NaN if it never does; over harmonics, which may have several, `Stretches`
    x_lift: Any
    # source, draw: noise of the realization, and of one impact
    source: Source
    draw: Draw


# Bases of every waveform, and of those with a single lift-off in a period
ANY = Moving, MovingHarmonics, MovingParabolic
SINGLE = Moving, MovingParabolic


@generic
def lift_phases(shape: Shape, alpha: float) -> Any:
    """Phases at which a base with the velocity alpha w(x) lifts resting particles off."""


@generic
def put_lift(base: Base, x_lift: Any, s: Floats, j: int) -> None:
    """Put the phases of lift-offs into lane j."""


@generic
def take_lift(base: Base, s: Floats, j: int) -> Any:
    """Return the phases of lift-offs of lane j."""


@implements(bases.constants, *ANY)
def constants_moving(base: Base, problem: Dimensionless, i: int) -> MovingConstants:
    e = problem.restitution[i]
    alpha = problem.kick[i] / (1.0 + e)
    if 0.5 * alpha * steepness(base.waveform) > LARGEST_GAMMA:
        alpha = np.nan
    x_lift, r = lift_phases(base.waveform, alpha), problem.rest_flight[i]
    scale = scale_of(base.restitution, e, problem.restitution_speed[i])
    source = noise.source_of(problem.noise, problem.end_count, i)
    return MovingConstants(base, e, alpha, r, scale, x_lift, source, STILL)


@implements(bases.random, *ANY)
def random_moving(
    fixed: MovingConstants, particle: float, number: float, n: float, x: float
) -> MovingConstants:
    draw = noise.draw_of(fixed.base.noise, fixed.source, particle, number, 0.0)
    e, alpha, r, x_lift = fixed.e, fixed.alpha, fixed.r, fixed.x_lift
    return MovingConstants(fixed.base, e, alpha, r, fixed.scale, x_lift, fixed.source, draw)


@implements(lift_phases, Sine)
def lift_phases_sine(shape: Sine, alpha: float) -> float:
    gamma = math.pi * alpha
    if gamma > 1.0:
        # from the sine of half the angle to phase 1/2, which loses no digits near Gamma = 1
        return 0.5 - 2.0 * _arcsin_turns(math.sqrt((gamma - 1.0) / (2.0 * gamma)))  # type: ignore[no-any-return]
    return np.nan


@bases.fitted.register(Moving)
def fitted_moving(base: Moving, problem: Dimensionless) -> Moving:
    return base if bases.lifts(base, problem).any() else base._replace(beyond_gravity=None)


@bases.lowest.register(Moving)
def lowest_moving(base: Moving, problem: Dimensionless) -> Floats | None:
    return (2.0 / math.pi) * (problem.kick / (1.0 + problem.restitution))


@bases.lifts.register(Moving)
@bases.lifts.register(MovingParabolic)
def lifts_moving(base: Base, problem: Dimensionless) -> NDArray[np.bool_]:
    alpha = problem.kick / (1.0 + problem.restitution)
    return 0.5 * alpha * uncompiled(steepness)(base.waveform) > 1.0


@implements(bases.lift_off, *SINGLE)
def lift_off_moving(fixed: MovingConstants, n: float, x: float, w: float) -> LiftOff:
    leaves = (w > fixed.r) | (abs(x) > fixed.x_lift)
    later = n if fixed.x_lift > 0.0 else np.inf
    return LiftOff(
        n if leaves else later, x if leaves else fixed.x_lift, w if leaves else 0.0, leaves
    )


@implements(bases.leave, *SINGLE)
def leave_moving(fixed: MovingConstants, x: float, u: float) -> float:
    y = fma(-fixed.alpha, velocity(fixed.base.waveform, x), u)
    return -TINY if y == 0.0 and not abs(x) >= fixed.x_lift else y


@implements(bases.after_rest, *SINGLE)
def after_rest_moving(fixed: MovingConstants) -> tuple[float, float]:
    return fixed.x_lift, 0.0


@implements(bases.lifts_alike, Moving, MovingParabolic)
def lifts_alike_moving(base: Base) -> bool:
    return base.noise is None


@implements(bases.speed, *ANY)
def speed_moving(fixed: MovingConstants, x: float, u: float) -> float:
    return fma(fixed.alpha, velocity(fixed.base.waveform, x), u)


@implements(bases.rebound, *ANY)
def rebound_moving(fixed: MovingConstants, x: float, v: float) -> float:
    share = ratio(fixed.base.restitution, fixed.e, fixed.scale, v)
    e = noise.noisy_restitution(fixed.base.noise, share, fixed.draw.restitution)
    return noise.noisy_rebound(fixed.base.noise, e * v, fixed.draw.kick)


@implements(bases.later_lift_off, *ANY)
def later_lift_off_moving(
    fixed: MovingConstants, n: float, x: float, origin: float
) -> tuple[float, float]:
    return n, x


@implements(bases.contact_time, *ANY)
def contact_time_moving(fixed: MovingConstants) -> float:
    return fixed.r


@implements(bases.reverses, *ANY)
def reverses_moving(fixed: MovingConstants, x: float, v: float) -> float:
    return 1.0


@implements(bases.contraction, *ANY)
def contraction_moving(fixed: MovingConstants, v: float) -> float:
    # the determinant is the slope times the speed of the lift-off before over that of arrival; over
    # a cycle the product of these quotients equals the product of the restitutions
    law = fixed.base.restitution
    return slope(law, fixed.e, fixed.scale, v) * ratio(law, fixed.e, fixed.scale, v)


@implements(bases.density, *ANY)
def density_moving(fixed: MovingConstants, u: float) -> float:
    return u


# --- The first landing on a base that moves as a sine ---------------------------------------------
# The base has the velocity alpha sin(2 pi x) and the height -alpha / (4 pi) cos(2 pi x), alpha = a
# / (1 + e), in units in which a flight with speed u is s (u - s) / 2 high after s periods; its
# largest acceleration is Gamma = pi alpha in units of gravity.  A particle that leaves it at phase
# x with the speed y relative to it has, after s periods, the clearance
#
#     F(s) = s (y - s) / 2 + alpha / (4 pi) (sin(2 pi x) D - cos(2 pi x) C),
#     D = 2 pi s - sin(2 pi s),  C = 1 - cos(2 pi s),
#
# in which no term is a difference of nearly equal numbers: a chattering particle is simulated as
# accurately as a fast one.  It lands at the first s > 0 with F = 0, with the relative speed -2
# F'(s).
#
# Where 1 + Gamma cos(2 pi x) > 0, the base presses a particle that rests on it, and F is concave;
# elsewhere F is convex.  No root is missed:
#
# - If Gamma <= 1, F is concave and has one root.  F also has one root if the particle arrives
#   faster than the base ever moves, (pi u)^2 >= Gamma^2 + 2 Gamma (1 + cos(2 pi x)) for its
#   absolute speed u > 0.  Any iteration that converges has found this root.  Where F almost touches
#   zero before the root, steps from F > 0 may go far beyond the root and return without end; for
#   Gamma > 1 steps from F > 0 are therefore those of the next item.  Steps from beyond the root,
#   where F' < 0, return.
# - Otherwise the search goes through successive stretches of time in which F is concave or convex.
#   In a concave stretch any time may be tried: if F > 0 there, no root precedes it; if F <= 0, a
#   root does.  In a convex stretch Newton's step from the left passes no root, and for F' >= 0
#   there is no root.  While the particle is above every height of the base it cannot land.
#
# The iteration inverts the Taylor polynomial of fourth degree, because the sine that each step
# needs costs more than all the terms.


FAST = 0.6  # speed above which a flight with one root is guessed to last as over a base at rest
SLOW = 0.15  # periods within which a slower particle is guessed to land
AHEAD = 0.25  # periods beyond the flight over a base at rest, if the base falls faster than gravity
# A step ends the iteration if the terms of its series decrease so fast that the remainder is below
# half an ulp of the step, and of the flight
LAST = 2.0**-12
BORDER = 2.0**-30  # turns; a stretch this near to its end counts as ended
ULP = 2.0**-52
NOISE = 8.0 * arithmetic.HALF_ULP  # rounding error of the clearance, relative to its terms


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
    # duration of the flight over a base at rest; used only with beyond_gravity
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
    return Begin(x, y, arithmetic.sin_turns(x), arithmetic.cos_turns(x))


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
    turned, lag = arithmetic.sin_and_lag(s, part)
    half = arithmetic.sin_near(0.5 * part)
    return turned, lag, 2.0 * half * half


@jit
def first_guess(fixed: MovingConstants, begin: Begin, beyond_gravity: int | None) -> Guess:
    """Guess when the flight ends.

    If `beyond_gravity` is None, the code that only flights with Gamma > 1 need is not compiled.
    """
    alpha, x_lift, (x, y, _, cosine) = fixed.alpha, fixed.x_lift, begin
    gamma, u = math.pi * alpha, absolute(fixed, begin)
    pull = fma(gamma, cosine, 1.0)
    parabola = y / pull if pull > 0.0 else np.inf
    sure, most, rise = True, u if u > SLOW else SLOW, np.inf
    if beyond_gravity is not None:
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
    lag, c = arithmetic.rough_lag_and_versine(part)
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
    fixed: MovingConstants, begin: Begin, guess: Guess, rough: Clearance, beyond_gravity: int | None
) -> float:
    """Return the time to be tried first, from a guess and the clearance at that time."""
    alpha, x_lift, x, sure, f = fixed.alpha, fixed.x_lift, begin.x, guess.sure, rough.f
    third = (math.pi * math.pi / 3.0) * alpha * rough.sine * (f * f)
    s = improved(guess.time, f, rough.f1, fma(-math.pi * alpha, rough.cosine, -1.0), third)
    if beyond_gravity is not None:
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
    beyond_gravity: int | None,
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
    if beyond_gravity is not None:
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


@implements(bases.fly, Moving)
def fly_moving(fixed: MovingConstants, x: float, u: float) -> tuple[float, float]:
    if not abs(x) <= 0.5:  # NaN: the particle rests for good
        return np.nan, np.nan
    if u == 0.0 and not abs(x) >= fixed.x_lift:  # the base presses the particle
        return 0.0, 0.0
    begin, beyond_gravity = begin_at(x, u), fixed.base.beyond_gravity
    guess = first_guess(fixed, begin, beyond_gravity)
    time = first_try(fixed, begin, guess, rough_clearance(fixed, begin, guess.time), beyond_gravity)
    v, landed, tries = 0.0, False, 0.0
    while not landed and tries <= TRIES:
        clear = clearance(fixed, begin, time, *turn(time))
        terms = series_terms(fixed, clear)
        time, v, landed = try_landing(fixed, begin, guess, time, clear, terms, beyond_gravity)
        tries += 1.0 if clear.f == clear.f else TRIES
    return time if landed else np.nan, v


# --- Lanes ----------------------------------------------------------------------------------------
# A pass makes one step of each lane's search.  The loops are many and short, because a processor
# works on several lanes at once only if their chains of dependent operations are short.


FRESH = -1.0  # in place of the next time to be tried: the flight has just begun


@implements(bases.put, *ANY)
def put_moving(fixed: MovingConstants, s: Floats, j: int) -> None:
    row = ROW.CONSTANTS + j
    s[row], s[row + STRIDE], s[row + 2 * STRIDE] = fixed.e, fixed.alpha, fixed.r
    s[ROW.SCALE + j] = fixed.scale
    put_lift(fixed.base, fixed.x_lift, s, j)
    s[ROW.NEXT + j], s[ROW.COUNTS + j] = FRESH, 0.0
    s[ROW.TRIES + j], s[ROW.AGE_SEEN + j] = 0.0, 0.0


@implements(bases.take, *ANY)
def take_moving(base: Base, s: Floats, j: int) -> MovingConstants:
    row = ROW.CONSTANTS + j
    e, alpha, r = s[row], s[row + STRIDE], s[row + 2 * STRIDE]
    draw, scale = drawn_in(base.noise, s, j), s[ROW.SCALE + j]
    return MovingConstants(base, e, alpha, r, scale, take_lift(base, s, j), SILENT, draw)


@implements(put_lift, *SINGLE)
def put_lift_single(base: Base, x_lift: float, s: Floats, j: int) -> None:
    s[ROW.CONSTANTS + 3 * STRIDE + j] = x_lift


implements(take_lift, *SINGLE)(lambda base, s, j: s[ROW.CONSTANTS + 3 * STRIDE + j])


@implements(bases.prepare, Moving)
def prepare_moving(base: Moving, s: Floats, lanes: int) -> None:
    _begin(base, s, lanes)
    _near(base, s, lanes)
    _guess(base, s, lanes)
    _turn(base, s, lanes)
    _look(base, s, lanes)
    _try(base, s, lanes)


@jit
def _begin(base: Moving, s: Floats, lanes: int) -> None:
    """Compute sine and cosine where the flight of each lane begins."""
    wide_vectors()
    for j in range(lanes):
        x = s[ROW.X + j]
        s[ROW.SINE + j], s[ROW.COSINE + j] = arithmetic.sin_turns(x), arithmetic.cos_turns(x)


@jit
def _near(base: Moving, s: Floats, lanes: int) -> None:
    """Guess when the flight of each lane ends."""
    wide_vectors()
    for j in range(lanes):
        guess = first_guess(bases.take(base, s, j), begun(s, j), base.beyond_gravity)
        s[ROW.SURE + j] = 1.0 if guess.sure else 0.0
        s[ROW.GUESS + j] = guess.time
        s[ROW.RISE + j] = guess.rise


@jit
def _guess(base: Moving, s: Floats, lanes: int) -> None:
    """Compute the time to be tried first in a flight that has just begun."""
    wide_vectors()
    for j in range(lanes):
        fixed, begin, guess = bases.take(base, s, j), begun(s, j), _guessed(s, j)
        rough = rough_clearance(fixed, begin, guess.time)
        tried = first_try(fixed, begin, guess, rough, base.beyond_gravity)
        following = s[ROW.NEXT + j]
        s[ROW.REACHED + j] = tried if following < 0.0 else following


@jit
def _turn(base: Moving, s: Floats, lanes: int) -> None:
    """Compute how far the base turns until the time that is to be tried."""
    wide_vectors()
    for j in range(lanes):
        s[ROW.TURNED + j], s[ROW.LAG + j], s[ROW.VERSINE + j] = turn(s[ROW.REACHED + j])


@jit
def _look(base: Moving, s: Floats, lanes: int) -> None:
    """Compute the clearance of each lane at the time that is to be tried, and its series."""
    wide_vectors()
    for j in range(lanes):
        fixed, reached = bases.take(base, s, j), s[ROW.REACHED + j]
        turned, lag, c = s[ROW.TURNED + j], s[ROW.LAG + j], s[ROW.VERSINE + j]
        clear = clearance(fixed, begun(s, j), reached, turned, lag, c)
        s[ROW.CLEAR + j], s[ROW.CLEAR_SLOPE + j] = clear.f, clear.f1
        s[ROW.SINE_THEN + j], s[ROW.COSINE_THEN + j] = clear.sine, clear.cosine
        terms = series_terms(fixed, clear)
        s[ROW.NEWTON + j] = terms.newton
        s[ROW.Q + j] = terms.q
        s[ROW.Q3 + j] = terms.q3
        s[ROW.Q4 + j] = terms.q4


@jit
def _try(base: Moving, s: Floats, lanes: int) -> None:
    """Find the landing of each lane, or the time to be tried next, from the clearance."""
    wide_vectors()
    for j in range(lanes):
        fixed, begin, guess = bases.take(base, s, j), begun(s, j), _guessed(s, j)
        clear = Clearance(
            s[ROW.CLEAR + j], s[ROW.CLEAR_SLOPE + j], s[ROW.SINE_THEN + j], s[ROW.COSINE_THEN + j]
        )
        terms = Terms(s[ROW.NEWTON + j], s[ROW.Q + j], s[ROW.Q3 + j], s[ROW.Q4 + j])
        time, v, landed = try_landing(
            fixed, begin, guess, s[ROW.REACHED + j], clear, terms, base.beyond_gravity
        )
        s[ROW.TIME + j] = time
        s[ROW.SPEED + j] = v
        s[ROW.LANDED + j] = 1.0 if landed else 0.0


@jit
def begun(s: Floats, j: int) -> Begin:
    """Return the beginning of the flight of lane j, as `prepare` left it."""
    return Begin(s[ROW.X + j], s[ROW.U + j], s[ROW.SINE + j], s[ROW.COSINE + j])


@jit
def _guessed(s: Floats, j: int) -> Guess:
    """Return the guess of lane j, as `prepare` left it."""
    return Guess(s[ROW.SURE + j] != 0.0, s[ROW.GUESS + j], s[ROW.RISE + j])


@implements(bases.approach, *ANY)
def approach_moving(fixed: MovingConstants, s: Floats, j: int) -> tuple[float, float, bool]:
    return s[ROW.TIME + j], s[ROW.SPEED + j], s[ROW.LANDED + j] != 0.0


@implements(bases.may_land, *ANY)
def may_land_moving(fixed: MovingConstants, s: Floats, j: int, budget: float) -> bool:
    return bool(s[ROW.AGE + j] < budget)


@implements(bases.end_pass, *ANY)
def end_pass_moving(
    fixed: MovingConstants, s: Floats, j: int, time: float, landed: bool, seen: bool
) -> bool:
    counts = s[ROW.COUNTS + j] != 0.0
    s[ROW.AGE + j] += 1.0 if landed else 0.0
    s[ROW.COUNTS + j] = (1.0 if seen else 0.0) + (0.0 if landed else s[ROW.COUNTS + j])
    s[ROW.NEXT + j] = FRESH if landed else time
    return bool(landed & counts)


@implements(bases.abandons, *ANY)
def abandons_moving(base: Base, s: Floats, j: int, passes: int) -> bool:
    stays = s[ROW.AGE + j] == s[ROW.AGE_SEEN + j]
    s[ROW.AGE_SEEN + j] = s[ROW.AGE + j]
    s[ROW.TRIES + j] = s[ROW.TRIES + j] + passes if stays else 0.0
    clear = s[ROW.CLEAR + j]
    lost = (clear != clear) & (abs(s[ROW.X + j]) <= 0.5)  # a particle at rest for good is not lost
    return bool((s[ROW.TRIES + j] >= TRIES) | lost)


@implements(bases.pending, *ANY)
def pending_moving(base: Base, s: Floats, j: int) -> bool:
    # after a rest for good no flight follows, and the phase is NaN
    return bool((s[ROW.COUNTS + j] != 0.0) & (abs(s[ROW.X + j]) <= 0.5))


@implements(bases.counted, Moving)
def counted_moving(fixed: MovingConstants, flight: Flight, u_off: float) -> Counted:
    return Counted(flight.time, apex(fixed, begin_at(flight.x, flight.u)), 1.0)


@implements(bases.counted_now, Moving)
def counted_now_moving(
    fixed: MovingConstants, s: Floats, j: int, time: float, u_off: float
) -> Counted:
    return Counted(time, apex(fixed, begun(s, j)), 1.0)


@implements(bases.common_age, *ANY)
def common_age_moving(base: Base) -> float:
    return 0.0
