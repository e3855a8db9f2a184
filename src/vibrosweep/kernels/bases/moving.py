"""The base that moves with the velocity alpha sin(2 pi x), alpha = a / (1 + e).

Speeds are relative to the base: a particle arrives with z and leaves with E(z), by the law of
restitution.  It comes to rest if E(z) is at most r and the base presses it, 1 + Gamma cos(2 pi x)
> 0 with Gamma = pi alpha.  It lifts off, with speed 0, when the base begins to fall faster than
gravity; for Gamma <= 1 it never does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels import bases, noise
from vibrosweep.kernels._jit import Floats, fma, implements, jit
from vibrosweep.kernels.bases import Counted, Flight, LiftOff
from vibrosweep.kernels.bases.landing_search import (
    apex,
    clearance,
    first_guess,
    first_try,
    rough_clearance,
    series_terms,
    start,
    try_landing,
    turn,
)
from vibrosweep.kernels.laws import Law
from vibrosweep.kernels.noise import STILL, Draw, Noise, Source
from vibrosweep.kernels.restitution import (
    Constant,
    Restitution,
    ratio,
    scale_of,
    slope,
)
from vibrosweep.kernels.sine import sin_turns
from vibrosweep.kernels.waveforms import Sine
from vibrosweep.model.arcsine import arcsin_turns
from vibrosweep.model.parameters import Dimensionless

_arcsin_turns = jit(arcsin_turns)
TRIES = 20000.0  # passes after which the search for a landing is abandoned
LARGEST_GAMMA = 1e9  # beyond it a slow particle meets the base too often for a search
TINY = 1e-300  # modulus of a relative speed that points into the base


class Moving(NamedTuple):
    """The base."""

    law: Law  # `Rest`, the only law of rebound with a meaning here
    restitution: Restitution = Constant()
    # None if Gamma <= 1 in all realizations, so that no resting particle ever lifts off
    arcs: int | None = 1
    noise: Noise | None = None
    waveform: Sine = Sine()


class MovingConstants(NamedTuple):
    """Numbers that decide the impacts of one realization."""

    base: Moving
    # e, alpha, r: restitution, largest velocity of the base, and threshold of rest
    e: float
    alpha: float
    r: float
    scale: float  # of speeds, in the law of restitution
    # Phase at which the base begins to fall faster than gravity and a resting particle lifts off;
    # NaN if it never does
    x_lift: float
    # source, draw: noise of the realization, and of one impact
    source: Source
    draw: Draw


@implements(bases.constants, Moving)
def constants_moving(base: Moving, problem: Dimensionless, i: int) -> MovingConstants:
    e = problem.restitution[i]
    alpha = problem.kick[i] / (1.0 + e)
    gamma = math.pi * alpha
    x_lift = np.nan
    if gamma > LARGEST_GAMMA:
        alpha = np.nan
    elif gamma > 1.0:
        # half the angle from pi, whose sine loses nothing near Gamma = 1
        x_lift = 0.5 - 2.0 * _arcsin_turns(math.sqrt((gamma - 1.0) / (2.0 * gamma)))
    scale = scale_of(base.restitution, e, problem.restitution_speed[i])
    source = noise.source_of(problem.noise, problem.end_count, i)
    return MovingConstants(base, e, alpha, problem.rest_flight[i], scale, x_lift, source, STILL)


@implements(bases.fly, MovingConstants)
def fly_moving(fixed: MovingConstants, x: float, u: float) -> tuple[float, float]:
    if not abs(x) <= 0.5:  # NaN: the particle rests for good
        return np.nan, np.nan
    if u == 0.0 and not abs(x) >= fixed.x_lift:  # the base presses the particle
        return 0.0, 0.0
    begin = start(fixed.alpha, fixed.x_lift, x, u)
    arcs = fixed.base.arcs
    guess = first_guess(begin, arcs)
    time = first_try(begin, guess, rough_clearance(begin, guess.time), arcs)
    v, landed, tries = 0.0, False, 0.0
    while not landed and tries <= TRIES:
        clear = clearance(begin, time, *turn(time))
        time, v, landed = try_landing(begin, guess, time, clear, series_terms(begin, clear), arcs)
        tries += 1.0 if clear.f == clear.f else TRIES
    return time if landed else np.nan, v


@implements(bases.rebound, MovingConstants)
def rebound_moving(fixed: MovingConstants, x: float, v: float) -> float:
    share = ratio(fixed.base.restitution, fixed.e, fixed.scale, v)
    e = noise.slipped(fixed.base.noise, share, fixed.draw.slip)
    return noise.thrown(fixed.base.noise, e * v, fixed.draw.push)


@implements(bases.lift_off, MovingConstants)
def lift_off_moving(fixed: MovingConstants, n: float, x: float, w: float) -> LiftOff:
    leaves = (w > fixed.r) | (abs(x) > fixed.x_lift)
    later = n if fixed.x_lift > 0.0 else np.inf
    return LiftOff(
        n if leaves else later, x if leaves else fixed.x_lift, w if leaves else 0.0, leaves
    )


@implements(bases.random, MovingConstants)
def random_moving(
    fixed: MovingConstants, particle: float, number: float, n: float, x: float
) -> MovingConstants:
    draw = noise.draw_of(fixed.base.noise, fixed.source, particle, number, 0.0)
    e, alpha, r, x_lift = fixed.e, fixed.alpha, fixed.r, fixed.x_lift
    return MovingConstants(fixed.base, e, alpha, r, fixed.scale, x_lift, fixed.source, draw)


@implements(bases.wake, MovingConstants)
def wake_moving(fixed: MovingConstants, n: float, x: float, origin: float) -> tuple[float, float]:
    return n, x


@implements(bases.after_rest, MovingConstants)
def after_rest_moving(fixed: MovingConstants) -> tuple[float, float]:
    return fixed.x_lift, 0.0


@implements(bases.lifts_alike, Moving)
def lifts_alike_moving(base: Moving) -> bool:
    return base.noise is None


@implements(bases.contact_time, MovingConstants)
def contact_time_moving(fixed: MovingConstants) -> float:
    return fixed.r


@implements(bases.leave, MovingConstants)
def leave_moving(fixed: MovingConstants, x: float, u: float) -> float:
    y = fma(-fixed.alpha, sin_turns(x), u)
    return -TINY if y == 0.0 and not abs(x) >= fixed.x_lift else y


@implements(bases.speed, MovingConstants)
def speed_moving(fixed: MovingConstants, x: float, u: float) -> float:
    return fma(fixed.alpha, sin_turns(x), u)


@implements(bases.counted, MovingConstants)
def counted_moving(fixed: MovingConstants, flight: Flight, u_off: float) -> Counted:
    begin = start(fixed.alpha, fixed.x_lift, flight.x, flight.u)
    return Counted(flight.time, apex(begin), 1.0)


@bases.lifts.register(Moving)
def lifts_moving(base: Moving, problem: Dimensionless) -> NDArray[np.bool_]:
    return math.pi * (problem.kick / (1.0 + problem.restitution)) > 1.0


@bases.fitted.register(Moving)
def fitted_moving(base: Moving, problem: Dimensionless) -> Moving:
    return base if bases.lifts(base, problem).any() else base._replace(arcs=None)


@bases.lowest.register(Moving)
def lowest_moving(base: Moving, problem: Dimensionless) -> Floats | None:
    return (2.0 / math.pi) * (problem.kick / (1.0 + problem.restitution))


@implements(bases.reverses, MovingConstants)
def reverses_moving(fixed: MovingConstants, x: float, v: float) -> float:
    return 1.0


@implements(bases.contraction, MovingConstants)
def contraction_moving(fixed: MovingConstants, v: float) -> float:
    # slope times the relative speed of the lift-off before over that of arrival: along an orbit the
    # product of these quotients equals the product of the restitutions
    law = fixed.base.restitution
    return slope(law, fixed.e, fixed.scale, v) * ratio(law, fixed.e, fixed.scale, v)


@implements(bases.density, MovingConstants)
def density_moving(fixed: MovingConstants, u: float) -> float:
    return u
