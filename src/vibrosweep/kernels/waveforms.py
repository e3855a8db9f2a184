"""Velocity of the base over a period, by the type of its shape, in units of V0.

A shape is a named tuple: empty for the sine and the triangle, with the numbers of one sweep for
`Harmonics`.
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.kernels._jit import Floats, fma, generic, implements, jit, overloaded
from vibrosweep.kernels.arithmetic import (
    COSINE_ERROR,
    HALF_ULP,
    KICK_ERROR,
    REST_ERROR,
    SINE_ERROR,
    cos_turns,
    folded,
    sin_turns,
    waves,
)
from vibrosweep.kernels.memory import ROW, STRIDE
from vibrosweep.model.parameters import ARCSINE_ERROR, arcsin_turns, turns_of_radians
from vibrosweep.model.shapes import (
    HARMONICS_NAME,
    PARABOLIC_NAME,
    SINE_NAME,
    TWO_PI,
    Waveform,
    zeros,
)

_arcsin_turns = jit(arcsin_turns)
Shape = Any
LiftOffs = Any  # phases in turns at which a resting particle is lifted: a number, or a tuple
CURVATURE = 2.0 * math.pi * math.pi  # half the largest second derivative of sin(2 pi x)
# x_lift is the arcsine of r / a: four roundings of the ratio, then the function.
RATIO_ERROR = 4.0 * HALF_ULP


class Sine(NamedTuple):
    """The sine sin(2 pi x)."""


class Parabolic(NamedTuple):
    """The triangle 4 x for |x| <= 1/4, and sign(x) (2 - 4 |x|) beyond.

    The height consists of parabolas.
    """


@generic
def velocity(shape: Shape, x: float) -> float:
    """Velocity w of the base at a phase in [-1/2, 1/2]."""


@generic
def kick_slope(shape: Shape, a: float, x: float) -> float:
    """Derivative of a w(x) by the phase."""


@generic
def kick_rounding(shape: Shape, a: float, w: float) -> float:
    """Bound on the error of a w at an exact phase, that of a included."""


@generic
def kick_remainder(shape: Shape, a: float, x: float, error: float) -> float:
    """Bound of the change of a w within `error` of x, beyond the one by its computed derivative."""


@generic
def kick_bend(shape: Shape, a: float, x: float, error: float) -> float:
    """Bound of the change of the derivative of a w within `error` of x."""


@generic
def peak_of(shape: Shape) -> float:
    """Largest value of w."""


@generic
def depth_of(shape: Shape) -> float:
    """Largest value of -w."""


@generic
def steepness(shape: Shape) -> float:
    """Largest |w'|."""


@generic
def turning(shape: Shape) -> tuple[float, ...]:
    """Phases of the extremes of w within a period, ascending."""


@generic
def falls_of(shape: Shape) -> int:
    """Number of local minima of w' below 0 in a period, at least 1."""


@generic
def lift_offs(shape: Shape, a: float, r: float, of_sine: float) -> LiftOffs:
    """Phases at which the kick a w(x) rises through r, NaN where it does not.

    `of_sine` is the phase for the sine.
    """


@generic
def rise_of(shape: Shape, ratio: float) -> float:
    """Phase in [0, 1/4] at which w rises through a ratio; it falls through it as far before 1/2.

    Only for shapes that are even about 1/4 and odd about 0.
    """


@generic
def lifts_once(shape: Shape) -> bool:
    """Return whether a rest ends at one phase only, for any a and r."""


@generic
def next_lift_off(shape: Shape, phases: LiftOffs, x: float) -> tuple[float, float]:
    """Phase at which a particle at rest since phase x lifts off, and whole periods passed."""


@generic
def lift_off_error(shape: Shape, a: float, r: float, phases: LiftOffs) -> float:
    """Bound on the errors of the phases of lift-offs, infinite where one may be missed.

    It holds where the largest kick exceeds r by more than rounding.
    """


@generic
def put_phases(shape: Shape, phases: LiftOffs, wait: float, s: Floats, j: int) -> None:
    """Put the phases of lift-offs into lane j, or NaN where the wait for them is infinite.

    A single phase is the fourth constant of the lane; several have rows of their own.
    """


@generic
def take_phases(shape: Shape, s: Floats, j: int) -> LiftOffs:
    """Return the phases of lift-offs of lane j."""


