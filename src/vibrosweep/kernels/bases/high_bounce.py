"""The high-bounce approximation: the base stays at height 0 and gives impulses.

A flight that begins with speed u lasts u and arrives with speed u; the kick at phase x is
a sin(2 pi x).  A resting particle lifts off when the kick rises through the threshold of rest.

On an orbit whose flights last k, an impact at the speed k leaves the speed k.  With the
derivatives f and g of the speed after an impact by the speed before it and by the kick, and s = 2
pi a cos(2 pi x), the Jacobian

    [[1, 1], [g s, f + g s]]

has the determinant f and the trace 1 + f + g s; both its eigenvalues are inside the unit circle
if and only if |f| < 1 and 0 < -g s < 2 (1 + f).
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels import bases, noise, restitution, waveforms
from vibrosweep.kernels._jit import Floats, fma, generic, implements, jit, uncompiled, wide_vectors
from vibrosweep.kernels.arithmetic import HALF_ULP, KICK_ERROR, REST_ERROR, SMALLEST
from vibrosweep.kernels.bases import Counted, Flight, Instant, Jacobian, LiftOff, Slopes, StateError
from vibrosweep.kernels.memory import ROW, STRIDE
from vibrosweep.kernels.noise import Draw, Noise, Source
from vibrosweep.kernels.restitution import Constant, Law, Restitution
from vibrosweep.kernels.waveforms import Harmonics, LiftOffs, Parabolic, Shape, Sine
from vibrosweep.model.parameters import Dimensionless
from vibrosweep.model.shapes import TWO_PI


class HighBounce(NamedTuple):
    """The base: its laws of rebound and restitution, and the shape of its kick over a period."""

    law: Law
    waveform: Shape = Sine()
    restitution: Restitution = Constant()
    noise: Noise | None = None


class HighBounceConstants(NamedTuple):
    """Numbers that decide the impacts of one realization."""

    base: HighBounce
    # e, a, r: restitution, kick and threshold of rest
    e: float
    a: float
    r: float
    scale: float  # of speeds, in the law of restitution
    # x_lift, wait, u_lift: end of a rest: phase or phases of the lift-off, the wait for it, which
    # is 0, or infinite if it never comes, and the next flight
    x_lift: LiftOffs
    wait: float
    u_lift: float
    # source, draw: noise of the realization, and of one impact
    source: Source
    draw: Draw


@implements(bases.constants, HighBounce)
def constants_high_bounce(base: HighBounce, problem: Dimensionless, i: int) -> HighBounceConstants:
    e, a, r = problem.restitution[i], problem.kick[i], problem.rest_flight[i]
    source = noise.source_of(problem.noise, problem.end_count, i)
    up, down = a * waveforms.peak_of(base.waveform), a * waveforms.depth_of(base.waveform)
    peak = noise.strongest_kick(base.noise, up, down, source)
    wait, u_lift = (0.0, r) if peak > r else (np.inf, 0.0)
    x_lift = waveforms.lift_offs(base.waveform, a, r, problem.liftoff_phase[i])
    scale = restitution.scale_of(base.restitution, e, problem.restitution_speed[i])
    return HighBounceConstants(base, e, a, r, scale, x_lift, wait, u_lift, source, noise.STILL)


@implements(bases.put, HighBounce)
def put_high_bounce(fixed: HighBounceConstants, s: Floats, j: int) -> None:
    row = ROW.CONSTANTS + j
    s[row], s[row + STRIDE], s[row + 2 * STRIDE] = fixed.e, fixed.a, fixed.r
    waveforms.put_phases(fixed.base.waveform, fixed.x_lift, fixed.wait, s, j)
    s[row + 4 * STRIDE] = fixed.u_lift
    if not restitution.is_constant(fixed.base.restitution):
        s[ROW.SCALE + j] = fixed.scale


@implements(bases.take, HighBounce)
def take_high_bounce(base: HighBounce, s: Floats, j: int) -> HighBounceConstants:
    row = ROW.CONSTANTS + j
    e, a, r = s[row], s[row + STRIDE], s[row + 2 * STRIDE]
    draw, x_lift = noise.drawn_in(base.noise, s, j), waveforms.take_phases(base.waveform, s, j)
    a, scale = noise.noisy_amplitude(base.noise, a, draw.drive), s[ROW.SCALE + j]
    return HighBounceConstants(
        base, e, a, r, scale, x_lift, 0.0, s[row + 4 * STRIDE], noise.SILENT, draw
    )


@implements(bases.fly, HighBounce)
def fly_high_bounce(fixed: HighBounceConstants, x: float, u: float) -> tuple[float, float]:
    return u, u


@implements(bases.approach, HighBounce)
def approach_high_bounce(
    fixed: HighBounceConstants, s: Floats, j: int
) -> tuple[float, float, bool]:
    u = s[ROW.U + j]
    return u, u, noise.lands_now(fixed.base.noise, s, j)


@implements(bases.may_land, HighBounce)
def may_land_high_bounce(fixed: HighBounceConstants, s: Floats, j: int, budget: float) -> bool:
    return noise.every_pass(fixed.base.noise) == 1.0 or bool(s[ROW.AGE + j] < budget)


@implements(bases.end_pass, HighBounce)
def end_pass_high_bounce(
    fixed: HighBounceConstants, s: Floats, j: int, time: float, landed: bool, seen: bool
) -> bool:
    noise.count_impact(fixed.base.noise, s, j, landed)
    return seen


@implements(bases.abandons, HighBounce)
def abandons_high_bounce(base: HighBounce, s: Floats, j: int, passes: int) -> bool:
    return False


@implements(bases.pending, HighBounce)
def pending_high_bounce(base: HighBounce, s: Floats, j: int) -> bool:
    return False


@implements(bases.common_age, HighBounce)
def common_age_high_bounce(base: HighBounce) -> float:
    return noise.every_pass(base.noise)


@implements(bases.counted, HighBounce)
def counted_high_bounce(fixed: HighBounceConstants, flight: Flight, u_off: float) -> Counted:
    return Counted(u_off, u_off, u_off)


@implements(bases.counted_now, HighBounce)
def counted_now_high_bounce(
    fixed: HighBounceConstants, s: Floats, j: int, time: float, u_off: float
) -> Counted:
    return Counted(u_off, u_off, u_off)


@bases.lowest.register(HighBounce)
def lowest_high_bounce(base: HighBounce, problem: Dimensionless) -> Floats | None:
    return None


@bases.lifts.register(HighBounce)
def lifts_high_bounce(base: HighBounce, problem: Dimensionless) -> NDArray[np.bool_]:
    drive = None if problem.noise is None else problem.noise.drive
    strongest_kick = problem.kick * uncompiled(waveforms.peak_of)(base.waveform)
    if drive is not None:
        down = (
            problem.kick
            * uncompiled(waveforms.depth_of)(base.waveform)
            * (noise.LARGEST * drive - 1.0)
        )
        strongest_kick = np.maximum(strongest_kick * (1.0 + noise.LARGEST * drive), down)
    return strongest_kick > problem.rest_flight


@implements(bases.leave, HighBounce)
@implements(bases.speed, HighBounce)
def speed_high_bounce(fixed: HighBounceConstants, x: float, u: float) -> float:
    return u


@implements(bases.rebound, HighBounce)
def rebound_high_bounce(fixed: HighBounceConstants, x: float, v: float) -> float:
    return restitution.speed_after(fixed.base.law, _restitution(fixed, v), v, _kick(fixed, x))


@implements(bases.lift_off, HighBounce)
def lift_off_high_bounce(fixed: HighBounceConstants, n: float, x: float, w: float) -> LiftOff:
    leaves = w > fixed.r
    x_lift, carry = waveforms.next_lift_off(fixed.base.waveform, fixed.x_lift, x)
    known = n + (fixed.wait + carry), x_lift
    # in lanes, where `wait` is always 0, the phase NaN marks a rest for good
    has_phase = (fixed.u_lift > 0.0) | (fixed.wait > 0.0)
    later, x_lift = noise.noisy_lift_off(
        fixed.base.noise, known, n + fixed.wait, x if has_phase else np.nan
    )
    kick = fixed.a * waveforms.velocity(fixed.base.waveform, x)
    stays = not (leaves | noise.lifts_at_once(fixed.base.noise, kick, fixed.r))
    return LiftOff(
        later if stays else n, x_lift if stays else x, w if leaves else fixed.u_lift, leaves
    )


@implements(bases.after_rest, HighBounce)
def after_rest_high_bounce(fixed: HighBounceConstants) -> tuple[float, float]:
    return waveforms.next_lift_off(fixed.base.waveform, fixed.x_lift, -0.5)[0], fixed.u_lift


@implements(bases.lifts_alike, HighBounce)
def lifts_alike_high_bounce(base: HighBounce) -> bool:
    return waveforms.lifts_once(base.waveform) and base.noise is None


@implements(bases.contact_time, HighBounce)
def contact_time_high_bounce(fixed: HighBounceConstants) -> float:
    return fixed.r


@jit
def _restitution(fixed: HighBounceConstants, v: float) -> float:
    """Coefficient of restitution of an impact at speed v."""
    share = restitution.ratio(fixed.base.restitution, fixed.e, fixed.scale, v)
    return noise.noisy_restitution(fixed.base.noise, share, fixed.draw.restitution)


@jit
def _slope(fixed: HighBounceConstants, v: float) -> float:
    """Derivative by v of the speed that an impact leaves, without the kick."""
    law, e, scale = fixed.base.restitution, fixed.e, fixed.scale
    share, q = restitution.ratio(law, e, scale, v), restitution.slope(law, e, scale, v)
    return noise.noisy_slope(fixed.base.noise, share, q, fixed.draw.restitution)


@jit
def _kick(fixed: HighBounceConstants, x: float) -> float:
    """Kick of an impact at phase x."""
    kick = fixed.a * waveforms.velocity(fixed.base.waveform, x)
    return noise.noisy_kick(fixed.base.noise, kick, fixed.draw.kick)


@jit
def _slopes(fixed: HighBounceConstants, x: float, v: float) -> tuple[float, float]:
    """Derivatives of the speed after an impact by v and by the kick."""
    sign = restitution.direction(fixed.base.law, fma(_restitution(fixed, v), v, _kick(fixed, x)))
    return sign * _slope(fixed, v), sign


@implements(bases.jacobian, HighBounce)
def jacobian_high_bounce(fixed: HighBounceConstants, flight: Flight) -> Jacobian:
    by_speed, by_kick = _slopes(fixed, flight.landing, flight.v)
    k = by_kick * waveforms.kick_slope(fixed.base.waveform, fixed.a, flight.landing)
    size = 2.0 + restitution.slack(fixed.base.restitution) * abs(by_speed) + 2.0 * abs(k)
    steepest = max(TWO_PI, waveforms.steepness(fixed.base.waveform))
    size += steepest * noise.amplitude_change(fixed.base.noise, fixed.a, fixed.draw.drive)
    return Jacobian(1.0, 1.0, k, by_speed + k, size)


@implements(bases.reverses, HighBounce)
def reverses_high_bounce(fixed: HighBounceConstants, x: float, v: float) -> float:
    return -1.0 if _slopes(fixed, x, v)[0] < 0.0 else 1.0


@implements(bases.contraction, HighBounce)
def contraction_high_bounce(fixed: HighBounceConstants, v: float) -> float:
    return abs(_slope(fixed, v))


@implements(bases.density, HighBounce)
def density_high_bounce(fixed: HighBounceConstants, u: float) -> float:
    return 1.0


@implements(bases.fixed_residual, HighBounce)
def fixed_residual_high_bounce(
    fixed: HighBounceConstants, x: float, k: float, sign: float
) -> tuple[float, float, float]:
    need = restitution.lost_speed(fixed.base.restitution, fixed.e, fixed.scale, k, sign)
    return _kick(fixed, x) - need, waveforms.kick_slope(fixed.base.waveform, fixed.a, x), fixed.a


@implements(bases.fixed_attracts, HighBounce)
def fixed_attracts_high_bounce(fixed: HighBounceConstants, x: float, k: float) -> bool:
    by_speed, by_kick = _slopes(fixed, x, k)
    pull = -by_kick * waveforms.kick_slope(fixed.base.waveform, fixed.a, x)
    return abs(by_speed) < 1.0 and 0.0 < pull < 2.0 * (1.0 + by_speed)


@implements(bases.fixed_holds, HighBounce)
def fixed_holds_high_bounce(fixed: HighBounceConstants, x: float, k: float) -> bool:
    return k > fixed.r


@implements(bases.chord, HighBounce)
def chord_high_bounce(fixed: HighBounceConstants, x: float, s: float) -> tuple[float, float]:
    return s, s


@implements(bases.slopes, HighBounce)
def slopes_high_bounce(fixed: HighBounceConstants, arc: Flight) -> Slopes:
    xx, xu, ux, uu, _ = bases.jacobian(fixed, arc)
    return Slopes(1.0, xx, xu, ux, uu, uu - ux)


@implements(bases.clearing, HighBounce)
def clearing_high_bounce(fixed: HighBounceConstants, arc: Flight) -> float:
    return np.inf


# --- Lift-off from a rest in one forcing period, with noise of the drive --------------------------


USELESS: Final = 2.0**-20  # turns; a larger bound on the error of a lift-off is of no use


@generic
def lift_in(shape: Shape, kick: float, r: float, after: float, rests: bool) -> tuple[bool, float]:
    """Return whether the kick exceeds r in a period from `after` on, and when first, in turns.

    The result has no meaning for a particle that does not rest.
    """


@generic
def lift_in_error(
    shape: Shape, a: float, drive: float, r: float, after: float, error: float
) -> tuple[bool, float]:
    """Return whether `lift_in` lifts, and a bound on the error of its time.

    `error` is that of `after`.  The bound is infinite where either is in doubt.  The kick of a
    period, a (1 + drive), takes two more roundings than without noise, and its noise another two.
    """


@implements(lift_in, Sine, Parabolic)
def lift_in_even(
    shape: Shape, kick: float, r: float, after: float, rests: bool
) -> tuple[bool, float]:
    rises = waveforms.rise_of(shape, r / abs(kick))
    falls = 0.5 - rises
    # where it is negative the kick is upward in the second half of the period
    rises, falls = (0.5 + rises, 0.5 + falls) if kick < 0.0 else (rises, falls)
    return (abs(kick) > r) & (after < falls), max(after, rises)


@implements(lift_in_error, Sine, Parabolic)
def lift_in_error_even(
    shape: Shape, a: float, drive: float, r: float, after: float, error: float
) -> tuple[bool, float]:
    kick = abs(fma(a, drive, a))
    off = 2.0 * KICK_ERROR * (kick + a * abs(drive)) + REST_ERROR * r
    if not abs(kick - r) > 2.0 * off:
        return True, np.inf
    if not kick > r:
        return False, 0.0
    rises = waveforms.rise_of(shape, r / kick)
    factor = 3.0 + a * abs(drive) / kick
    edge = error + (factor * waveforms.lift_off_error(shape, kick, r, rises) + 4.0 * HALF_ULP)
    turned = 0.5 if 1.0 + drive < 0.0 else 0.0
    rises, falls = turned + rises, turned + 0.5 - rises
    if not min(abs(after - rises), abs(after - falls)) > edge or edge > USELESS:
        return True, np.inf
    return after < falls, error if after > rises else edge


@implements(lift_in, Harmonics)
def lift_in_harmonics(
    shape: Harmonics, kick: float, r: float, after: float, rests: bool
) -> tuple[bool, float]:
    if not rests:
        return False, after
    begun = waveforms.velocity(shape, after - np.rint(after)) if after > 0.0 else shape.extremes[-1]
    if kick * begun > r:
        return True, after
    for k in range(len(shape.turns)):
        if shape.turns[k] > after:
            if kick * shape.extremes[k] > r:
                return True, waveforms.rises_through(shape, kick, r, after, shape.turns[k])
            after = shape.turns[k]
    return False, after


@implements(lift_in_error, Harmonics)
def lift_in_error_harmonics(
    shape: Harmonics, a: float, drive: float, r: float, after: float, error: float
) -> tuple[bool, float]:
    kick = fma(a, drive, a)
    size = abs(kick)
    more = 2.0 * KICK_ERROR * (size + a * abs(drive)) * shape.fastest
    x, near = after - np.rint(after), error + HALF_ULP * after
    w = waveforms.velocity(shape, x)
    off = waveforms.kick_rounding(shape, size, w) + REST_ERROR * r + more
    off += abs(waveforms.kick_slope(shape, kick, x)) * near + waveforms.kick_remainder(
        shape, size, x, near
    )
    if not abs(kick * w - r) > 2.0 * off:
        return True, np.inf
    if kick * w > r:
        return True, near
    for k in range(len(shape.turns)):
        w = shape.extremes[k]
        off = waveforms.kick_rounding(shape, size, w) + REST_ERROR * r + more
        if shape.turns[k] > after and not abs(kick * w - r) > 2.0 * off:
            return True, np.inf
        if shape.turns[k] > after and kick * w > r:
            x = waveforms.rises_through(shape, kick, r, after, shape.turns[k])
            return True, waveforms.rise_error(shape, kick, r, x - np.rint(x), more)
        after = max(after, shape.turns[k])
    return False, 0.0


# --- Random impacts, and ends of rests ------------------------------------------------------------
# Where the amplitude is random, a particle that has come to rest is lifted in the first forcing
# period whose kick rises through the threshold of rest; no formula gives this period.


LONGEST: Final = 2**24  # forcing periods after which the search for a lift-off ends


@implements(bases.random, HighBounce)
def random_high_bounce(
    fixed: HighBounceConstants, particle: float, number: float, n: float, x: float
) -> HighBounceConstants:
    period = noise.period_of(n + fixed.source.turns, x)
    draw = noise.draw_of(fixed.base.noise, fixed.source, particle, number, period)
    e, a, r, scale = (
        fixed.e,
        noise.noisy_amplitude(fixed.base.noise, fixed.a, draw.drive),
        fixed.r,
        fixed.scale,
    )
    x_lift, wait, u_lift, source = fixed.x_lift, fixed.wait, fixed.u_lift, fixed.source
    return HighBounceConstants(fixed.base, e, a, r, scale, x_lift, wait, u_lift, source, draw)


@jit
def random_drive(random: Noise | None) -> int | None:
    """Return the field `drive` of the noise of a base; None if there is no noise."""
    if random is None:
        return None
    return random.drive


@jit
def _first_lift(fixed: HighBounceConstants, n: float, x: float) -> tuple[float, float]:
    """Whole periods and phase at which the kick first exceeds r from (n, x) on.

    The counts include the whole turns in the phase at t = 0.  After `LONGEST` periods the search
    ends: the count is NaN then.
    """
    random, period, size = fixed.base.noise, noise.period_of(n, x), fixed.source.drive
    key, stream = random.key, fixed.source.stream  # type: ignore[union-attr]
    after = x + (n - period)  # turns from the beginning of the period, in [0, 1]
    for _ in range(LONGEST):
        kick = noise.noisy_amplitude(
            random, fixed.a, size * noise.deviate(key, stream, 0.0, period, noise.OF_DRIVE)
        )
        lifts, after = lift_in(fixed.base.waveform, kick, fixed.r, after, True)
        if lifts:
            whole = np.rint(after)
            return period + whole, after - whole
        period, after = period + 1.0, 0.0
    return np.nan, 0.0


@jit
def first_lift_error(fixed: HighBounceConstants, n: float, x: float, error: float) -> StateError:
    """Bounds on the errors of `_first_lift`, from that of the phase x of the rest.

    The bound of the phase is infinite where it is in doubt which forcing period lifts the particle.
    """
    shape, a, r = fixed.base.waveform, fixed.a, fixed.r
    period, size = noise.period_of(n + fixed.source.turns, x), fixed.source.drive
    key, stream = fixed.base.noise.key, fixed.source.stream  # type: ignore[union-attr]
    after = x + (n + fixed.source.turns - period)
    for _ in range(LONGEST):
        drive = size * noise.deviate(key, stream, 0.0, period, noise.OF_DRIVE)
        lifts, off = lift_in_error(shape, a, drive, r, after, error)
        if lifts:
            return StateError(off, REST_ERROR * r if off < np.inf else np.inf)
        period, after, error = period + 1.0, 0.0, 0.0
    return StateError(np.inf, np.inf)


@implements(bases.later_lift_off, HighBounce)
def later_lift_off_high_bounce(
    fixed: HighBounceConstants, n: float, x: float, origin: float
) -> tuple[float, float]:
    return _later_lift_off(random_drive(fixed.base.noise), fixed, n, x, origin)


@jit
def _later_lift_off(
    on: int | None, fixed: HighBounceConstants, n: float, x: float, origin: float
) -> tuple[float, float]:
    if on is None or n == np.inf:
        return n, x
    origin += fixed.source.turns
    whole, phase = _first_lift(fixed, n + origin, x)
    return whole - origin, phase


@implements(bases.prepare, HighBounce)
def prepare_high_bounce(base: HighBounce, s: Floats, lanes: int) -> None:
    _try_lift_offs(random_drive(base.noise), base, s, lanes)


@jit
def _try_lift_offs(on: int | None, base: HighBounce, s: Floats, lanes: int) -> None:
    """Check in each resting lane if its present period ends the rest, as `_first_lift` does."""
    if on is not None:
        wide_vectors()
        for j in range(lanes):
            a, r = s[ROW.CONSTANTS + STRIDE + j], s[ROW.CONSTANTS + 2 * STRIDE + j]
            n, x, origin = s[ROW.N + j], s[ROW.X + j], s[ROW.ORIGIN + j]
            tried = s[ROW.RESTING + j]
            period = noise.period_of(n + origin, x)
            kick = noise.noisy_amplitude(base.noise, a, s[ROW.DRIVE_DRAWN + j])
            rests = tried > 0.0
            lifts, after = lift_in(base.waveform, kick, r, x + (n + origin - period), rests)
            abandoned = rests & (tried >= LONGEST) & (not lifts)
            whole = np.rint(after) if lifts else 1.0
            x_off = after - whole if lifts else 0.0
            s[ROW.N + j] = period + whole - origin if rests else n
            s[ROW.X + j] = (np.nan if abandoned else x_off) if rests else x
            s[ROW.AGE + j] = np.inf if abandoned else s[ROW.AGE + j]
            s[ROW.RESTING + j] = (-1.0 if lifts else tried + 1.0) if rests else tried


# --- Bounds on the errors that an impact adds -----------------------------------------------------


@implements(bases.jacobian_error, HighBounce)
def jacobian_error_high_bounce(
    fixed: HighBounceConstants, flight: Flight, error: float, spread: StateError
) -> tuple[float, float, float]:
    by_phase = waveforms.kick_bend(fixed.base.waveform, abs(fixed.a), flight.landing, error)
    change = restitution.slope_change(
        fixed.base.restitution, fixed.e, fixed.scale, flight.v, spread.speed
    )[1]
    return 0.0, change, by_phase


@implements(bases.launch_error, HighBounce)
def launch_error_high_bounce(fixed: HighBounceConstants, x: float, u: float) -> float:
    return KICK_ERROR * u + SMALLEST


@implements(bases.landing_added, HighBounce)
def landing_added_high_bounce(
    fixed: HighBounceConstants, flight: Flight, spread: StateError
) -> StateError:
    return StateError(bases.landing_rounding(flight), 0.0)


@implements(bases.rebound_error, HighBounce)
def rebound_error_high_bounce(
    fixed: HighBounceConstants, flight: Flight, added: StateError, error: float, spread: StateError
) -> float:
    x, v = flight.landing, flight.v
    law, e, scale = fixed.base.restitution, fixed.e, fixed.scale
    a, shape = fixed.a, fixed.base.waveform
    share, of_base = restitution.ratio(law, e, scale, v), waveforms.velocity(shape, x)
    random, draw = fixed.base.noise, fixed.draw
    kick = a * of_base
    w = fma(
        noise.noisy_restitution(random, share, draw.restitution),
        v,
        noise.noisy_kick(random, kick, draw.kick),
    )
    kicked = abs(waveforms.kick_slope(shape, a, x)) * added.phase + (HALF_ULP * abs(w) + SMALLEST)
    kicked += restitution.ratio_error(law, e, scale, v) * (share * v)
    kicked += waveforms.kick_rounding(shape, abs(a), of_base)
    kicked += waveforms.kick_remainder(shape, abs(a), x, error)
    kicked += restitution.slope_change(law, e, scale, v, spread.speed)[1] * spread.speed
    kicked += noise.rounding(random, share, v, draw, kick)
    kicked += 2.0 * HALF_ULP * noise.amplitude_change(random, a, draw.drive) * abs(of_base)
    clips = not restitution.is_constant(law) and noise.clip_is_doubtful(
        random, share, draw.restitution, spread.speed / v
    )
    return np.inf if clips or noise.period_is_doubtful(random, x, error) else kicked


@implements(bases.absolute_error, HighBounce)
def absolute_error_high_bounce(
    fixed: HighBounceConstants, x: float, u: float, spread: StateError
) -> float:
    return spread.speed


@implements(bases.rest_is_doubtful, HighBounce)
def rest_is_doubtful_high_bounce(
    fixed: HighBounceConstants, x: float, w: float, spread: StateError
) -> bool:
    return abs(w - fixed.r) <= spread.speed + REST_ERROR * fixed.r


@implements(bases.liftoff_error, HighBounce)
def liftoff_error_high_bounce(fixed: HighBounceConstants) -> StateError:
    shape, a, r = fixed.base.waveform, fixed.a, fixed.r
    most = a * waveforms.peak_of(shape)
    if abs(most - r) <= KICK_ERROR * most + REST_ERROR * r:
        return StateError(np.inf, np.inf)
    if most < r:  # it is never lifted
        return StateError(0.0, 0.0)
    error = waveforms.lift_off_error(shape, a, r, fixed.x_lift)
    return StateError(error, REST_ERROR * r if error < np.inf else np.inf)


@implements(bases.liftoff_error_after, HighBounce)
def liftoff_error_after_high_bounce(
    fixed: HighBounceConstants, n: float, x: float, error: float, later: Instant
) -> StateError:
    random = fixed.base.noise
    return _liftoff_error_after(random, random_drive(random), fixed, Instant(n, x), error, later)


@jit
def _liftoff_error_after(
    random: Noise | None,
    on: int | None,
    fixed: HighBounceConstants,
    begin: Instant,
    error: float,
    later: Instant,
) -> StateError:
    n, x = begin
    shape, a, r = fixed.base.waveform, fixed.a, fixed.r
    if on is not None:
        up, down = a * waveforms.peak_of(shape), a * waveforms.depth_of(shape)
        most = noise.strongest_kick(random, up, down, fixed.source)
        if abs(most - r) <= 2.0 * KICK_ERROR * most + REST_ERROR * r:
            return StateError(np.inf, np.inf)
        if most < r:
            return StateError(0.0, 0.0)
        return first_lift_error(fixed, n, x, error)
    if random is not None:
        of_base = waveforms.velocity(shape, x)
        off = abs(waveforms.kick_slope(shape, a, x)) * error + waveforms.kick_remainder(
            shape, a, x, error
        )
        off += waveforms.kick_rounding(shape, a, of_base) + REST_ERROR * r
        if not abs(a * of_base - r) > 2.0 * off:
            return StateError(np.inf, np.inf)
        if a * of_base > r:  # pushed down by the noise
            return StateError(error, REST_ERROR * r)
    return bases.unless_doubtful(bases.liftoff_error(fixed), x, error, later)
