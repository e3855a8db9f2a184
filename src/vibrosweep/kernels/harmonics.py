"""A base that moves as a sum of harmonics; their number is part of the type, so that loops unroll.

The sum over harmonics is Clenshaw's, from one sine and one cosine.  Its rounding: a step that
computes b_k = p_k + t b_(k+1) - b_(k+2) makes a coefficient off by two roundings, of p_k - b_(k+2)
and of b_k, and |b_k| is at most the sum of |p_j| (j - k + 1) over j >= k; summed over k these are
at most j (j + 1) of each |p_j|.  An error of the cosine turns the angle: by Bernstein's inequality
harmonic j changes by at most j^2 of it.  Those of the sine, of the coefficients and of the last two
operations are added.
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload

from vibrosweep.arrays import Array
from vibrosweep.kernels._jit import OF_A_PIECE, Floats, fma, implements, jit
from vibrosweep.kernels.lanes import ROW, STRIDE
from vibrosweep.kernels.rounding import HALF_ULP, KICK_ERROR, REST_ERROR
from vibrosweep.kernels.sine import cos_turns, sin_turns, waves
from vibrosweep.kernels.waveforms import (
    LiftOffs,
    Parabolic,
    Shape,
    Sine,
    first_lift_off,
    kick_bend,
    kick_rounding,
    kick_slope,
    left_out,
    lift_off_error,
    lift_offs,
    lifts_once,
    next_lift_off,
    peak_of,
    put_phases,
    take_phases,
    velocity,
)
from vibrosweep.model.shapes import (
    HARMONICS_NAME,
    PARABOLIC_NAME,
    SINE_NAME,
    TWO_PI,
    Waveform,
    zeros,
)
from vibrosweep.model.turns import turns_of_radians

STEPS = 100  # of Newton's method within a bracket, which every third halves


class Harmonics(NamedTuple):
    """A sum of p_h sin(2 pi h x) + q_h cos(2 pi h x)."""

    # p, q: of the harmonics 1, 2, ...
    p: tuple[float, ...]
    q: tuple[float, ...]
    # valley, peak: phases of each local maximum above 0, and of the minimum before it
    valley: tuple[float, ...]
    peak: tuple[float, ...]
    # dip, before, after: phases of each local minimum of w' below 0, of the maxima around it
    dip: tuple[float, ...]
    before: tuple[float, ...]
    after: tuple[float, ...]
    highest: float  # of w
    # fastest, fall, steepest, top, bottom: of |w|, of -w', of |w'|, and of W
    fastest: float
    fall: float
    steepest: float
    top: float
    bottom: float
    # rounding, slope_rounding: bounds of the errors of w and of w'
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


@implements(velocity, Harmonics)
def velocity_harmonics(shape: Harmonics, x: float) -> float:
    return _clenshaw(shape, x, 0)


@implements(kick_slope, Harmonics)
def kick_slope_harmonics(shape: Harmonics, a: float, x: float) -> float:
    return 2.0 * math.pi * a * _clenshaw(shape, x, 1)


@implements(kick_rounding, Harmonics)
def kick_rounding_harmonics(shape: Harmonics, a: float, w: float) -> float:
    return a * fma(KICK_ERROR + HALF_ULP, abs(w), shape.rounding)


@implements(left_out, Harmonics)
def left_out_harmonics(shape: Harmonics, a: float, x: float, error: float) -> float:
    return a * (shape.slope_rounding + shape.bend * error) * error


@implements(kick_bend, Harmonics)
def kick_bend_harmonics(shape: Harmonics, a: float, x: float, error: float) -> float:
    return a * (2.0 * shape.bend * error + shape.slope_rounding)


@implements(peak_of, Harmonics)
def peak_of_harmonics(shape: Harmonics) -> float:
    return shape.highest


@jit
def kick_curvature(shape: Harmonics, a: float, x: float) -> float:
    """Second derivative of a w(x) by the phase."""
    return TWO_PI * TWO_PI * a * _clenshaw(shape, x, 2)


@jit
def falls_through(shape: Harmonics, alpha: float, x: float, other: float) -> float:
    """Phase between two others at which 1 + alpha w' / 2 is 0; NaN where it has one sign at both.

    It is negative at the first one.
    """
    low, high = x, other
    half = 0.5 * alpha
    if not (
        1.0 + kick_slope(shape, half, low - np.rint(low)) < 0.0
        and 1.0 + kick_slope(shape, half, high - np.rint(high)) >= 0.0
    ):
        return np.nan
    x = 0.5 * (low + high)
    for step in range(STEPS):
        there = x - np.rint(x)
        off = 1.0 + kick_slope(shape, half, there)
        low, high = (x, high) if off < 0.0 else (low, x)
        tried = x - off / kick_curvature(shape, half, there)
        halves = step % 3 == 2 or not min(low, high) < tried < max(low, high)
        tried = 0.5 * (low + high) if halves else tried
        if abs(tried - x) <= 0.25 * HALF_ULP:
            break
        x = tried
    return x - np.rint(x)  # type: ignore[no-any-return]


@jit
def _rise(shape: Harmonics, a: float, r: float, k: int) -> float:
    """Phase at which the kick rises through r on the way to peak k; NaN where it does not."""
    low, high = shape.valley[k], shape.peak[k]  # the valley may be a period back
    if not (a * velocity(shape, low - np.rint(low)) <= r and a * velocity(shape, high) > r):
        return np.nan
    x = 0.5 * (low + high)
    for step in range(STEPS):
        there = x - np.rint(x)
        off = fma(a, velocity(shape, there), -r)
        low, high = (x, high) if off <= 0.0 else (low, x)
        slope = kick_slope(shape, a, there)
        tried = x - off / slope
        halves = step % 3 == 2 or not low < tried < high
        tried = 0.5 * (low + high) if halves else tried
        if abs(tried - x) <= HALF_ULP * abs(x) or abs(off) <= HALF_ULP * r:
            break
        x = tried
    return x - np.rint(x)  # type: ignore[no-any-return]


def for_each(field: str, term: str, given: str = "a, r, s, j", **names: Any) -> Any:
    """Function of a shape and what is `given` that returns a term for each element of a field.

    Terms may call what the names stand for, `rise` and `falls`.
    """
    known = {"rise": _rise, "falls": falls_through, **names}

    @functools.cache
    def written(count: int) -> Any:
        terms = "".join(f"{term.format(k=k, row=k * STRIDE)}, " for k in range(count))
        space: dict[str, Any] = dict(known)
        exec(f"def written(shape, {given}):\n    return ({terms})\n", space)
        return space["written"]

    def call(shape: Harmonics, *arguments: Any) -> Any:
        return written(len(getattr(shape, field)))(shape, *arguments)

    @overload(call, jit_options=OF_A_PIECE, strict=False)
    def chosen(shape: Any, *arguments: Any) -> Any:
        return written(len(shape.types[Harmonics._fields.index(field)]))

    return call


_rises = for_each("peak", "rise(shape, a, r, {k})")
_taken = for_each("peak", f"s[{ROW.PHASES} + {{row}} + j]")


@implements(lift_offs, Harmonics)
def lift_offs_harmonics(shape: Harmonics, a: float, r: float, of_sine: float) -> LiftOffs:
    return _rises(shape, a, r, 0.0, 0)


@implements(lifts_once, Harmonics)
def lifts_once_harmonics(shape: Harmonics) -> bool:
    return len(shape.peak) == 1


@implements(next_lift_off, Harmonics)
def next_lift_off_harmonics(shape: Harmonics, phases: LiftOffs, x: float) -> tuple[float, float]:
    found, ahead, later = np.nan, np.inf, 0.0
    for k in range(len(phases)):
        over = 1.0 if x > phases[k] else 0.0
        nearer = (phases[k] - x) + over < ahead
        found = phases[k] if nearer else found
        later = over if nearer else later
        ahead = (phases[k] - x) + over if nearer else ahead
    return found, later


@implements(first_lift_off, Harmonics)
def first_lift_off_harmonics(shape: Harmonics, phases: LiftOffs) -> float:
    return next_lift_off(shape, phases, -0.5)[0]


@implements(lift_off_error, Harmonics)
def lift_off_error_harmonics(shape: Harmonics, a: float, r: float, phases: LiftOffs) -> float:
    worst, bend = 0.0, 2.0 * a * shape.bend
    for k in range(len(phases)):
        for x in (shape.valley[k], shape.peak[k]):
            w = velocity(shape, x - np.rint(x))
            if abs(a * w - r) <= 2.0 * (kick_rounding(shape, a, w) + REST_ERROR * r):
                return np.inf
        x = phases[k]
        if x == x:
            w = velocity(shape, x)
            off = abs(fma(a, w, -r)) + kick_rounding(shape, a, w) + 2.0 * REST_ERROR * r
            slope = kick_slope(shape, a, x) - a * shape.slope_rounding
            # Kantorovich's condition for Newton's method
            if not (slope > 0.0 and off * bend <= 0.25 * slope * slope):
                return np.inf
            worst = max(worst, 2.0 * off / slope + HALF_ULP)
    return worst


@implements(put_phases, Harmonics)
def put_phases_harmonics(
    shape: Harmonics, phases: LiftOffs, wait: float, s: Floats, j: int
) -> None:
    for k in range(len(phases)):
        s[ROW.PHASES + k * STRIDE + j] = phases[k]


@implements(take_phases, Harmonics)
def take_phases_harmonics(shape: Harmonics, s: Floats, j: int) -> LiftOffs:
    return _taken(shape, 0.0, 0.0, s, j)


def motion(waveform: Waveform, turns: Array) -> tuple[Array, Array]:
    """Velocity w of a shape and 2 pi times its height W, at phases in turns."""
    if waveform.name == PARABOLIC_NAME:
        return waveform.velocity(turns), TWO_PI * waveform.height(turns)
    turns = turns - np.rint(turns)
    velocities: list[Array] = []
    levels: list[Array] = []
    for h, weight, phase in waveform.tones or ((1, 1.0, 0.0),):
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
    dips = (waveform.slope(bends) < waveform.slope(around[:-2])) & (waveform.slope(bends) < 0.0)
    levels = waveform.height(zeros(waveform, 0))
    return Harmonics(
        tuple(p.tolist()),
        tuple(q.tolist()),
        tuple(valleys[rises].tolist()),
        tuple(turns[rises].tolist()),
        tuple(bends[dips].tolist()),
        tuple(around[:-2][dips].tolist()),
        tuple(around[2:][dips].tolist()),
        waveform.highest,
        float(np.abs(waveform.velocity(turns)).max()),
        waveform.fall,
        float(np.abs(waveform.slope(bends)).max()),
        float(levels.max()),
        float(levels.min()),
        rounding,
        TWO_PI * sloped,
        0.5005 * waveform.sum_of(2),
    )
