"""The base that moves with the velocity alpha w(x), alpha = a / (1 + e), for every waveform w.

Speeds are relative to the base: a particle arrives with z and leaves with E(z), by the law of
restitution.  It comes to rest if E(z) is at most r and the base presses it, 1 + G > 0 with the
acceleration G = alpha w'(x) / 2 of the base in units of gravity.  It lifts off, with speed 0, when
the base begins to fall faster than gravity, where 1 + G falls through 0.

Base and constants are named tuples of their own for each kind of waveform.  Flights are found in
`landing_search` (the sine), `shaped` (harmonics) and `chained` (parabolas); this file has what does
not depend on the waveform, or holds for both waveforms with a single lift-off in a period.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels import bases, noise
from vibrosweep.kernels._jit import Floats, fma, implements, jit, uncompiled
from vibrosweep.kernels.bases import Base, Constants, LiftOff
from vibrosweep.kernels.harmonics import Harmonics
from vibrosweep.kernels.laws import Law
from vibrosweep.kernels.noise import STILL, Draw, Noise, Source
from vibrosweep.kernels.restitution import Constant, Restitution, ratio, scale_of, slope
from vibrosweep.kernels.waveforms import Parabolic, Sine, steepness, velocity
from vibrosweep.model.parameters import Dimensionless
from vibrosweep.model.turns import arcsin_turns

_arcsin_turns = jit(arcsin_turns)
TRIES = 20000.0  # passes after which the search for a landing is abandoned
LARGEST_GAMMA = 1e9  # beyond it a slow particle meets the base too often for a search
TINY = 1e-300  # modulus of a relative speed that points into the base


class Moving(NamedTuple):
    """The base that moves as a sine."""

    law: Law  # `Rest`, the only law of rebound with a meaning here
    restitution: Restitution = Constant()
    # None if Gamma <= 1 in all realizations, so that no resting particle ever lifts off
    arcs: int | None = 1
    noise: Noise | None = None
    waveform: Sine = Sine()


class Shaped(NamedTuple):
    """The base that moves as a sum of harmonics."""

    law: Law
    waveform: Harmonics
    restitution: Restitution = Constant()
    noise: Noise | None = None


class Chained(NamedTuple):
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
    # Phase at which the base begins to fall faster than gravity and a resting particle lifts off;
    # NaN if it never does
    x_lift: float
    # source, draw: noise of the realization, and of one impact
    source: Source
    draw: Draw


class ChainedConstants(MovingConstants):
    """The same numbers, of a base of parabolas."""


class ShapedConstants(NamedTuple):
    """The same numbers, of a base of harmonics, which may lift particles off at several phases."""

    base: Shaped
    e: float
    alpha: float
    r: float
    scale: float
    # falls, presses: phases at which the base begins to fall faster than gravity, and to press
    # again; NaN where it does not
    falls: tuple[float, ...]
    presses: tuple[float, ...]
    source: Source
    draw: Draw


# Constants and bases of every waveform, and of those with a single lift-off in a period
ANY = MovingConstants, ShapedConstants, ChainedConstants
ANY_BASE = Moving, Shaped, Chained
SINGLE = MovingConstants, ChainedConstants


@implements(bases.constants, Moving)
def constants_moving(base: Moving, problem: Dimensionless, i: int) -> MovingConstants:
    e = problem.restitution[i]
    alpha = problem.kick[i] / (1.0 + e)
    gamma = math.pi * alpha
    x_lift = np.nan
    if gamma > LARGEST_GAMMA:
        alpha = np.nan
    elif gamma > 1.0:
        # from the sine of half the angle to phase 1/2, which loses no digits near Gamma = 1
        x_lift = 0.5 - 2.0 * _arcsin_turns(math.sqrt((gamma - 1.0) / (2.0 * gamma)))
    scale = scale_of(base.restitution, e, problem.restitution_speed[i])
    source = noise.source_of(problem.noise, problem.end_count, i)
    return MovingConstants(base, e, alpha, problem.rest_flight[i], scale, x_lift, source, STILL)


@implements(bases.random, MovingConstants)
def random_moving(
    fixed: MovingConstants, particle: float, number: float, n: float, x: float
) -> MovingConstants:
    draw = noise.draw_of(fixed.base.noise, fixed.source, particle, number, 0.0)
    e, alpha, r, x_lift = fixed.e, fixed.alpha, fixed.r, fixed.x_lift
    return MovingConstants(fixed.base, e, alpha, r, fixed.scale, x_lift, fixed.source, draw)


@bases.fitted.register(Moving)
def fitted_moving(base: Moving, problem: Dimensionless) -> Moving:
    return base if bases.lifts(base, problem).any() else base._replace(arcs=None)


@bases.lowest.register(Moving)
def lowest_moving(base: Moving, problem: Dimensionless) -> Floats | None:
    return (2.0 / math.pi) * (problem.kick / (1.0 + problem.restitution))


@bases.lifts.register(Moving)
@bases.lifts.register(Chained)
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


@implements(bases.lifts_alike, Moving, Chained)
def lifts_alike_moving(base: Base) -> bool:
    return base.noise is None


@implements(bases.speed, *ANY)
def speed_moving(fixed: Constants, x: float, u: float) -> float:
    return fma(fixed.alpha, velocity(fixed.base.waveform, x), u)


@implements(bases.rebound, *ANY)
def rebound_moving(fixed: Constants, x: float, v: float) -> float:
    share = ratio(fixed.base.restitution, fixed.e, fixed.scale, v)
    e = noise.slipped(fixed.base.noise, share, fixed.draw.slip)
    return noise.thrown(fixed.base.noise, e * v, fixed.draw.push)


@implements(bases.wake, *ANY)
def wake_moving(fixed: MovingConstants, n: float, x: float, origin: float) -> tuple[float, float]:
    return n, x


@implements(bases.contact_time, *ANY)
def contact_time_moving(fixed: MovingConstants) -> float:
    return fixed.r


@implements(bases.reverses, *ANY)
def reverses_moving(fixed: MovingConstants, x: float, v: float) -> float:
    return 1.0


@implements(bases.contraction, *ANY)
def contraction_moving(fixed: Constants, v: float) -> float:
    # the determinant is the slope times the speed of the lift-off before over that of arrival; over
    # a cycle the product of these quotients equals the product of the restitutions
    law = fixed.base.restitution
    return slope(law, fixed.e, fixed.scale, v) * ratio(law, fixed.e, fixed.scale, v)


@implements(bases.density, *ANY)
def density_moving(fixed: Constants, u: float) -> float:
    return u
