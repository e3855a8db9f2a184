"""Velocity of the base over a period, by the type of its shape, in units of V0.

A shape is a named tuple: empty for the sine and the triangle, with the numbers of one sweep for
`vibrosweep.kernels.harmonics.Harmonics`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, generic, implements, jit
from vibrosweep.kernels.lanes import ROW, STRIDE
from vibrosweep.kernels.rounding import HALF_ULP, KICK_ERROR
from vibrosweep.kernels.sine import COSINE_ERROR, SINE_ERROR, cos_turns, folded, sin_turns
from vibrosweep.model.turns import ARCSINE_ERROR, arcsin_turns

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
def left_out(shape: Shape, a: float, x: float, error: float) -> float:
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
    """Return whether a rest ends at one phase only, whatever a and r."""


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


@implements(left_out, Sine)
def left_out_sine(shape: Shape, a: float, x: float, error: float) -> float:
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


@implements(left_out, Parabolic)
def left_out_parabolic(shape: Shape, a: float, x: float, error: float) -> float:
    return a * 8.0 * error if abs(abs(x) - 0.25) <= error else 0.0


@implements(kick_bend, Parabolic)
def kick_bend_parabolic(shape: Shape, a: float, x: float, error: float) -> float:
    return a * 8.0 if abs(abs(x) - 0.25) <= error else 0.0