implements(peak_of, Sine, Parabolic)(lambda shape: 1.0)
implements(depth_of, Sine, Parabolic)(lambda shape: 1.0)
implements(turning, Sine, Parabolic)(lambda shape: (0.25, 0.75))
implements(falls_of, Sine, Parabolic)(lambda shape: 1)
implements(lifts_once, Sine, Parabolic)(lambda shape: True)
implements(take_phases, Sine, Parabolic)(lambda shape, s, j: s[ROW.CONSTANTS + 3 * STRIDE + j])


@implements(next_lift_off, Sine, Parabolic)
def next_lift_off_single(shape: Shape, phases: float, x: float) -> tuple[float, float]:
    return phases, 1.0 if x > phases else 0.0


@implements(put_phases, Sine, Parabolic)
def put_phases_single(shape: Shape, phases: float, wait: float, s: Floats, j: int) -> None:
    s[ROW.CONSTANTS + 3 * STRIDE + j] = phases if wait == 0.0 else np.nan


implements(velocity, Sine)(lambda shape, x: sin_turns(x))
implements(kick_slope, Sine)(lambda shape, a, x: 2.0 * math.pi * a * cos_turns(x))
implements(kick_bend, Sine)(lambda shape, a, x, error: 2.0 * CURVATURE * a * (error + HALF_ULP))
implements(steepness, Sine)(lambda shape: 2.0 * math.pi)
implements(lift_offs, Sine)(lambda shape, a, r, of_sine: of_sine)
implements(rise_of, Sine)(lambda shape, ratio: _arcsin_turns(ratio))


@implements(kick_rounding, Sine)
def kick_rounding_sine(shape: Shape, a: float, w: float) -> float:
    return a * (SINE_ERROR + KICK_ERROR + HALF_ULP) * abs(w)


@implements(kick_remainder, Sine)
def kick_remainder_sine(shape: Shape, a: float, x: float, error: float) -> float:
    return a * (2.0 * math.pi * COSINE_ERROR + CURVATURE * error) * error


@implements(lift_off_error, Sine)
def lift_off_error_sine(shape: Shape, a: float, r: float, phases: float) -> float:
    ratio = r / a
    slope = math.sqrt(max(0.0, (1.0 - ratio) * (1.0 + ratio)))
    change = RATIO_ERROR * ratio
    if slope * slope <= 8.0 * change:  # the kick barely reaches the threshold
        return np.inf
    return 2.0 * change / (2.0 * math.pi * slope) + ARCSINE_ERROR * phases


implements(velocity, Parabolic)(lambda shape, x: 4.0 * folded(x))
implements(steepness, Parabolic)(lambda shape: 4.0)
implements(rise_of, Parabolic)(lambda shape, ratio: 0.25 * ratio)
implements(kick_slope, Parabolic)(lambda shape, a, x: 4.0 * a if abs(x) <= 0.25 else -4.0 * a)
implements(kick_rounding, Parabolic)(lambda shape, a, w: a * (KICK_ERROR + HALF_ULP) * abs(w))
implements(lift_offs, Parabolic)(lambda shape, a, r, of_sine: 0.25 * (r / a) if a > r else np.nan)
implements(lift_off_error, Parabolic)(lambda shape, a, r, phases: RATIO_ERROR * phases)


@implements(kick_remainder, Parabolic)
def kick_remainder_parabolic(shape: Shape, a: float, x: float, error: float) -> float:
    return a * 8.0 * error if abs(abs(x) - 0.25) <= error else 0.0


@implements(kick_bend, Parabolic)
def kick_bend_parabolic(shape: Shape, a: float, x: float, error: float) -> float:
    return a * 8.0 if abs(abs(x) - 0.25) <= error else 0.0


# --- Harmonics ------------------------------------------------------------------------------------
# A base that moves as a sum of harmonics, whose number is part of the type so that loops unroll.
#
# The sum is computed by Clenshaw's method from one sine and one cosine.  Its rounding error is
# bounded as follows.  A step b_k = p_k + t b_(k+1) - b_(k+2) has two roundings, of p_k - b_(k+2)
# and of b_k, and |b_k| is at most the sum of |p_j| (j - k + 1) over j >= k.  Summed over k, these
# are at most j (j + 1) |p_j| for each j.  An error of the cosine is equivalent to one of the angle:
# by Bernstein's inequality harmonic j changes by at most j^2 times that error.  The errors of the
# sine, of the coefficients and of the last two operations are added.


STEPS = 100  # of a search
NEAR = 2.0**-30  # turns; shorter steps of Newton's method that no longer shrink are rounding


