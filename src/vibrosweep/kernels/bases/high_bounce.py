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

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels import bases, noise
from vibrosweep.kernels._jit import Floats, fma, implements, jit, uncompiled
from vibrosweep.kernels.bases import Counted, Flight, Jacobian, LiftOff
from vibrosweep.kernels.deviates import LARGEST
from vibrosweep.kernels.lanes import ROW, STRIDE
from vibrosweep.kernels.laws import Law, direction, speed_after
from vibrosweep.kernels.noise import SILENT, STILL, Draw, Noise, Source
from vibrosweep.kernels.restitution import (
    Constant,
    Restitution,
    lost_speed,
    ratio,
    scale_of,
    slack,
    slope,
    straight,
)
from vibrosweep.kernels.waveforms import (
    LiftOffs,
    Shape,
    Sine,
    depth_of,
    kick_slope,
    lift_offs,
    lifts_once,
    next_lift_off,
    peak_of,
    put_phases,
    steepness,
    take_phases,
    velocity,
)
from vibrosweep.model.parameters import Dimensionless
from vibrosweep.model.shapes import TWO_PI


class HighBounce(NamedTuple):
    """The base: its laws of rebound and restitution, and the shape of its kick over a period."""

    law: Law
    waveform: Shape = Sine()
    restitution: Restitution = Constant()
    noise: Noise | None = None


class Constants(NamedTuple):
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
def constants_high_bounce(base: HighBounce, problem: Dimensionless, i: int) -> Constants:
    e, a, r = problem.restitution[i], problem.kick[i], problem.rest_flight[i]
    source = noise.source_of(problem.noise, problem.end_count, i)
    up, down = a * peak_of(base.waveform), a * depth_of(base.waveform)
    peak = noise.strongest(base.noise, up, down, source)
    wait, u_lift = (0.0, r) if peak > r else (np.inf, 0.0)
    x_lift = lift_offs(base.waveform, a, r, problem.liftoff_phase[i])
    scale = scale_of(base.restitution, e, problem.restitution_speed[i])
    return Constants(base, e, a, r, scale, x_lift, wait, u_lift, source, STILL)


@implements(bases.put, Constants)
def put_high_bounce(fixed: Constants, s: Floats, j: int) -> None:
    row = ROW.CONSTANTS + j
    s[row], s[row + STRIDE], s[row + 2 * STRIDE] = fixed.e, fixed.a, fixed.r
    put_phases(fixed.base.waveform, fixed.x_lift, fixed.wait, s, j)
    s[row + 4 * STRIDE] = fixed.u_lift
    if not straight(fixed.base.restitution):
        s[ROW.SCALE + j] = fixed.scale


@implements(bases.take, HighBounce)
def take_high_bounce(base: HighBounce, s: Floats, j: int) -> Constants:
    row = ROW.CONSTANTS + j
    e, a, r = s[row], s[row + STRIDE], s[row + 2 * STRIDE]
    draw, x_lift = noise.drawn_in(base.noise, s, j), take_phases(base.waveform, s, j)
    a, scale = noise.driven(base.noise, a, draw.drive), s[ROW.SCALE + j]
    return Constants(base, e, a, r, scale, x_lift, 0.0, s[row + 4 * STRIDE], SILENT, draw)


@implements(bases.fly, Constants)
def fly_high_bounce(fixed: Constants, x: float, u: float) -> tuple[float, float]:
    return u, u


@implements(bases.approach, Constants)
def approach_high_bounce(fixed: Constants, s: Floats, j: int) -> tuple[float, float, bool]:
    u = s[ROW.U + j]
    return u, u, noise.lands(fixed.base.noise, s, j)


@implements(bases.may_land, Constants)
def may_land_high_bounce(fixed: Constants, s: Floats, j: int, budget: float) -> bool:
    return noise.together(fixed.base.noise) == 1.0 or bool(s[ROW.AGE + j] < budget)


@implements(bases.keep, Constants)
def keep_high_bounce(
    fixed: Constants, s: Floats, j: int, time: float, landed: bool, seen: bool
) -> bool:
    noise.count_impact(fixed.base.noise, s, j, landed)
    return seen


@implements(bases.gives_up, HighBounce)
def gives_up_high_bounce(base: HighBounce, s: Floats, j: int, passes: int) -> bool:
    return False


@implements(bases.pending, HighBounce)
def pending_high_bounce(base: HighBounce, s: Floats, j: int) -> bool:
    return False


@implements(bases.common_age, HighBounce)
def common_age_high_bounce(base: HighBounce) -> float:
    return noise.together(base.noise)


@implements(bases.counted, Constants)
def counted_high_bounce(fixed: Constants, flight: Flight, u_off: float) -> Counted:
    return Counted(u_off, u_off, u_off)


@implements(bases.counted_now, Constants)
def counted_now_high_bounce(
    fixed: Constants, s: Floats, j: int, time: float, u_off: float
) -> Counted:
    return Counted(u_off, u_off, u_off)


@bases.lowest.register(HighBounce)
def lowest_high_bounce(base: HighBounce, problem: Dimensionless) -> Floats | None:
    return None


@bases.lifts.register(HighBounce)
def lifts_high_bounce(base: HighBounce, problem: Dimensionless) -> NDArray[np.bool_]:
    drive = None if problem.noise is None else problem.noise.drive
    strongest_kick = problem.kick * uncompiled(peak_of)(base.waveform)
    if drive is not None:
        down = problem.kick * uncompiled(depth_of)(base.waveform) * (LARGEST * drive - 1.0)
        strongest_kick = np.maximum(strongest_kick * (1.0 + LARGEST * drive), down)
    return strongest_kick > problem.rest_flight


