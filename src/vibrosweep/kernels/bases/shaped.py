"""The base that moves with the velocity alpha w(x), w a sum of harmonics, alpha = a / (1 + e).

Speeds are relative to it: a particle arrives with z and leaves with e z.  It comes to rest where
that is at most r and the base presses it, 1 + G > 0 with G = alpha w'(x) / 2, and is lifted, with
speed 0, at the next phase where 1 + G falls through 0, of several in a period.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels import bases, noise
from vibrosweep.kernels._jit import Floats, fma, implements, jit
from vibrosweep.kernels.bases import Counted, Flight, Jacobian
from vibrosweep.kernels.bases.moving import (
    LARGEST_GAMMA,
    TINY,
    TRIES,
    contact_time_moving,
    contraction_moving,
    density_moving,
    rebound_moving,
    reverses_moving,
    wake_lanes_moving,
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
from vibrosweep.kernels.harmonics import Harmonics, for_each
from vibrosweep.kernels.laws import Law
from vibrosweep.kernels.noise import STILL, Draw, Noise, Source
from vibrosweep.kernels.restitution import Constant, Restitution, scale_of, slack, slope
from vibrosweep.kernels.sine import cos_turns, sin_turns
from vibrosweep.kernels.waveforms import velocity
from vibrosweep.model.parameters import Dimensionless
from vibrosweep.model.shapes import TWO_PI

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
    """Return what the search for a landing needs."""
    return Fixed(fixed.base.waveform, fixed.alpha, fixed.falls, fixed.presses)


@jit
def begin_at(x: float, y: float) -> Begin:
    """Beginning of the flight that leaves phase x with speed y."""
    return Begin(x, y, sin_turns(x), cos_turns(x))


@implements(bases.fly, ShapedConstants)
def fly_shaped(fixed: ShapedConstants, x: float, u: float) -> tuple[float, float]:
    if not abs(x) <= 0.5:  # after a rest for good
        return np.nan, np.nan
    known = search(fixed)
    if u == 0.0 and stretch(known, x)[0]:  # on a base that presses
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
def lift_off_shaped(
    fixed: ShapedConstants, n: float, x: float, w: float
) -> tuple[float, float, float, bool]:
    presses, _, _ = stretch(search(fixed), x)
    leaves = (w > fixed.r) | (not presses)
    lift, ahead, later = np.nan, np.inf, np.inf
    for k in range(len(fixed.falls)):
        over = 1.0 if x > fixed.falls[k] else 0.0
        nearer = (fixed.falls[k] - x) + over < ahead
        lift = fixed.falls[k] if nearer else lift
        later = n + over if nearer else later
        ahead = (fixed.falls[k] - x) + over if nearer else ahead
    return n if leaves else later, x if leaves else lift, w if leaves else 0.0, leaves


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
    one = base.waveform.dip[:1]  # a place of no fall, of several
    return base._replace(waveform=base.waveform._replace(dip=one, before=one, after=one))


@bases.lowest.register(Shaped)
def lowest_shaped(base: Shaped, problem: Dimensionless) -> Floats | None:
    return -4.0 * base.waveform.bottom * (problem.kick / (1.0 + problem.restitution))


@implements(bases.jacobian, ShapedConstants)
def jacobian_shaped(fixed: ShapedConstants, flight: Flight) -> Jacobian:
    shape, half, law = fixed.base.waveform, 0.5 * fixed.alpha, fixed.base.restitution
    s, z = flight.time, flight.v
    e = slope(law, fixed.e, fixed.scale, z)
    if s == 0.0:  # it lands at once
        return 1.0, 0.0, 0.0, -e, 1.0 + slack(law) * e
    begin, whole = begin_at(flight.x, flight.u), np.rint(s)
    turned, lag, c = turn(s)
    clear = clearance(search(fixed), begin, s, turned, lag, c)
    change, dropped, terms, swings = 0.0, 0.0, 0.0, 0.0
    sine, cosine = begin.sine, begin.cosine
    s_h, d_h, c_h, d_more, c_more = turned, lag, c, lag, c
    for k in range(len(shape.p)):
        angle = TWO_PI * (k + 1)
        u = fma(shape.p[k], sine, shape.q[k] * cosine)
        v = fma(shape.p[k], cosine, -shape.q[k] * sine)
        lagged = fma(angle, whole, d_h)
        change += fma(u, c_h, v * lagged)
        dropped += angle * fma(v, c_h, u * s_h)
        terms += abs(u) * c_h + abs(v * lagged)
        swings += angle * (abs(u) + abs(v))
        sine, cosine = (
            fma(sine, begin.cosine, cosine * begin.sine),
            fma(cosine, begin.cosine, -sine * begin.sine),
        )
        ahead = 1.0 - c_h
        d_more, c_more = fma(2.0 * c, s_h, d_more), fma(2.0 * c, ahead, c_more)
        s_h = fma(s_h, 1.0 - c, ahead * turned)
        d_h += d_more
        c_h += c_more
    by_x, by_y = fixed.alpha * change / z, s / z
    pull, lost = -2.0 * clear.f2, 2.0 * half * dropped
    swings *= half
    parts = 1.0 + (2.0 * s + abs(flight.u) + 4.0 * swings) / z
    size = 1.0 + parts * (fixed.alpha * terms + s) / z
    size += slack(law) * e * ((abs(pull) + 2.0 * swings + 2.0) * size + 8.0 * swings)
    return 1.0 + by_x, by_y, e * (pull * by_x - lost), e * (pull * by_y - 1.0), size


implements(bases.rebound, ShapedConstants)(rebound_moving)
implements(bases.contact_time, ShapedConstants)(contact_time_moving)
implements(bases.contraction, ShapedConstants)(contraction_moving)
implements(bases.density, ShapedConstants)(density_moving)
implements(bases.reverses, ShapedConstants)(reverses_moving)
implements(bases.wake, ShapedConstants)(wake_moving)
implements(bases.wake_lanes, Shaped)(wake_lanes_moving)
