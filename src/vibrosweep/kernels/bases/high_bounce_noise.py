"""Noise over a base that stays at height 0: what is random in an impact, and rests that it ends.

Where the amplitude is random, a particle that has come to rest is lifted in the first forcing
period whose kick rises through the threshold of rest, which no formula gives.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from vibrosweep.kernels import bases
from vibrosweep.kernels._jit import Floats, implements, jit
from vibrosweep.kernels.bases.high_bounce import Constants, HighBounce
from vibrosweep.kernels.lanes import ROW, STRIDE
from vibrosweep.kernels.noise import (
    OF_DRIVE,
    Noise,
    deviate,
    draw_of,
    driven,
    period_of,
)
from vibrosweep.model.arcsine import arcsin_turns

__all__: list[str] = []

_arcsin_turns = jit(arcsin_turns)
LONGEST: Final = 2**24  # forcing periods that a particle rests, where none of them lifts it


@implements(bases.random, Constants)
def random_high_bounce(
    fixed: Constants, particle: float, number: float, n: float, x: float
) -> Constants:
    draw = draw_of(fixed.base.noise, fixed.source, particle, number, period_of(n, x))
    return Constants(
        fixed.base,
        fixed.e,
        driven(fixed.base.noise, fixed.a, draw.drive),
        fixed.r,
        fixed.scale,
        fixed.x_lift,
        fixed.wait,
        fixed.u_lift,
        fixed.source,
        draw,
    )


@jit
def _first_lift(
    noise: Noise, stream: float, size: float, a: float, r: float, n: float, x: float
) -> tuple[float, float]:
    """Whole periods and phase at which the kick first exceeds r from (n, x) on.

    After `LONGEST` periods the search ends: the count is NaN then.
    """
    period = period_of(n, x)
    after = x + (n - period)  # turns from the beginning of the period, in [0, 1]
    for _ in range(LONGEST):
        kick = driven(noise, a, size * deviate(noise.key, stream, 0.0, period, OF_DRIVE))
        if abs(kick) > r:
            rises = _arcsin_turns(r / abs(kick))
            falls = 0.5 - rises
            if kick < 0.0:  # the kick is upward in the second half of the period
                rises, falls = 0.5 + rises, 0.5 + falls
            if after < falls:
                after = max(after, rises)
                whole = np.rint(after)
                return period + whole, after - whole
        period, after = period + 1.0, 0.0
    return np.nan, 0.0


@implements(bases.wake, Constants)
def wake_high_bounce(fixed: Constants, n: float, x: float, origin: float) -> tuple[float, float]:
    return _wake(fixed.base.noise, fixed, n, x, origin)


@jit
def _wake(
    noise: Noise | None, fixed: Constants, n: float, x: float, origin: float
) -> tuple[float, float]:
    if noise is None:
        return n, x
    return _wake_in(noise.drive, noise, fixed, n, x, origin)


@jit
def _wake_in(
    on: int | None, noise: Noise, fixed: Constants, n: float, x: float, origin: float
) -> tuple[float, float]:
    if on is None or n == np.inf:
        return n, x
    stream, size = fixed.source.stream, fixed.source.drive
    whole, phase = _first_lift(noise, stream, size, fixed.a, fixed.r, n + origin, x)
    return whole - origin, phase


@implements(bases.wake_lanes, HighBounce)
def wake_lanes_high_bounce(base: HighBounce, s: Floats, lanes: int) -> None:
    _wake_all(base.noise, s, lanes)


@jit
def _wake_all(noise: Noise | None, s: Floats, lanes: int) -> None:
    if noise is not None:
        _wake_lanes(noise.drive, noise, s, lanes)


@jit
def _wake_lanes(on: int | None, noise: Noise, s: Floats, lanes: int) -> None:
    if on is not None:
        for j in range(lanes):
            if s[ROW.ASLEEP + j] != 0.0:
                a, r = s[ROW.CONSTANTS + STRIDE + j], s[ROW.CONSTANTS + 2 * STRIDE + j]
                n, x, origin = s[ROW.N + j], s[ROW.X + j], s[ROW.ORIGIN + j]
                stream, size = s[ROW.STREAM + j], s[ROW.DRIVE_SIZE + j]
                n, x = _first_lift(noise, stream, size, a, r, n + origin, x)
                if n != n:
                    s[ROW.AGE + j], x = np.inf, np.nan
                s[ROW.N + j], s[ROW.X + j] = n - origin, x
