"""Lift-off from a rest in one forcing period, by the type of the shape, with noise of the drive."""

from __future__ import annotations

from typing import Final

import numpy as np

from vibrosweep.kernels._jit import fma, generic, implements
from vibrosweep.kernels.harmonics import Harmonics, rise_error, rises_through
from vibrosweep.kernels.rounding import HALF_ULP, KICK_ERROR, REST_ERROR
from vibrosweep.kernels.waveforms import (
    Parabolic,
    Shape,
    Sine,
    kick_rounding,
    kick_slope,
    left_out,
    lift_off_error,
    rise_of,
    velocity,
)

USELESS: Final = 2.0**-20  # turns; a larger bound on the error of a lift-off is of no use


@generic
def lift_in(shape: Shape, kick: float, r: float, after: float, rests: bool) -> tuple[bool, float]:
    """Return whether the kick exceeds r in a period from `after` on, and when first, in turns.

    The result has no meaning for a particle that does not rest.
    """


@generic
def lift_in_error(
    shape: Shape, a: float, drive: float, r: float, after: float, error: float
) -> tuple[bool, float]:
    """Return whether `lift_in` lifts, and a bound on the error of its time.

    `error` is that of `after`.  The bound is infinite where either is in doubt.  The kick of a
    period, a (1 + drive), takes two more roundings than without noise, and its noise another two.
    """


@implements(lift_in, Sine, Parabolic)
def lift_in_even(
    shape: Shape, kick: float, r: float, after: float, rests: bool
) -> tuple[bool, float]:
    rises = rise_of(shape, r / abs(kick))
    falls = 0.5 - rises
    # where it is negative the kick is upward in the second half of the period
    rises, falls = (0.5 + rises, 0.5 + falls) if kick < 0.0 else (rises, falls)
    return (abs(kick) > r) & (after < falls), max(after, rises)


@implements(lift_in_error, Sine, Parabolic)
def lift_in_error_even(
    shape: Shape, a: float, drive: float, r: float, after: float, error: float
) -> tuple[bool, float]:
    kick = abs(fma(a, drive, a))
    off = 2.0 * KICK_ERROR * (kick + a * abs(drive)) + REST_ERROR * r
    if not abs(kick - r) > 2.0 * off:
        return True, np.inf
    if not kick > r:
        return False, 0.0
    rises = rise_of(shape, r / kick)
    factor = 3.0 + a * abs(drive) / kick
    edge = error + (factor * lift_off_error(shape, kick, r, rises) + 4.0 * HALF_ULP)
    turned = 0.5 if 1.0 + drive < 0.0 else 0.0
    rises, falls = turned + rises, turned + 0.5 - rises
    if not min(abs(after - rises), abs(after - falls)) > edge or edge > USELESS:
        return True, np.inf
    return after < falls, error if after > rises else edge


@implements(lift_in, Harmonics)
def lift_in_harmonics(
    shape: Harmonics, kick: float, r: float, after: float, rests: bool
) -> tuple[bool, float]:
    if not rests:
        return False, after
    begun = velocity(shape, after - np.rint(after)) if after > 0.0 else shape.extremes[-1]
    if kick * begun > r:
        return True, after
    for k in range(len(shape.turns)):
        if shape.turns[k] > after:
            if kick * shape.extremes[k] > r:
                return True, rises_through(shape, kick, r, after, shape.turns[k])
            after = shape.turns[k]
    return False, after


@implements(lift_in_error, Harmonics)
def lift_in_error_harmonics(
    shape: Harmonics, a: float, drive: float, r: float, after: float, error: float
) -> tuple[bool, float]:
    kick = fma(a, drive, a)
    size = abs(kick)
    more = 2.0 * KICK_ERROR * (size + a * abs(drive)) * shape.fastest
    x, near = after - np.rint(after), error + HALF_ULP * after
    w = velocity(shape, x)
    off = kick_rounding(shape, size, w) + REST_ERROR * r + more
    off += abs(kick_slope(shape, kick, x)) * near + left_out(shape, size, x, near)
    if not abs(kick * w - r) > 2.0 * off:
        return True, np.inf
    if kick * w > r:
        return True, near
    for k in range(len(shape.turns)):
        w = shape.extremes[k]
        off = kick_rounding(shape, size, w) + REST_ERROR * r + more
        if shape.turns[k] > after and not abs(kick * w - r) > 2.0 * off:
            return True, np.inf
        if shape.turns[k] > after and kick * w > r:
            x = rises_through(shape, kick, r, after, shape.turns[k])
            return True, rise_error(shape, kick, r, x - np.rint(x), more)
        after = max(after, shape.turns[k])
    return False, 0.0
