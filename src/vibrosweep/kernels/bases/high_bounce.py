"""The high-bounce approximation: the base stays at height 0 and gives impulses.

A flight that begins with speed u lasts u and arrives with speed u; the kick at phase x is
a sin(2 pi x).  A resting particle is lifted when the kick rises through the threshold of rest.

An orbit that leaves with the flight k lands with it, so that the law must give the speed k for k
and the kick.  With the derivatives f and g of the speed after an impact by that before it and by
the kick, and s = 2 pi a cos(2 pi x), the Jacobian

    [[1, 1], [g s, f + g s]]

has the determinant f and the trace 1 + f + g s; both its eigenvalues are inside the unit circle
if and only if |f| < 1 and 0 < -g s < 2 (1 + f).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels import bases
from vibrosweep.kernels._jit import Floats, implements, jit
from vibrosweep.kernels.bases import Counted, Flight, Jacobian, error_bounds
from vibrosweep.kernels.bases.error_bounds import Spread
from vibrosweep.kernels.lanes import ROW, STRIDE
from vibrosweep.kernels.laws import (
    Law,
    curvature,
    kick_to_repeat,
    slopes,
    speed_after,
    speed_rounding,
)
from vibrosweep.kernels.rounding import HALF_ULP, KICK_ERROR, REST_ERROR, SMALLEST
from vibrosweep.kernels.sine import COSINE_ERROR, SINE_ERROR, cos_turns, sin_turns
from vibrosweep.model.arcsine import ARCSINE_ERROR
from vibrosweep.model.parameters import Dimensionless

# A landing phase is a sum below 1 of two exact numbers; near 0 its rounding is smaller.
LANDING_ERROR = 0.5 * HALF_ULP
# x_lift is the arcsine of r / a: four roundings of the ratio, then the function.
RATIO_ERROR = 4.0 * HALF_ULP
CURVATURE = 2.0 * math.pi * math.pi  # half the second derivative of sin(2 pi x)


class HighBounce(NamedTuple):
    """The base, with its law of rebound."""

    law: Law


class Constants(NamedTuple):
    """Numbers that decide the impacts of one realization."""

    base: HighBounce
    # e, a, r: restitution, kick and threshold of rest
    e: float
    a: float
    r: float
    # x_lift, wait, u_lift: of a rest: phase of the lift-off, 0 or infinite where there is none, and
    # next flight
    x_lift: float
    wait: float
    u_lift: float


@implements(bases.constants, HighBounce)
def constants_high_bounce(base: HighBounce, problem: Dimensionless, i: int) -> Constants:
    a, r = problem.kick[i], problem.rest_flight[i]
    wait, u_lift = (0.0, r) if a > r else (np.inf, 0.0)
    return Constants(base, problem.restitution[i], a, r, problem.liftoff_phase[i], wait, u_lift)


@implements(bases.put, Constants)
def put_high_bounce(fixed: Constants, s: Floats, j: int) -> None:
    row = ROW.CONSTANTS + j
    s[row], s[row + STRIDE], s[row + 2 * STRIDE] = fixed.e, fixed.a, fixed.r
    s[row + 3 * STRIDE] = fixed.x_lift if fixed.wait == 0.0 else np.nan
    s[row + 4 * STRIDE] = fixed.u_lift


@implements(bases.take, HighBounce)
def take_high_bounce(base: HighBounce, s: Floats, j: int) -> Constants:
    row = ROW.CONSTANTS + j
    e, a, r = s[row], s[row + STRIDE], s[row + 2 * STRIDE]
    return Constants(base, e, a, r, s[row + 3 * STRIDE], 0.0, s[row + 4 * STRIDE])


@implements(bases.fly, Constants)
def fly_high_bounce(fixed: Constants, x: float, u: float) -> tuple[float, float]:
    return u, u


@implements(bases.prepare, HighBounce)
def prepare_high_bounce(base: HighBounce, s: Floats, lanes: int) -> None:
    pass


@implements(bases.approach, Constants)
def approach_high_bounce(fixed: Constants, s: Floats, j: int) -> tuple[float, float, bool]:
    u = s[ROW.U + j]
    return u, u, True


@implements(bases.may_land, Constants)
def may_land_high_bounce(fixed: Constants, s: Floats, j: int, budget: float) -> bool:
    return True


@implements(bases.keep, Constants)
def keep_high_bounce(
    fixed: Constants, s: Floats, j: int, time: float, landed: bool, seen: bool
) -> bool:
    return seen


@implements(bases.gives_up, HighBounce)
def gives_up_high_bounce(base: HighBounce, s: Floats, j: int, passes: int) -> bool:
    return False


@implements(bases.pending, HighBounce)
def pending_high_bounce(base: HighBounce, s: Floats, j: int) -> bool:
    return False


@implements(bases.common_age, HighBounce)
def common_age_high_bounce(base: HighBounce) -> float:
    return 1.0


@implements(bases.counted, Constants)
def counted_high_bounce(fixed: Constants, flight: Flight, u_off: float) -> Counted:
    return Counted(u_off, u_off, u_off)


@implements(bases.counted_now, Constants)
def counted_now_high_bounce(
    fixed: Constants, s: Floats, j: int, time: float, u_off: float
) -> Counted:
    return Counted(u_off, u_off, u_off)


@bases.fitted.register(HighBounce)
def fitted_high_bounce(base: HighBounce, problem: Dimensionless) -> HighBounce:
    return base


@bases.lowest.register(HighBounce)
def lowest_high_bounce(base: HighBounce, problem: Dimensionless) -> Floats | None:
    return None


@bases.lifts.register(HighBounce)
def lifts_high_bounce(base: HighBounce, problem: Dimensionless) -> NDArray[np.bool_]:
    return problem.kick > problem.rest_flight


@implements(bases.leave, Constants)
def leave_high_bounce(fixed: Constants, x: float, u: float) -> float:
    return u


@implements(bases.speed, Constants)
def speed_high_bounce(fixed: Constants, x: float, u: float) -> float:
    return u


@implements(bases.rebound, Constants)
def rebound_high_bounce(fixed: Constants, x: float, v: float) -> float:
    return speed_after(fixed.base.law, fixed.e, v, fixed.a * sin_turns(x))


@implements(bases.lift_off, Constants)
def lift_off_high_bounce(
    fixed: Constants, n: float, x: float, w: float
) -> tuple[float, float, float, bool]:
    leaves = w > fixed.r
    later = n + (fixed.wait + (1.0 if x > fixed.x_lift else 0.0))
    return (
        n if leaves else later,
        x if leaves else fixed.x_lift,
        w if leaves else fixed.u_lift,
        leaves,
    )


@implements(bases.after_rest, Constants)
def after_rest_high_bounce(fixed: Constants) -> tuple[float, float]:
    return fixed.x_lift, fixed.u_lift


@implements(bases.contact_time, Constants)
def contact_time_high_bounce(fixed: Constants) -> float:
    return fixed.r


@jit
def _kick_slope(x: float, a: float) -> float:
    """Derivative of the kick a sin(2 pi x) by the phase."""
    return 2.0 * math.pi * a * cos_turns(x)


@implements(bases.jacobian, Constants)
def jacobian_high_bounce(fixed: Constants, flight: Flight) -> Jacobian:
    x, v = flight.landing, flight.v
    by_speed, by_kick = slopes(fixed.base.law, fixed.e, v, fixed.a * sin_turns(x))
    k = by_kick * _kick_slope(x, fixed.a)
    return 1.0, 1.0, k, by_speed + k, 2.0 + abs(by_speed) + 2.0 * abs(k)


@implements(error_bounds.jacobian_error, Constants)
def jacobian_error_high_bounce(
    fixed: Constants, flight: Flight, error: float, spread: Spread
) -> tuple[float, float, float]:
    by_phase = 2.0 * CURVATURE * fixed.a * (error + HALF_ULP)
    return 0.0, 2.0 * curvature(fixed.base.law, fixed.e) * spread[1], by_phase


@implements(bases.reverses, Constants)
def reverses_high_bounce(fixed: Constants, x: float, v: float) -> float:
    by_speed, _ = slopes(fixed.base.law, fixed.e, v, fixed.a * sin_turns(x))
    return -1.0 if by_speed < 0.0 else 1.0


@implements(bases.contraction, Constants)
def contraction_high_bounce(fixed: Constants, v: float) -> float:
    by_speed, _ = slopes(fixed.base.law, fixed.e, v, 0.0)
    return abs(by_speed)


@implements(bases.density, Constants)
def density_high_bounce(fixed: Constants, u: float) -> float:
    return 1.0


@implements(bases.fixed_residual, Constants)
def fixed_residual_high_bounce(
    fixed: Constants, x: float, k: float, sign: float
) -> tuple[float, float, float]:
    a = fixed.a
    need = kick_to_repeat(fixed.base.law, fixed.e, k, sign)
    return a * sin_turns(x) - need, _kick_slope(x, a), a


@implements(bases.fixed_attracts, Constants)
def fixed_attracts_high_bounce(fixed: Constants, x: float, k: float) -> bool:
    by_speed, by_kick = slopes(fixed.base.law, fixed.e, k, fixed.a * sin_turns(x))
    pull = -by_kick * _kick_slope(x, fixed.a)
    return abs(by_speed) < 1.0 and 0.0 < pull < 2.0 * (1.0 + by_speed)


@implements(bases.fixed_holds, Constants)
def fixed_holds_high_bounce(fixed: Constants, x: float, k: float) -> bool:
    return k > fixed.r


@implements(error_bounds.launch_error, Constants)
def launch_error_high_bounce(fixed: Constants, x: float, u: float) -> float:
    return KICK_ERROR * u + SMALLEST


@implements(error_bounds.landing_added, Constants)
def landing_added_high_bounce(
    fixed: Constants, flight: Flight, spread: Spread
) -> tuple[float, float]:
    moved: float = flight.x + (flight.u - np.rint(flight.u))
    return min(LANDING_ERROR, HALF_ULP * abs(moved)), 0.0


@implements(error_bounds.rebound_error, Constants)
def rebound_error_high_bounce(
    fixed: Constants, flight: Flight, added: tuple[float, float], error: float, v_error: float
) -> float:
    x, v = flight.landing, flight.v
    law, e, a, sine = fixed.base.law, fixed.e, fixed.a, sin_turns(x)
    w = speed_after(law, e, v, a * sine)
    kicked = abs(_kick_slope(x, a)) * added[0] + speed_rounding(law, e, v, w)
    kicked += a * (SINE_ERROR + KICK_ERROR + HALF_ULP) * abs(sine)
    kicked += a * (2.0 * math.pi * COSINE_ERROR + CURVATURE * error) * error
    return kicked + curvature(law, e) * v_error * v_error


@implements(error_bounds.absolute_error, Constants)
def absolute_error_high_bounce(fixed: Constants, x: float, u: float, spread: Spread) -> float:
    return spread[1]


@implements(error_bounds.rest_is_doubtful, Constants)
def rest_is_doubtful_high_bounce(fixed: Constants, x: float, w: float, spread: Spread) -> bool:
    return abs(w - fixed.r) <= spread[1] + REST_ERROR * fixed.r


@implements(error_bounds.liftoff_error, Constants)
def liftoff_error_high_bounce(fixed: Constants) -> tuple[float, float]:
    a, r = fixed.a, fixed.r
    if abs(a - r) <= KICK_ERROR * a + REST_ERROR * r:
        return np.inf, np.inf
    if a < r:  # it is never lifted
        return 0.0, 0.0
    ratio = r / a
    slope = math.sqrt(max(0.0, (1.0 - ratio) * (1.0 + ratio)))
    change = RATIO_ERROR * ratio
    if slope * slope <= 8.0 * change:  # the kick barely reaches the threshold
        return np.inf, np.inf
    return 2.0 * change / (2.0 * math.pi * slope) + ARCSINE_ERROR * fixed.x_lift, REST_ERROR * r
