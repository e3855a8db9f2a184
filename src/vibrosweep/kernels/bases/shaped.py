"""The moving base whose velocity is a sum of harmonics.

A resting particle lifts off at the next phase at which 1 + G falls through 0; a period may have
several such phases.

In the vector kernel a pass makes one step of each lane's search.  The loops are short, as in
`moving_lanes`, and use the same rows, except for those of `Rows`.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels import bases, noise
from vibrosweep.kernels._jit import Floats, fma, implements, jit, wide_vectors
from vibrosweep.kernels.bases import Counted, Flight, LiftOff
from vibrosweep.kernels.bases.landing_search import begin_at
from vibrosweep.kernels.bases.moving import LARGEST_GAMMA, TINY, TRIES, Shaped, ShapedConstants
from vibrosweep.kernels.bases.moving_lanes import FRESH, begun
from vibrosweep.kernels.bases.shaped_search import (
    Clear,
    Guess,
    clearance,
    first_guess,
    first_try,
    rough_turn,
    stretch,
    try_landing,
    turn,
)
from vibrosweep.kernels.harmonics import for_each, next_phase
from vibrosweep.kernels.lanes import OF_PHASES, ROW, STRIDE
from vibrosweep.kernels.noise import SILENT, STILL, drawn_in
from vibrosweep.kernels.restitution import scale_of
from vibrosweep.kernels.sine import cos_turns, sin_turns
from vibrosweep.kernels.waveforms import velocity
from vibrosweep.model.parameters import Dimensionless


class Rows(NamedTuple):
    """Rows whose use differs from that over the base that moves as a sine."""

    F2: int
    F3: int
    F4: int
    F5: int
    SPEED: int  # absolute, at lift-off
    APEX: int


AT: Final = Rows(ROW.SINE_THEN, ROW.COSINE_THEN, ROW.NEWTON, ROW.Q, ROW.Q3, ROW.Q4)
PRESSES: Final = ROW.PHASES + OF_PHASES // 2 * STRIDE
_falls_of = for_each("dip", "falls(shape, a, shape.dip[{k}], shape.before[{k}])")
_presses_of = for_each("dip", "falls(shape, a, shape.dip[{k}], shape.after[{k}])")
_falls_in = for_each("dip", f"s[{ROW.PHASES} + {{row}} + j]")
_presses_in = for_each("dip", f"s[{PRESSES} + {{row}} + j]")


@implements(bases.constants, Shaped)
def constants_shaped(base: Shaped, problem: Dimensionless, i: int) -> ShapedConstants:
    e, shape = problem.restitution[i], base.waveform
    alpha = problem.kick[i] / (1.0 + e)
    if 0.5 * alpha * shape.fall > LARGEST_GAMMA:
        alpha = np.nan
    falls, presses = _falls_of(shape, alpha, 0.0, 0.0, 0), _presses_of(shape, alpha, 0.0, 0.0, 0)
    source = noise.source_of(problem.noise, problem.end_count, i)
    scale, r = scale_of(base.restitution, e, problem.restitution_speed[i]), problem.rest_flight[i]
    return ShapedConstants(base, e, alpha, r, scale, falls, presses, source, STILL)


@implements(bases.fly, ShapedConstants)
def fly_shaped(fixed: ShapedConstants, x: float, u: float) -> tuple[float, float]:
    if not abs(x) <= 0.5:  # NaN: the particle rests for good
        return np.nan, np.nan
    if u == 0.0 and stretch(fixed, x)[0]:  # the base presses the particle
        return 0.0, 0.0
    begin = begin_at(x, u)
    guess = first_guess(fixed, begin)
    rough = clearance(fixed, begin, guess.time, *rough_turn(guess.time))
    time = first_try(fixed, begin, guess.sure, guess.time, rough)
    v, landed, tries = 0.0, False, 0.0
    while not landed and tries <= TRIES:
        clear = clearance(fixed, begin, time, *turn(time))
        time, v, landed = try_landing(fixed, begin, guess, time, clear)
        tries += 1.0 if clear.f == clear.f else TRIES
    return time if landed else np.nan, v


@implements(bases.lift_off, ShapedConstants)
def lift_off_shaped(fixed: ShapedConstants, n: float, x: float, w: float) -> LiftOff:
    presses, _, _ = stretch(fixed, x)
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
    return -TINY if y == 0.0 and stretch(fixed, x)[0] else y


@implements(bases.counted, ShapedConstants)
def counted_shaped(fixed: ShapedConstants, flight: Flight, u_off: float) -> Counted:
    return Counted(flight.time, first_guess(fixed, begin_at(flight.x, flight.u)).apex, 1.0)


@bases.lifts.register(Shaped)
def lifts_shaped(base: Shaped, problem: Dimensionless) -> NDArray[np.bool_]:
    alpha = problem.kick / (1.0 + problem.restitution)
    return 0.5 * alpha * base.waveform.fall > 1.0


@bases.fitted.register(Shaped)
def fitted_shaped(base: Shaped, problem: Dimensionless) -> Shaped:
    alpha = problem.kick / (1.0 + problem.restitution)
    if np.any(0.5 * alpha * base.waveform.fall > 1.0 - 2.0**-40):
        return base
    dip = base.waveform.dip[:1]  # no particle is ever lifted: one of several dips is enough
    return base._replace(waveform=base.waveform._replace(dip=dip, before=dip, after=dip))


@bases.lowest.register(Shaped)
def lowest_shaped(base: Shaped, problem: Dimensionless) -> Floats | None:
    return -4.0 * base.waveform.bottom * (problem.kick / (1.0 + problem.restitution))


@implements(bases.put, ShapedConstants)
def put_shaped(fixed: ShapedConstants, s: Floats, j: int) -> None:
    row = ROW.CONSTANTS + j
    s[row], s[row + STRIDE], s[row + 2 * STRIDE] = fixed.e, fixed.alpha, fixed.r
    s[ROW.SCALE + j] = fixed.scale
    for k in range(len(fixed.falls)):
        s[ROW.PHASES + k * STRIDE + j] = fixed.falls[k]
        s[PRESSES + k * STRIDE + j] = fixed.presses[k]
    s[ROW.NEXT + j], s[ROW.COUNTS + j] = FRESH, 0.0
    s[ROW.TRIES + j], s[ROW.AGE_SEEN + j] = 0.0, 0.0


@implements(bases.take, Shaped)
def take_shaped(base: Shaped, s: Floats, j: int) -> ShapedConstants:
    row, shape = ROW.CONSTANTS + j, base.waveform
    e, alpha, r = s[row], s[row + STRIDE], s[row + 2 * STRIDE]
    falls, presses = _falls_in(shape, 0.0, 0.0, s, j), _presses_in(shape, 0.0, 0.0, s, j)
    draw, scale = drawn_in(base.noise, s, j), s[ROW.SCALE + j]
    return ShapedConstants(base, e, alpha, r, scale, falls, presses, SILENT, draw)


@implements(bases.prepare, Shaped)
def prepare_shaped(base: Shaped, s: Floats, lanes: int) -> None:
    _near(base, s, lanes)
    _guess(base, s, lanes)
    _turn(base, s, lanes)
    _look(base, s, lanes)
    _try(base, s, lanes)


@jit
def _near(base: Shaped, s: Floats, lanes: int) -> None:
    """Guess when the flight of each lane ends."""
    wide_vectors()
    for j in range(lanes):
        x = s[ROW.X + j]
        s[ROW.SINE + j] = sin_turns(x)
        s[ROW.COSINE + j] = cos_turns(x)
        guess = first_guess(bases.take(base, s, j), begun(s, j))
        s[ROW.SURE + j] = 1.0 if guess.sure else 0.0
        s[ROW.GUESS + j] = guess.time
        s[ROW.RISE + j] = guess.rise
        s[AT.SPEED + j] = guess.u
        s[AT.APEX + j] = guess.apex


@jit
def _guess(base: Shaped, s: Floats, lanes: int) -> None:
    """Compute the time to be tried first in a flight that has just begun."""
    wide_vectors()
    for j in range(lanes):
        fixed, begin, guess = bases.take(base, s, j), begun(s, j), s[ROW.GUESS + j]
        rough = clearance(fixed, begin, guess, *rough_turn(guess))
        tried = first_try(fixed, begin, s[ROW.SURE + j] != 0.0, guess, rough)
        following = s[ROW.NEXT + j]
        s[ROW.REACHED + j] = tried if following < 0.0 else following


@jit
def _turn(base: Shaped, s: Floats, lanes: int) -> None:
    """Compute how far the base turns until the time that is to be tried."""
    wide_vectors()
    for j in range(lanes):
        s[ROW.TURNED + j], s[ROW.LAG + j], s[ROW.VERSINE + j] = turn(s[ROW.REACHED + j])


@jit
def _look(base: Shaped, s: Floats, lanes: int) -> None:
    """Compute the clearance of each lane at the time that is to be tried."""
    wide_vectors()
    for j in range(lanes):
        fixed, reached = bases.take(base, s, j), s[ROW.REACHED + j]
        turned, lag, c = s[ROW.TURNED + j], s[ROW.LAG + j], s[ROW.VERSINE + j]
        clear = clearance(fixed, begun(s, j), reached, turned, lag, c)
        s[ROW.CLEAR + j], s[ROW.CLEAR_SLOPE + j] = clear.f, clear.f1
        s[AT.F2 + j], s[AT.F3 + j] = clear.f2, clear.f3
        s[AT.F4 + j], s[AT.F5 + j] = clear.f4, clear.f5


@jit
def _try(base: Shaped, s: Floats, lanes: int) -> None:
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
        guess = Guess(sure, s[ROW.GUESS + j], rise, u, s[AT.APEX + j])
        fixed, begin, reached = bases.take(base, s, j), begun(s, j), s[ROW.REACHED + j]
        time, v, landed = try_landing(fixed, begin, guess, reached, clear)
        s[ROW.TIME + j] = time
        s[ROW.SPEED + j] = v
        s[ROW.LANDED + j] = 1.0 if landed else 0.0


@implements(bases.counted_now, ShapedConstants)
def counted_now_shaped(
    fixed: ShapedConstants, s: Floats, j: int, time: float, u_off: float
) -> Counted:
    return Counted(time, s[AT.APEX + j], 1.0)