@implements(bases.leave, Constants)
@implements(bases.speed, Constants)
def speed_high_bounce(fixed: Constants, x: float, u: float) -> float:
    return u


@implements(bases.rebound, Constants)
def rebound_high_bounce(fixed: Constants, x: float, v: float) -> float:
    return speed_after(fixed.base.law, _restitution(fixed, v), v, _kick(fixed, x))


@implements(bases.lift_off, Constants)
def lift_off_high_bounce(fixed: Constants, n: float, x: float, w: float) -> LiftOff:
    leaves = w > fixed.r
    x_lift, carry = next_lift_off(fixed.base.waveform, fixed.x_lift, x)
    known = n + (fixed.wait + carry), x_lift
    # in lanes, where `wait` is always 0, the phase NaN marks a rest for good
    has_phase = (fixed.u_lift > 0.0) | (fixed.wait > 0.0)
    later, x_lift = noise.lifted(
        fixed.base.noise, known, n + fixed.wait, x if has_phase else np.nan
    )
    kick = fixed.a * velocity(fixed.base.waveform, x)
    stays = not (leaves | noise.exceeds(fixed.base.noise, kick, fixed.r))
    return LiftOff(
        later if stays else n, x_lift if stays else x, w if leaves else fixed.u_lift, leaves
    )


@implements(bases.after_rest, Constants)
def after_rest_high_bounce(fixed: Constants) -> tuple[float, float]:
    return next_lift_off(fixed.base.waveform, fixed.x_lift, -0.5)[0], fixed.u_lift


@implements(bases.lifts_alike, HighBounce)
def lifts_alike_high_bounce(base: HighBounce) -> bool:
    return lifts_once(base.waveform) and base.noise is None


@implements(bases.contact_time, Constants)
def contact_time_high_bounce(fixed: Constants) -> float:
    return fixed.r


@jit
def _restitution(fixed: Constants, v: float) -> float:
    """Coefficient of restitution of an impact at speed v."""
    share = ratio(fixed.base.restitution, fixed.e, fixed.scale, v)
    return noise.slipped(fixed.base.noise, share, fixed.draw.slip)


@jit
def _slope(fixed: Constants, v: float) -> float:
    """Derivative by v of the speed that an impact leaves, without the kick."""
    law, e, scale = fixed.base.restitution, fixed.e, fixed.scale
    share, q = ratio(law, e, scale, v), slope(law, e, scale, v)
    return noise.slipped_slope(fixed.base.noise, share, q, fixed.draw.slip)


@jit
def _kick(fixed: Constants, x: float) -> float:
    """Kick of an impact at phase x."""
    kick = fixed.a * velocity(fixed.base.waveform, x)
    return noise.pushed(fixed.base.noise, kick, fixed.draw.push)


@jit
def _slopes(fixed: Constants, x: float, v: float) -> tuple[float, float]:
    """Derivatives of the speed after an impact by v and by the kick."""
    sign = direction(fixed.base.law, fma(_restitution(fixed, v), v, _kick(fixed, x)))
    return sign * _slope(fixed, v), sign


@implements(bases.jacobian, Constants)
def jacobian_high_bounce(fixed: Constants, flight: Flight) -> Jacobian:
    by_speed, by_kick = _slopes(fixed, flight.landing, flight.v)
    k = by_kick * kick_slope(fixed.base.waveform, fixed.a, flight.landing)
    size = 2.0 + slack(fixed.base.restitution) * abs(by_speed) + 2.0 * abs(k)
    steepest = max(TWO_PI, steepness(fixed.base.waveform))
    size += steepest * noise.swing(fixed.base.noise, fixed.a, fixed.draw.drive)
    return Jacobian(1.0, 1.0, k, by_speed + k, size)


@implements(bases.reverses, Constants)
def reverses_high_bounce(fixed: Constants, x: float, v: float) -> float:
    return -1.0 if _slopes(fixed, x, v)[0] < 0.0 else 1.0


@implements(bases.contraction, Constants)
def contraction_high_bounce(fixed: Constants, v: float) -> float:
    return abs(_slope(fixed, v))


@implements(bases.density, Constants)
def density_high_bounce(fixed: Constants, u: float) -> float:
    return 1.0


@implements(bases.fixed_residual, Constants)
def fixed_residual_high_bounce(
    fixed: Constants, x: float, k: float, sign: float
) -> tuple[float, float, float]:
    need = lost_speed(fixed.base.restitution, fixed.e, fixed.scale, k, sign)
    return _kick(fixed, x) - need, kick_slope(fixed.base.waveform, fixed.a, x), fixed.a


@implements(bases.fixed_attracts, Constants)
def fixed_attracts_high_bounce(fixed: Constants, x: float, k: float) -> bool:
    by_speed, by_kick = _slopes(fixed, x, k)
    pull = -by_kick * kick_slope(fixed.base.waveform, fixed.a, x)
    return abs(by_speed) < 1.0 and 0.0 < pull < 2.0 * (1.0 + by_speed)


@implements(bases.fixed_holds, Constants)
def fixed_holds_high_bounce(fixed: Constants, x: float, k: float) -> bool:
    return k > fixed.r
