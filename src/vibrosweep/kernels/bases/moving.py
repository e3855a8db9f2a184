"""The base that moves with the velocity alpha sin(2 pi x), alpha = a / (1 + e).

Speeds are relative to it: a particle arrives with z and leaves with e z.  It comes to rest where
that is at most r and the base presses it, 1 + Gamma cos(2 pi x) > 0 with Gamma = pi alpha, and is
lifted, with speed 0, where the base begins to fall faster than gravity; never if Gamma <= 1.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels import bases
from vibrosweep.kernels._jit import Floats, answer, fma, jit, wide_vectors
from vibrosweep.kernels.bases import Counted, Flight
from vibrosweep.kernels.bases.landing_search import (
    Clearance,
    Start,
    absolute,
    clearance,
    first_try,
    start,
    try_landing,
    turn,
)
from vibrosweep.kernels.lanes import ROW, STRIDE
from vibrosweep.kernels.laws import Law
from vibrosweep.kernels.sine import cos_turns, sin_turns
from vibrosweep.model.parameters import Dimensionless

__all__ = ["Moving", "MovingConstants"]

TWO_PI = 2.0 * math.pi
AT_LANDING = 2.0**-20  # periods; a landing on the way is farther than that from the end of a flight
FRESH = -1.0  # instead of the time that has been reached: the flight has just begun
TRIES = 20000.0  # passes after which the search for a landing is given up
LARGEST_GAMMA = 1e9  # beyond it a slow particle meets the base more often than can be searched
TINY = 1e-300  # of a speed: pushed into the base, if ever so little


class Moving(NamedTuple):
    """The base.

    Attributes
    ----------
    law
        `Rest`, the only one with a meaning here.
    arcs
        None where Gamma <= 1 in all realizations, so that no particle is ever lifted.
    """

    law: Law
    arcs: int | None = 1


class MovingConstants(NamedTuple):
    """What decides the impacts of one realization.

    Attributes
    ----------
    base
        The base.
    e, alpha, r
        Restitution, largest velocity of the base, and threshold of rest.
    x_lift
        Phase at which the base begins to fall faster than gravity, and a resting particle leaves
        it; NaN where it never does.
    """

    base: Moving
    e: float
    alpha: float
    r: float
    x_lift: float


@answer(bases.constants, Moving)
def _(base: Moving, problem: Dimensionless, i: int) -> MovingConstants:
    e = problem.restitution[i]
    alpha = problem.kick[i] / (1.0 + e)
    gamma = math.pi * alpha
    x_lift = np.nan
    if gamma > LARGEST_GAMMA:
        alpha = np.nan
    elif gamma > 1.0:
        # half the angle from pi, whose sine loses nothing near Gamma = 1
        x_lift = 0.5 - math.asin(math.sqrt((gamma - 1.0) / (2.0 * gamma))) / math.pi
    return MovingConstants(base, e, alpha, problem.rest_flight[i], x_lift)


@answer(bases.put, MovingConstants)
def _(fixed: MovingConstants, s: Floats, j: int) -> None:
    row = ROW.CONSTANTS + j
    s[row], s[row + STRIDE], s[row + 2 * STRIDE] = fixed.e, fixed.alpha, fixed.r
    s[row + 3 * STRIDE] = fixed.x_lift
    s[ROW.NEXT + j], s[ROW.COUNTS + j] = FRESH, 0.0
    s[ROW.TRIES + j], s[ROW.AGE_SEEN + j] = 0.0, 0.0


@answer(bases.take, Moving)
def _(base: Moving, s: Floats, j: int) -> MovingConstants:
    row = ROW.CONSTANTS + j
    e, alpha, r = s[row], s[row + STRIDE], s[row + 2 * STRIDE]
    return MovingConstants(base, e, alpha, r, s[row + 3 * STRIDE])


@answer(bases.prepare, Moving)
def _(base: Moving, s: Floats, lanes: int) -> None:
    # many short loops: a processor computes several lanes at once where their chains of dependent
    # operations are short enough to be under way together
    _begin(base, s, lanes)
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
        s[ROW.SINE + j] = sin_turns(x)
        s[ROW.COSINE + j] = cos_turns(x)


@jit
def _guess(base: Moving, s: Floats, lanes: int) -> None:
    """Compute what is to be tried first in a flight that has just begun."""
    wide_vectors()
    for j in range(lanes):
        sure, tried = first_try(_begun(bases.take(base, s, j), s, j), base.arcs)
        following = s[ROW.NEXT + j]
        s[ROW.REACHED + j] = tried if following < 0.0 else following
        s[ROW.SURE + j] = 1.0 if sure else 0.0


@jit
def _turn(base: Moving, s: Floats, lanes: int) -> None:
    """Compute how far the base turns until the time that is to be tried."""
    wide_vectors()
    for j in range(lanes):
        s[ROW.TURNED + j], s[ROW.LAG + j], s[ROW.VERSINE + j] = turn(s[ROW.REACHED + j])


@jit
def _look(base: Moving, s: Floats, lanes: int) -> None:
    """Compute the clearance of each lane at the time that is to be tried."""
    wide_vectors()
    for j in range(lanes):
        begin = _begun(bases.take(base, s, j), s, j)
        turned, lag, c = s[ROW.TURNED + j], s[ROW.LAG + j], s[ROW.VERSINE + j]
        clear = clearance(begin, s[ROW.REACHED + j], turned, lag, c)
        s[ROW.CLEAR + j] = clear.f
        s[ROW.CLEAR_SLOPE + j] = clear.f1
        s[ROW.SINE_THEN + j] = clear.sine
        s[ROW.COSINE_THEN + j] = clear.cosine


@jit
def _try(base: Moving, s: Floats, lanes: int) -> None:
    """Judge the clearance: the landing of each lane, or what is to be tried next."""
    wide_vectors()
    for j in range(lanes):
        clear = Clearance(
            s[ROW.CLEAR + j],
            s[ROW.CLEAR_SLOPE + j],
            s[ROW.SINE_THEN + j],
            s[ROW.COSINE_THEN + j],
        )
        sure, reached = s[ROW.SURE + j] != 0.0, s[ROW.REACHED + j]
        begin = _begun(bases.take(base, s, j), s, j)
        time, v, landed = try_landing(begin, sure, reached, clear, base.arcs)
        s[ROW.TIME + j] = time
        s[ROW.SPEED + j] = v
        s[ROW.LANDED + j] = 1.0 if landed else 0.0


@jit
def _begun(fixed: MovingConstants, s: Floats, j: int) -> Start:
    """Return the beginning of the flight of lane j, as `prepare` left it."""
    x, y = s[ROW.X + j], s[ROW.U + j]
    return Start(fixed.alpha, fixed.x_lift, x, y, s[ROW.SINE + j], s[ROW.COSINE + j])


@answer(bases.approach, MovingConstants)
def _(fixed: MovingConstants, s: Floats, j: int) -> tuple[float, float, bool]:
    return s[ROW.TIME + j], s[ROW.SPEED + j], s[ROW.LANDED + j] != 0.0


@answer(bases.may_land, MovingConstants)
def _(fixed: MovingConstants, s: Floats, j: int, budget: float) -> bool:
    return bool(s[ROW.AGE + j] < budget)


@answer(bases.keep, MovingConstants)
def _(fixed: MovingConstants, s: Floats, j: int, time: float, landed: bool, seen: bool) -> bool:
    counts = s[ROW.COUNTS + j] != 0.0
    s[ROW.AGE + j] += 1.0 if landed else 0.0
    s[ROW.COUNTS + j] = (1.0 if seen else 0.0) + (0.0 if landed else s[ROW.COUNTS + j])
    s[ROW.NEXT + j] = FRESH if landed else time
    return bool(landed & counts)


@answer(bases.gives_up, Moving)
def _(base: Moving, s: Floats, j: int, passes: int) -> bool:
    stays = s[ROW.AGE + j] == s[ROW.AGE_SEEN + j]
    s[ROW.AGE_SEEN + j] = s[ROW.AGE + j]
    s[ROW.TRIES + j] = s[ROW.TRIES + j] + passes if stays else 0.0
    clear = s[ROW.CLEAR + j]
    lost = (clear != clear) & (abs(s[ROW.X + j]) <= 0.5)  # not one at rest for good
    return bool((s[ROW.TRIES + j] >= TRIES) | lost)


@answer(bases.pending, Moving)
def _(base: Moving, s: Floats, j: int) -> bool:
    # no flight follows on a rest for good, which leaves no phase
    return bool((s[ROW.COUNTS + j] != 0.0) & (abs(s[ROW.X + j]) <= 0.5))


@answer(bases.fly, MovingConstants)
def _(fixed: MovingConstants, x: float, u: float) -> tuple[float, float]:
    if not abs(x) <= 0.5:  # after a rest for good
        return np.nan, np.nan
    if u == 0.0 and not abs(x) >= fixed.x_lift:  # on a base that presses
        return 0.0, 0.0
    begin = start(fixed.alpha, fixed.x_lift, x, u)
    arcs = fixed.base.arcs
    sure, time = first_try(begin, arcs)
    v, landed, tries = 0.0, False, 0.0
    while not landed and tries <= TRIES:
        clear = clearance(begin, time, *turn(time))
        time, v, landed = try_landing(begin, sure, time, clear, arcs)
        tries += 1.0 if clear.f == clear.f else TRIES
    return time if landed else np.nan, v


@answer(bases.rebound, MovingConstants)
def _(fixed: MovingConstants, x: float, v: float) -> float:
    return fixed.e * v


@answer(bases.lift_off, MovingConstants)
def _(fixed: MovingConstants, n: float, x: float, w: float) -> tuple[float, float, float, bool]:
    leaves = (w > fixed.r) | (abs(x) > fixed.x_lift)
    later = n if fixed.x_lift > 0.0 else np.inf
    return n if leaves else later, x if leaves else fixed.x_lift, w if leaves else 0.0, leaves


@answer(bases.after_rest, MovingConstants)
def _(fixed: MovingConstants) -> tuple[float, float]:
    return fixed.x_lift, 0.0


@answer(bases.contact_time, MovingConstants)
def _(fixed: MovingConstants) -> float:
    return fixed.r


@answer(bases.leave, MovingConstants)
def _(fixed: MovingConstants, x: float, u: float) -> float:
    y = fma(-fixed.alpha, sin_turns(x), u)
    return -TINY if y == 0.0 and not abs(x) >= fixed.x_lift else y


@answer(bases.speed, MovingConstants)
def _(fixed: MovingConstants, x: float, u: float) -> float:
    return fma(fixed.alpha, sin_turns(x), u)


@jit
def _apex(begin: Start) -> float:
    """Height of the apex above the lowest level of the base; of one that falls, of its start."""
    u = absolute(begin)
    rising = u if u > 0.0 else 0.0
    return fma(rising, rising, (2.0 / math.pi) * begin.alpha * (1.0 - begin.cosine))


@answer(bases.counted, MovingConstants)
def _(fixed: MovingConstants, flight: Flight, u_off: float) -> Counted:
    begin = start(fixed.alpha, fixed.x_lift, flight.x, flight.u)
    return flight.time, _apex(begin), 1.0


@answer(bases.counted_now, MovingConstants)
def _(fixed: MovingConstants, s: Floats, j: int, time: float, u_off: float) -> Counted:
    return time, _apex(_begun(fixed, s, j)), 1.0


@answer(bases.common_age, Moving)
def _(base: Moving) -> float:
    return 0.0


@bases.lifts.register(Moving)
def _(base: Moving, problem: Dimensionless) -> NDArray[np.bool_]:
    return math.pi * (problem.kick / (1.0 + problem.restitution)) > 1.0


@bases.fitted.register(Moving)
def _(base: Moving, problem: Dimensionless) -> Moving:
    return base if bases.lifts(base, problem).any() else base._replace(arcs=None)


@bases.lowest.register(Moving)
def _(base: Moving, problem: Dimensionless) -> Floats | None:
    return (2.0 / math.pi) * (problem.kick / (1.0 + problem.restitution))


@answer(bases.reverses, MovingConstants)
def _(fixed: MovingConstants, x: float, v: float) -> float:
    return 1.0


@answer(bases.contraction, MovingConstants)
def _(fixed: MovingConstants, v: float) -> float:
    # e times the relative speed before the flight over that of arrival, which is 1 / e of the next
    return fixed.e * fixed.e


@answer(bases.density, MovingConstants)
def _(fixed: MovingConstants, u: float) -> float:
    return u


@answer(bases.fixed_residual, MovingConstants)
def _(fixed: MovingConstants, x: float, k: float, sign: float) -> tuple[float, float, float]:
    a = fixed.alpha * (1.0 + fixed.e)
    return a * sin_turns(x) - (1.0 - fixed.e) * k, TWO_PI * a * cos_turns(x), a


@answer(bases.fixed_attracts, MovingConstants)
def _(fixed: MovingConstants, x: float, k: float) -> bool:
    # both multipliers are inside the unit circle
    e = fixed.e
    s = -math.pi * fixed.alpha * cos_turns(x)
    return e < 1.0 and 0.0 < s < 2.0 * (1.0 + e * e) / ((1.0 + e) * (1.0 + e))


@answer(bases.fixed_holds, MovingConstants)
def _(fixed: MovingConstants, x: float, k: float) -> bool:
    # the base rises by (1 - e) / (1 + e) k at the landings
    y = 2.0 * fixed.e * k / (1.0 + fixed.e)
    time, _ = bases.fly(fixed, x, y)
    return abs(time - k) <= AT_LANDING and bases.lift_off(fixed, 0.0, x, y)[3]
