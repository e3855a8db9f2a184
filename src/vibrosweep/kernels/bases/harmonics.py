"""The moving base whose velocity is a sum of harmonics.

A resting particle lifts off at the next phase at which 1 + G falls through 0; a period may have
several such phases.

In the vector kernel a pass makes one step of each lane's search.  The loops are short, as over the
sine (`vibrosweep.kernels.bases.moving`), and use the same rows, except for `HarmonicsRows`.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels import arithmetic, bases
from vibrosweep.kernels._jit import Floats, fma, implements, jit, wide_vectors
from vibrosweep.kernels.bases import Counted, Flight, LiftOff, moving
from vibrosweep.kernels.bases.moving import Begin, MovingConstants, MovingHarmonics, Terms
from vibrosweep.kernels.memory import OF_PHASES, ROW, STRIDE
from vibrosweep.kernels.waveforms import Harmonics, for_each, next_phase, velocity
from vibrosweep.model.parameters import Dimensionless
from vibrosweep.model.shapes import TWO_PI

# --- The first landing ----------------------------------------------------------------------------
# As over a sine (`vibrosweep.kernels.bases.moving`), with w(x) = sum u_h, where a harmonic has u =
# c sin(th), v = c cos(th) at the phase of the lift-off.  After s periods, which differ by d from
# the nearest whole number, the clearance is
#
#     F(s) = s (y - s) / 2 - (alpha / 2) (sum (v_h C_h - u_h D_h) / (2 pi h) - (s - d) sum u_h),
#     C_h = 1 - cos(2 pi h d),  D_h = 2 pi h d - sin(2 pi h d),
#
# in which no term is a difference of nearly equal numbers.  The same holds for the recurrences from
# one harmonic to the next, C_(h+1) - C_h = C_h - C_(h-1) + 2 C_1 cos(2 pi h d), and for D with the
# sine.  G = alpha w' / 2 is the acceleration of the base in units of gravity.  F is concave while 1
# + G > 0, where the base presses, and convex elsewhere; a period has several such stretches, whose
# ends are known.  F certainly has a single root if the base never falls faster than gravity, or if
# the particle falls to the top level of the base faster than the base ever moves.


# Largest angle by which the highest harmonic turns in the last step; its fifth power is left out
SHORT = 2.0**-9

# Of a harmonic since the lift-off: S = sin(2 pi h d), D and C, and by how much D and C exceed those
# of the harmonic before
Turns = tuple[float, float, float, float, float]


class HarmonicsGuess(NamedTuple):
    """A guess of the landing, from the beginning of the flight alone."""

    sure: bool  # True if the clearance certainly has a single root
    time: float  # a time near the landing
    # rise, u: the particle is above every height of the base from time `rise` until `u - rise`; u
    # is its absolute speed, which is the duration of its flight over a base at rest
    rise: float
    u: float
    apex: float  # greatest height above the lowest level of the base


class Stretches(NamedTuple):
    """Phases at which the base begins to fall faster than gravity, and to press again.

    NaN where it does not.
    """

    falls: tuple[float, ...]
    presses: tuple[float, ...]


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
def stretch(fixed: MovingConstants, x: float) -> tuple[bool, float, float]:
    """Return whether the base presses at phase x, and periods until it falls, or presses again.

    A stretch that is within `BORDER` of its end counts as ended.
    """
    to_fall, to_press = np.inf, np.inf
    for k in range(len(fixed.x_lift.falls)):
        fall, press = fixed.x_lift.falls[k] - x, fixed.x_lift.presses[k] - x
        fall = fall + 1.0 if fall < 0.0 else fall
        press = press + 1.0 if press < 0.0 else press
        to_fall = fall if fall < to_fall else to_fall
        to_press = press if press < to_press else to_press
    presses = not to_press < to_fall
    over = (to_fall if presses else to_press) <= moving.BORDER
    return presses != over, to_fall, to_press


@jit
def clearance(
    fixed: MovingConstants, begin: Begin, s: float, turned: float, lag: float, c: float
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
    turned, lag = arithmetic.sin_and_lag(part, part)
    half = arithmetic.sin_near(0.5 * part)
    return turned, lag, 2.0 * half * half


@jit
def rough_turn(s: float) -> tuple[float, float, float]:
    """Return the functions of `turn` to about five digits."""
    part = s - np.rint(s)
    lag, c = arithmetic.rough_lag_and_versine(part)
    return fma(TWO_PI, part, -lag), lag, c


@jit
def first_guess(fixed: MovingConstants, begin: Begin) -> HarmonicsGuess:
    """Guess when the flight ends."""
    shape, alpha = fixed.base.waveform, fixed.alpha
    w, slope, level = at_phase(shape, begin.sine, begin.cosine)
    u = fma(alpha, w, begin.y)
    pull = fma(0.5 * alpha, slope, 1.0)
    depth = 4.0 * alpha * (shape.top - level)  # below the top, as the square of a speed
    largest = alpha * shape.fastest
    fast = (u > 0.0) & (u * u >= (largest * largest + depth) * (1.0 + 16.0 * moving.ULP))
    sure = fast | (0.5 * alpha * shape.fall <= 1.0 - 16.0 * moving.ULP)
    presses, to_fall, _ = stretch(fixed, begin.x)
    short = u if u > moving.SLOW else moving.SLOW
    most = short if sure else (to_fall if presses else u + moving.AHEAD)
    parabola = begin.y / pull if pull > 0.0 else np.inf
    s = parabola if parabola < most else most
    rising = u if u > 0.0 else 0.0
    return HarmonicsGuess(
        sure,
        u if (u > moving.FAST) & sure else s,
        0.5 * depth / u * (1.0 + 16.0 * moving.ULP) if u > 0.0 else np.inf,
        u,
        fma(rising, rising, 4.0 * alpha * (level - shape.bottom)),
    )


@jit
def first_try(fixed: MovingConstants, begin: Begin, sure: bool, s: float, rough: Clear) -> float:
    """Return the time to be tried first, from a guess and the clearance at that time."""
    f = rough.f
    s = moving.improved(s, f, rough.f1, rough.f2, rough.f3 * (f * f) / 6.0)
    # F is concave in the present stretch, or in the next one, before which it has no root
    presses, to_fall, to_press = stretch(fixed, begin.x)
    s = s if sure | (s < to_fall) else to_fall
    s = s if sure | presses | (s > to_press) else to_press
    return 0.0 if begin.y < 0.0 else s  # pushed into the base, it lands at once


@jit
def try_landing(
    fixed: MovingConstants, begin: Begin, guess: HarmonicsGuess, s: float, clear: Clear
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
    step, tried, small = moving.series_step(s, f1, Terms(newton, q, q3, q4))
    small &= abs(q5) <= moving.LAST * moving.LAST * moving.LAST * moving.LAST
    small &= abs(newton) <= SHORT / (TWO_PI * len(shape.p))
    nears = f1 < 0.0
    last = nears & (small | (abs(newton) <= moving.ULP * s))
    arrival = fma(step, fma(step, fma(step, f5 / 24.0, f4 / 6.0), 0.5 * f3), f2)
    arrival = -2.0 * fma(step, arrival, f1)
    ends, above = stretch(fixed, moving.phase_after(begin.x, s)), (guess.rise, guess.u - guess.rise)
    # the third derivative is at most alpha times the bend
    over = moving.across(ends, above, s, (f1, f2, 0.5 * alpha * shape.bend), newton, step)
    convex = 0.5 * alpha * shape.fall > 1.0 - 16.0 * moving.ULP
    tried = over if (f > 0.0) & convex & (not last) else tried
    swept = 2.0 * s if s < 0.5 else 1.0  # the terms of the base grow with the square of s
    noise = s * (alpha * swept * shape.rounding + moving.NOISE * 0.5 * (abs(begin.y) + s))
    grazes = (f <= 0.0) & (not (guess.sure | last)) & ((-f <= noise) | (not nears))
    tried = s if grazes else tried
    arrival = (-2.0 * f1 if nears else 0.0) if grazes else arrival
    return tried, arrival, last | grazes


class HarmonicsRows(NamedTuple):
    """Rows whose use differs from that over the base that moves as a sine."""

    F2: int
    F3: int
    F4: int
    F5: int
    SPEED: int  # absolute, at lift-off
    APEX: int


AT: Final = HarmonicsRows(ROW.SINE_THEN, ROW.COSINE_THEN, ROW.NEWTON, ROW.Q, ROW.Q3, ROW.Q4)
PRESSES: Final = ROW.PHASES + OF_PHASES // 2 * STRIDE
_falls_of = for_each("dip", "falls(shape, a, shape.dip[{k}], shape.before[{k}])")
_presses_of = for_each("dip", "falls(shape, a, shape.dip[{k}], shape.after[{k}])")
_falls_in = for_each("dip", f"s[{ROW.PHASES} + {{row}} + j]")
_presses_in = for_each("dip", f"s[{PRESSES} + {{row}} + j]")


implements(moving.lift_phases, Harmonics)(
    lambda shape, alpha: Stretches(
        _falls_of(shape, alpha, 0.0, 0.0, 0), _presses_of(shape, alpha, 0.0, 0.0, 0)
    )
)


@implements(bases.fly, MovingHarmonics)
def fly_harmonics(fixed: MovingConstants, x: float, u: float) -> tuple[float, float]:
    if not abs(x) <= 0.5:  # NaN: the particle rests for good
        return np.nan, np.nan
    if u == 0.0 and stretch(fixed, x)[0]:  # the base presses the particle
        return 0.0, 0.0
    begin = moving.begin_at(x, u)
    guess = first_guess(fixed, begin)
    rough = clearance(fixed, begin, guess.time, *rough_turn(guess.time))
    time = first_try(fixed, begin, guess.sure, guess.time, rough)
    v, landed, tries = 0.0, False, 0.0
    while not landed and tries <= moving.TRIES:
        clear = clearance(fixed, begin, time, *turn(time))
        time, v, landed = try_landing(fixed, begin, guess, time, clear)
        tries += 1.0 if clear.f == clear.f else moving.TRIES
    return time if landed else np.nan, v


@implements(bases.lift_off, MovingHarmonics)
def lift_off_harmonics(fixed: MovingConstants, n: float, x: float, w: float) -> LiftOff:
    presses, _, _ = stretch(fixed, x)
    leaves = (w > fixed.r) | (not presses)
    lift, passed = next_phase(fixed.x_lift.falls, x)
    later = n + passed if lift == lift else np.inf
    return LiftOff(n if leaves else later, x if leaves else lift, w if leaves else 0.0, leaves)


@implements(bases.after_rest, MovingHarmonics)
def after_rest_harmonics(fixed: MovingConstants) -> tuple[float, float]:
    lift = np.nan
    for k in range(len(fixed.x_lift.falls)):
        lift = fixed.x_lift.falls[k] if fixed.x_lift.falls[k] == fixed.x_lift.falls[k] else lift
    return lift, 0.0


@implements(bases.lifts_alike, MovingHarmonics)
def lifts_alike_harmonics(base: MovingHarmonics) -> bool:
    return base.noise is None and len(base.waveform.dip) <= 1


@implements(bases.leave, MovingHarmonics)
def leave_harmonics(fixed: MovingConstants, x: float, u: float) -> float:
    y = fma(-fixed.alpha, velocity(fixed.base.waveform, x), u)
    return -moving.TINY if y == 0.0 and stretch(fixed, x)[0] else y


@implements(bases.counted, MovingHarmonics)
def counted_harmonics(fixed: MovingConstants, flight: Flight, u_off: float) -> Counted:
    return Counted(flight.time, first_guess(fixed, moving.begin_at(flight.x, flight.u)).apex, 1.0)


@bases.lifts.register(MovingHarmonics)
def lifts_harmonics(base: MovingHarmonics, problem: Dimensionless) -> NDArray[np.bool_]:
    alpha = problem.kick / (1.0 + problem.restitution)
    return 0.5 * alpha * base.waveform.fall > 1.0


@bases.fitted.register(MovingHarmonics)
def fitted_harmonics(base: MovingHarmonics, problem: Dimensionless) -> MovingHarmonics:
    alpha = problem.kick / (1.0 + problem.restitution)
    if np.any(0.5 * alpha * base.waveform.fall > 1.0 - 2.0**-40):
        return base
    dip = base.waveform.dip[:1]  # no particle is ever lifted: one of several dips is enough
    return base._replace(waveform=base.waveform._replace(dip=dip, before=dip, after=dip))


@bases.lowest.register(MovingHarmonics)
def lowest_harmonics(base: MovingHarmonics, problem: Dimensionless) -> Floats | None:
    return -4.0 * base.waveform.bottom * (problem.kick / (1.0 + problem.restitution))


@implements(moving.put_lift, MovingHarmonics)
def put_lift_harmonics(base: MovingHarmonics, x_lift: Stretches, s: Floats, j: int) -> None:
    for k in range(len(x_lift.falls)):
        s[ROW.PHASES + k * STRIDE + j] = x_lift.falls[k]
        s[PRESSES + k * STRIDE + j] = x_lift.presses[k]


@implements(moving.take_lift, MovingHarmonics)
def take_lift_harmonics(base: MovingHarmonics, s: Floats, j: int) -> Stretches:
    shape = base.waveform
    return Stretches(_falls_in(shape, 0.0, 0.0, s, j), _presses_in(shape, 0.0, 0.0, s, j))


@implements(bases.prepare, MovingHarmonics)
def prepare_harmonics(base: MovingHarmonics, s: Floats, lanes: int) -> None:
    _near(base, s, lanes)
    _guess(base, s, lanes)
    _turn(base, s, lanes)
    _look(base, s, lanes)
    _try(base, s, lanes)


@jit
def _near(base: MovingHarmonics, s: Floats, lanes: int) -> None:
    """Guess when the flight of each lane ends."""
    wide_vectors()
    for j in range(lanes):
        x = s[ROW.X + j]
        s[ROW.SINE + j] = arithmetic.sin_turns(x)
        s[ROW.COSINE + j] = arithmetic.cos_turns(x)
        guess = first_guess(bases.take(base, s, j), moving.begun(s, j))
        s[ROW.SURE + j] = 1.0 if guess.sure else 0.0
        s[ROW.GUESS + j] = guess.time
        s[ROW.RISE + j] = guess.rise
        s[AT.SPEED + j] = guess.u
        s[AT.APEX + j] = guess.apex


@jit
def _guess(base: MovingHarmonics, s: Floats, lanes: int) -> None:
    """Compute the time to be tried first in a flight that has just begun."""
    wide_vectors()
    for j in range(lanes):
        fixed, begin, guess = bases.take(base, s, j), moving.begun(s, j), s[ROW.GUESS + j]
        rough = clearance(fixed, begin, guess, *rough_turn(guess))
        tried = first_try(fixed, begin, s[ROW.SURE + j] != 0.0, guess, rough)
        following = s[ROW.NEXT + j]
        s[ROW.REACHED + j] = tried if following < 0.0 else following


@jit
def _turn(base: MovingHarmonics, s: Floats, lanes: int) -> None:
    """Compute how far the base turns until the time that is to be tried."""
    wide_vectors()
    for j in range(lanes):
        s[ROW.TURNED + j], s[ROW.LAG + j], s[ROW.VERSINE + j] = turn(s[ROW.REACHED + j])


@jit
def _look(base: MovingHarmonics, s: Floats, lanes: int) -> None:
    """Compute the clearance of each lane at the time that is to be tried."""
    wide_vectors()
    for j in range(lanes):
        fixed, reached = bases.take(base, s, j), s[ROW.REACHED + j]
        turned, lag, c = s[ROW.TURNED + j], s[ROW.LAG + j], s[ROW.VERSINE + j]
        clear = clearance(fixed, moving.begun(s, j), reached, turned, lag, c)
        s[ROW.CLEAR + j], s[ROW.CLEAR_SLOPE + j] = clear.f, clear.f1
        s[AT.F2 + j], s[AT.F3 + j] = clear.f2, clear.f3
        s[AT.F4 + j], s[AT.F5 + j] = clear.f4, clear.f5


@jit
def _try(base: MovingHarmonics, s: Floats, lanes: int) -> None:
    """Find the landing of each lane, or the time to be tried next, from the clearance."""
    wide_vectors()
    for j in range(lanes):
        clear = Clear(
            s[ROW.CLEAR + j],
            s[ROW.CLEAR_SLOPE + j],
            s[AT.F2 + j],
            s[AT.F3 + j],
            s[AT.F4 + j],
            s[AT.F5 + j],
        )
        sure, rise, u = s[ROW.SURE + j] != 0.0, s[ROW.RISE + j], s[AT.SPEED + j]
        guess = HarmonicsGuess(sure, s[ROW.GUESS + j], rise, u, s[AT.APEX + j])
        fixed, begin, reached = bases.take(base, s, j), moving.begun(s, j), s[ROW.REACHED + j]
        time, v, landed = try_landing(fixed, begin, guess, reached, clear)
        s[ROW.TIME + j] = time
        s[ROW.SPEED + j] = v
        s[ROW.LANDED + j] = 1.0 if landed else 0.0


@implements(bases.counted_now, MovingHarmonics)
def counted_now_harmonics(
    fixed: MovingConstants, s: Floats, j: int, time: float, u_off: float
) -> Counted:
    return Counted(time, s[AT.APEX + j], 1.0)
