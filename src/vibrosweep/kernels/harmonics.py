"""A base that moves as a sum of harmonics, whose number is part of the type so that loops unroll.

The sum over harmonics is computed by Clenshaw's method from one sine and one cosine.  Its rounding
error is bounded as follows.  A step b_k = p_k + t b_(k+1) - b_(k+2) has two roundings, of
p_k - b_(k+2) and of b_k, and |b_k| is at most the sum of |p_j| (j - k + 1) over j >= k.  Summed
over k, these are at most j (j + 1) |p_j| for each j.  An error of the cosine is equivalent to one
of the angle: by Bernstein's inequality harmonic j changes by at most j^2 times that error.  The
errors of the sine, of the coefficients and of the last two operations are added.
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, Piece, fma, implements, jit
from vibrosweep.kernels.lanes import ROW, STRIDE
from vibrosweep.kernels.rounding import HALF_ULP, KICK_ERROR, REST_ERROR
from vibrosweep.kernels.sine import cos_turns, sin_turns
from vibrosweep.kernels.waveforms import (
    LiftOffs,
    Shape,
    depth_of,
    falls_of,
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
    steepness,
    take_phases,
    turning,
    velocity,
)
from vibrosweep.model.shapes import TWO_PI

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


@implements(left_out, Harmonics)
def left_out_harmonics(shape: Harmonics, a: float, x: float, error: float) -> float:
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

    return Piece(call, call, code)


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