class Harmonics(NamedTuple):
    """A sum of p_h sin(2 pi h x) + q_h cos(2 pi h x)."""

    # p, q: of the harmonics 1, 2, ...
    p: tuple[float, ...]
    q: tuple[float, ...]
    # valley, peak: phases of the minimum before each local maximum above 0, and of the maximum
    valley: tuple[float, ...]
    peak: tuple[float, ...]
    # turns, extremes: phases in [0, 1] of the extremes of w and of the end of the period; w there
    turns: tuple[float, ...]
    extremes: tuple[float, ...]
    # dip, before, after: phases of each local minimum of w' below 0, and of the maxima around it
    dip: tuple[float, ...]
    before: tuple[float, ...]
    after: tuple[float, ...]
    # highest, deepest: largest w and -w
    highest: float
    deepest: float
    # fastest, fall, steepest, top, bottom: largest |w|, -w' and |w'|; largest and smallest W
    fastest: float
    fall: float
    steepest: float
    top: float
    bottom: float
    # rounding, slope_rounding: bounds on the errors of w and of w'
    rounding: float
    slope_rounding: float
    bend: float  # bound of half |w''|


@jit
def _clenshaw(shape: Shape, x: float, order: int) -> float:
    """Sum of p_h sin(2 pi h x) + q_h cos(2 pi h x), or its first or second derivative by 2 pi x."""
    sine, cosine = sin_turns(x), cos_turns(x)
    twice = 2.0 * cosine
    b, b_before, d, d_before = 0.0, 0.0, 0.0, 0.0
    most = len(shape.p)
    for k in range(most):
        h = most - k
        of_sine, of_cosine = shape.p[h - 1], shape.q[h - 1]
        if order == 1:
            of_sine, of_cosine = -h * of_cosine, h * of_sine
        elif order == 2:
            of_sine, of_cosine = -h * h * of_sine, -h * h * of_cosine
        b, b_before = fma(twice, b, of_sine - b_before), b
        d, d_before = fma(twice, d, of_cosine - d_before), d
    total: float = fma(sine, b, fma(cosine, d, -d_before))
    return total


implements(velocity, Harmonics)(lambda shape, x: _clenshaw(shape, x, 0))
implements(kick_slope, Harmonics)(lambda shape, a, x: 2.0 * math.pi * a * _clenshaw(shape, x, 1))
implements(peak_of, Harmonics)(lambda shape: shape.highest)
implements(depth_of, Harmonics)(lambda shape: shape.deepest)
implements(turning, Harmonics)(lambda shape: shape.turns[:-1])
implements(falls_of, Harmonics)(lambda shape: len(shape.dip))
implements(steepness, Harmonics)(lambda shape: shape.steepest)


@implements(kick_rounding, Harmonics)
def kick_rounding_harmonics(shape: Harmonics, a: float, w: float) -> float:
    return a * fma(KICK_ERROR + HALF_ULP, abs(w), shape.rounding)


@implements(kick_remainder, Harmonics)
def kick_remainder_harmonics(shape: Harmonics, a: float, x: float, error: float) -> float:
    return a * (shape.slope_rounding + shape.bend * error) * error


@implements(kick_bend, Harmonics)
def kick_bend_harmonics(shape: Harmonics, a: float, x: float, error: float) -> float:
    return a * (2.0 * shape.bend * error + shape.slope_rounding)


@jit
def kick_curvature(shape: Harmonics, a: float, x: float) -> float:
    """Second derivative of a w(x) by the phase."""
    return TWO_PI * TWO_PI * a * _clenshaw(shape, x, 2)


@jit
def falls_through(shape: Harmonics, alpha: float, x: float, other: float) -> float:
    """Phase between x and another at which 1 + alpha w' / 2 is 0.

    NaN unless the sum is negative at x and not negative at the other phase.
    """
    low, high = x, other
    half = 0.5 * alpha
    if not (
        1.0 + kick_slope(shape, half, low - np.rint(low)) < 0.0
        and 1.0 + kick_slope(shape, half, high - np.rint(high)) >= 0.0
    ):
        return np.nan
    x, before = 0.5 * (low + high), abs(high - low)
    for _ in range(STEPS):
        there = x - np.rint(x)
        off = 1.0 + kick_slope(shape, half, there)
        low, high = (x, high) if off < 0.0 else (low, x)
        newton = x - off / kick_curvature(shape, half, there)
        tried = _closer(x, newton, min(low, high), max(low, high), before)
        before, x = abs(tried - x), tried
        if before <= 0.25 * HALF_ULP:
            break
    return x - np.rint(x)  # type: ignore[no-any-return]


