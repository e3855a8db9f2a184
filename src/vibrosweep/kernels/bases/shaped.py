"""The base that moves with the velocity alpha w(x), w a sum of harmonics, alpha = a / (1 + e).

Speeds are relative to the base: a particle arrives with z and leaves with E(z), by the law of
restitution.  It comes to rest if E(z) is at most r and the base presses it, 1 + G > 0 with
G = alpha w'(x) / 2.  It lifts off, with speed 0, at the next phase at which 1 + G falls through 0;
a period may have several.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels import bases, noise
from vibrosweep.kernels._jit import Floats, fma, implements, jit
from vibrosweep.kernels.bases import Counted, Flight, LiftOff
from vibrosweep.kernels.bases.moving import (
    LARGEST_GAMMA,
    TINY,
    TRIES,
    contact_time_moving,
    contraction_moving,
    density_moving,
    rebound_moving,
    reverses_moving,
    wake_moving,
)
from vibrosweep.kernels.bases.shaped_search import (
    Begin,
    Fixed,
    clearance,
    first_guess,
    first_try,
    rough_turn,
    stretch,
    try_landing,
    turn,
)
from vibrosweep.kernels.harmonics import Harmonics, for_each, next_phase
from vibrosweep.kernels.laws import Law
from vibrosweep.kernels.noise import STILL, Draw, Noise, Source
from vibrosweep.kernels.restitution import Constant, Restitution, scale_of
from vibrosweep.kernels.sine import cos_turns, sin_turns
from vibrosweep.kernels.waveforms import velocity
from vibrosweep.model.parameters import Dimensionless

__all__ = ["Shaped", "ShapedConstants"]


class Shaped(NamedTuple):
    """The base."""

    law: Law  # `Rest`, the only law of rebound with a meaning here
    waveform: Harmonics
    restitution: Restitution = Constant()
    noise: Noise | None = None


class ShapedConstants(NamedTuple):
    """Numbers that decide the impacts of one realization."""

    base: Shaped
    # e, alpha, r: restitution, factor of the velocity of the base, and threshold of rest
    e: float
    alpha: float
    r: float
    scale: float  # of speeds, in the law of restitution
    # falls, presses: phases at which the base begins to fall faster than gravity, and to press
    # again; NaN where it does not
    falls: tuple[float, ...]
    presses: tuple[float, ...]
    # source, draw: noise of the realization, and of one impact
    source: Source
    draw: Draw


_falls = for_each("dip", "falls(shape, a, shape.dip[{k}], shape.before[{k}])")
_presses = for_each("dip", "falls(shape, a, shape.dip[{k}], shape.after[{k}])")


@implements(bases.constants, Shaped)
def constants_shaped(base: Shaped, problem: Dimensionless, i: int) -> ShapedConstants:
    e, shape = problem.restitution[i], base.waveform
    alpha = problem.kick[i] / (1.0 + e)
    if 0.5 * alpha * shape.fall > LARGEST_GAMMA:
        alpha = np.nan
    falls, presses = _falls(shape, alpha, 0.0, 0.0, 0), _presses(shape, alpha, 0.0, 0.0, 0)
    source = noise.source_of(problem.noise, problem.end_count, i)
    scale, r = scale_of(base.restitution, e, problem.restitution_speed[i]), problem.rest_flight[i]
    return ShapedConstants(base, e, alpha, r, scale, falls, presses, source, STILL)


@jit
def search(fixed: ShapedConstants) -> Fixed:
    """Return the numbers that the search for a landing needs."""
    return Fixed(fixed.base.waveform, fixed.alpha, fixed.falls, fixed.presses)


@jit
def begin_at(x: float, y: float) -> Begin:
    """Beginning of the flight that leaves phase x with speed y."""
    return Begin(x, y, sin_turns(x), cos_turns(x))


@implements(bases.fly, ShapedConstants)
def fly_shaped(fixed: ShapedConstants, x: float, u: float) -> tuple[float, float]:
    if not abs(x) <= 0.5:  # NaN: the particle rests for good
        return np.nan, np.nan
    known = search(fixed)
    if u == 0.0 and stretch(known, x)[0]:  # the base presses the particle
        return 0.0, 0.0
    begin = begin_at(x, u)
    guess = first_guess(known, begin)
    rough = clearance(known, begin, guess.time, *rough_turn(guess.time))
    time = first_try(known, begin, guess.sure, guess.time, rough)
    v, landed, tries = 0.0, False, 0.0
    while not landed and tries <= TRIES:
        clear = clearance(known, begin, time, *turn(time))
        time, v, landed = try_landing(known, begin, guess, time, clear)
        tries += 1.0 if clear.f == clear.f else TRIES
    return time if landed else np.nan, v


@implements(bases.lift_off, ShapedConstants)
def lift_off_shaped(fixed: ShapedConstants, n: float, x: float, w: float) -> LiftOff:
    presses, _, _ = stretch(search(fixed), x)
    leaves = (w > fixed.r) | (not presses)
    lift, passed = next_phase(fixed.falls, x)
    later = n + passed if lift == lift else np.inf
    return LiftOff(n if leaves else later, x if leaves else lift, w if leaves else 0.0, leaves)


@implements(bases.after_rest, ShapedConstants)
def after_rest_shaped(fixed: ShapedConstants) -> tuple[float, float]:
    lift = np.nan
    for k in range(len(fixed.falls)):
        lift = fixed.falls[k] if fixed.falls[k] == fixed.falls[k] else lift
    return lift, 0.0


@implements(bases.random, ShapedConstants)
def random_shaped(
    fixed: ShapedConstants, particle: float, number: float, n: float, x: float
) -> ShapedConstants:
    draw = noise.draw_of(fixed.base.noise, fixed.source, particle, number, 0.0)
    e, alpha, r, scale = fixed.e, fixed.alpha, fixed.r, fixed.scale
    falls, presses = fixed.falls, fixed.presses
    return ShapedConstants(fixed.base, e, alpha, r, scale, falls, presses, fixed.source, draw)


@implements(bases.lifts_alike, Shaped)
def lifts_alike_shaped(base: Shaped) -> bool:
    return base.noise is None and len(base.waveform.dip) <= 1


@implements(bases.leave, ShapedConstants)
def leave_shaped(fixed: ShapedConstants, x: float, u: float) -> float:
    y = fma(-fixed.alpha, velocity(fixed.base.waveform, x), u)
    return -TINY if y == 0.0 and stretch(search(fixed), x)[0] else y


@implements(bases.speed, ShapedConstants)
def speed_shaped(fixed: ShapedConstants, x: float, u: float) -> float:
    return fma(fixed.alpha, velocity(fixed.base.waveform, x), u)


@implements(bases.counted, ShapedConstants)
def counted_shaped(fixed: ShapedConstants, flight: Flight, u_off: float) -> Counted:
    return Counted(flight.time, first_guess(search(fixed), begin_at(flight.x, flight.u)).apex, 1.0)


@bases.lifts.register(Shaped)
def lifts_shaped(base: Shaped, problem: Dimensionless) -> NDArray[np.bool_]:
    alpha = problem.kick / (1.0 + problem.restitution)
    return 0.5 * alpha * base.waveform.fall > 1.0


@bases.fitted.register(Shaped)
def fitted_shaped(base: Shaped, problem: Dimensionless) -> Shaped:
    alpha = problem.kick / (1.0 + problem.restitution)
    if np.any(0.5 * alpha * base.waveform.fall > 1.0 - 2.0**-40):
        return base
    dip = base.waveform.dip[:1]  # no place falls: one of several is enough
    return base._replace(waveform=base.waveform._replace(dip=dip, before=dip, after=dip))


@bases.lowest.register(Shaped)
def lowest_shaped(base: Shaped, problem: Dimensionless) -> Floats | None:
    return -4.0 * base.waveform.bottom * (problem.kick / (1.0 + problem.restitution))


implements(bases.rebound, ShapedConstants)(rebound_moving)
implements(bases.contact_time, ShapedConstants)(contact_time_moving)
implements(bases.contraction, ShapedConstants)(contraction_moving)
implements(bases.density, ShapedConstants)(density_moving)
implements(bases.reverses, ShapedConstants)(reverses_moving)
implements(bases.wake, ShapedConstants)(wake_moving)