@jit
def _closer(x: float, newton: float, low: float, high: float, before: float) -> float:
    """Return the phase to try after x in search of a zero in [low, high]; x itself ends the search.

    It is that of Newton's method, or the middle of the bracket where Newton's step leaves it or is
    longer than half of the one before, unless only rounding is left.
    """
    if low <= newton <= high and abs(newton - x) <= 0.5 * before:
        return newton
    return x if before <= NEAR else 0.5 * (low + high)


@jit
def _rise(shape: Harmonics, a: float, r: float, k: int) -> float:
    """Phase at which the kick rises through r on the way to peak k; NaN where it does not."""
    low, high = shape.valley[k], shape.peak[k]  # the valley may be a period back
    if not (a * velocity(shape, low - np.rint(low)) <= r and a * velocity(shape, high) > r):
        return np.nan
    x = rises_through(shape, a, r, low, high)
    return x - np.rint(x)  # type: ignore[no-any-return]


@jit
def rises_through(shape: Harmonics, a: float, r: float, low: float, high: float) -> float:
    """Phase between two others at which a w(x) rises through r, once."""
    x, before = 0.5 * (low + high), high - low
    for _ in range(STEPS):
        there = x - np.rint(x)
        off = fma(a, velocity(shape, there), -r)
        low, high = (x, high) if off <= 0.0 else (low, x)
        tried = _closer(x, x - off / kick_slope(shape, a, there), low, high, before)
        before, x = abs(tried - x), tried
        if before <= HALF_ULP * abs(x) or abs(off) <= HALF_ULP * r:
            break
    return x


def for_each(field: str, term: str, arguments: str = "a, r, s, j", **names: Any) -> Any:
    """Return a function of a shape and `arguments` that gives a term for each element of a field.

    Terms may call `rise`, `falls` and the functions given by name.
    """
    known = {"rise": _rise, "falls": falls_through, **names}

    @functools.cache
    def written(count: int) -> Any:
        terms = "".join(f"{term.format(k=k, row=k * STRIDE)}, " for k in range(count))
        space: dict[str, Any] = {"__name__": __name__, **known}
        exec(f"def written(shape, {arguments}):\n    return ({terms})\n", space)
        return space["written"]

    def call(shape: Harmonics, *arguments: Any) -> Any:
        return written(len(getattr(shape, field)))(shape, *arguments)

    def code(shape: Any, *arguments: Any) -> Any:
        return written(len(shape.types[Harmonics._fields.index(field)]))

    return overloaded(call, call, code)


_rises = for_each("peak", "rise(shape, a, r, {k})")
_taken = for_each("peak", f"s[{ROW.PHASES} + {{row}} + j]")


implements(lift_offs, Harmonics)(lambda shape, a, r, of_sine: _rises(shape, a, r, 0.0, 0))
implements(lifts_once, Harmonics)(lambda shape: len(shape.peak) == 1)
implements(next_lift_off, Harmonics)(lambda shape, phases, x: next_phase(phases, x))
implements(take_phases, Harmonics)(lambda shape, s, j: _taken(shape, 0.0, 0.0, s, j))


@jit
def next_phase(phases: LiftOffs, x: float) -> tuple[float, float]:
    """Return the next of some phases from phase x on, NaN if there is none, and periods passed."""
    found, ahead, passed = np.nan, np.inf, 0.0
    for k in range(len(phases)):
        over = 1.0 if x > phases[k] else 0.0
        nearer = (phases[k] - x) + over < ahead
        found = phases[k] if nearer else found
        passed = over if nearer else passed
        ahead = (phases[k] - x) + over if nearer else ahead
    return found, passed


@implements(lift_off_error, Harmonics)
def lift_off_error_harmonics(shape: Harmonics, a: float, r: float, phases: LiftOffs) -> float:
    worst = 0.0
    for k in range(len(phases)):
        for x in (shape.valley[k], shape.peak[k]):
            w = velocity(shape, x - np.rint(x))
            if abs(a * w - r) <= 2.0 * (kick_rounding(shape, a, w) + REST_ERROR * r):
                return np.inf
        x = phases[k]
        if x == x:
            worst = max(worst, rise_error(shape, a, r, x, 0.0))
    return worst


@jit
def rise_error(shape: Harmonics, a: float, r: float, x: float, more: float) -> float:
    """Bound on the error of a phase at which a w(x) rises through r; infinite if none is known.

    `more` bounds errors of the kick beyond its rounding.
    """
    size, w = abs(a), velocity(shape, x)
    off = abs(fma(a, w, -r)) + kick_rounding(shape, size, w) + 2.0 * REST_ERROR * r + more
    slope = kick_slope(shape, a, x) - size * shape.slope_rounding
    # Kantorovich's condition for Newton's method
    if not (slope > 0.0 and off * (2.0 * size * shape.bend) <= 0.25 * slope * slope):
        return np.inf
    return 2.0 * off / slope + HALF_ULP


@implements(put_phases, Harmonics)
def put_phases_harmonics(
    shape: Harmonics, phases: LiftOffs, wait: float, s: Floats, j: int
) -> None:
    for k in range(len(phases)):
        s[ROW.PHASES + k * STRIDE + j] = phases[k]


# --- Shapes of the waveforms of the model ---------------------------------------------------------


def motion(waveform: Waveform, turns: Array) -> tuple[Array, Array]:
    """Velocity w of a shape and 2 pi times its height W, at phases in turns."""
    if waveform.name == PARABOLIC_NAME:
        return waveform.velocity(turns), TWO_PI * waveform.height(turns)
    turns = turns - np.rint(turns)
    velocities: list[Array] = []
    levels: list[Array] = []
    for h, weight, phase in waveform.harmonics:
        angle = h * turns + turns_of_radians(np.asarray(phase))
        sines, cosines = np.empty_like(turns), np.empty_like(turns)
        waves(np.ravel(angle), sines.ravel(), cosines.ravel())
        velocities.append(weight * sines)
        levels.append(-weight / h * cosines)
    return sum(velocities[1:], velocities[0]), sum(levels[1:], levels[0])


@functools.lru_cache(maxsize=64)
def shape_of(waveform: Waveform) -> Shape:
    """Return the shape that kernels are compiled for."""
    if waveform.name != HARMONICS_NAME:
        return {SINE_NAME: Sine, PARABOLIC_NAME: Parabolic}[waveform.name]()
    most = max(h for h, _, _ in waveform.tones)
    weight, phase = np.zeros(most), np.zeros(most)
    for h, c, psi in waveform.tones:
        weight[h - 1], phase[h - 1] = c, psi
    sines, cosines = np.empty(most), np.empty(most)
    waves(turns_of_radians(phase), sines, cosines)
    p, q = weight * cosines, weight * sines
    number = np.arange(1.0, most + 1.0)
    size = np.abs(p) + np.abs(q)
    # (5.3 h^2 + h + 4.5) half ulps in the sum, 9 of a coefficient
    rounding = HALF_ULP * float(np.sum(size * (6.0 * number**2 + number + 14.0)))
    sloped = HALF_ULP * float(np.sum(size * number * (6.0 * number**2 + number + 16.0)))
    turns = zeros(waveform, 1)
    valleys = np.concatenate([[turns[-1] - 1.0], turns[:-1]])
    rises = waveform.slope(0.5 * (valleys + turns)) > 0.0
    rises &= waveform.velocity(turns) > 0.0
    bends = zeros(waveform, 2)
    around = np.concatenate([[bends[-1] - 1.0], bends, [bends[0] + 1.0]])
    places = np.append(np.sort(np.where(turns < 0.0, turns + 1.0, turns)), 1.0)
    extremes, _ = motion(waveform, places)
    dips = (waveform.slope(bends) < waveform.slope(around[:-2])) & (waveform.slope(bends) < 0.0)
    levels = waveform.height(zeros(waveform, 0))
    return Harmonics(
        tuple(p.tolist()),
        tuple(q.tolist()),
        tuple(valleys[rises].tolist()),
        tuple(turns[rises].tolist()),
        tuple(places.tolist()),
        tuple(extremes.tolist()),
        tuple(bends[dips].tolist()),
        tuple(around[:-2][dips].tolist()),
        tuple(around[2:][dips].tolist()),
        waveform.highest,
        -float(extremes.min()),
        float(np.abs(waveform.velocity(turns)).max()),
        waveform.fall,
        float(np.abs(waveform.slope(bends)).max()),
        float(levels.max()),
        float(levels.min()),
        rounding,
        TWO_PI * sloped,
        0.5005 * waveform.sum_of(2),
    )
