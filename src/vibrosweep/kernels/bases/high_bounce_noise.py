"""Noise over a base that stays at height 0: random impacts, and ends of rests.

Where the amplitude is random, a particle that has come to rest is lifted in the first forcing
period whose kick rises through the threshold of rest; no formula gives this period.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from vibrosweep.kernels import bases
from vibrosweep.kernels._jit import Floats, implements, jit, wide_vectors
from vibrosweep.kernels.bases.error_bounds import StateError
from vibrosweep.kernels.bases.high_bounce import Constants, HighBounce
from vibrosweep.kernels.bases.random_lifts import lift_in, lift_in_error
from vibrosweep.kernels.deviates import OF_DRIVE, deviate
from vibrosweep.kernels.lanes import ROW, STRIDE
from vibrosweep.kernels.noise import Noise, draw_of, driven, period_of
from vibrosweep.kernels.rounding import REST_ERROR

LONGEST: Final = 2**24  # forcing periods after which the search for a lift-off ends


@implements(bases.random, Constants)
def random_high_bounce(
    fixed: Constants, particle: float, number: float, n: float, x: float
) -> Constants:
    period = period_of(n + fixed.source.turns, x)
    draw = draw_of(fixed.base.noise, fixed.source, particle, number, period)
    e, a, r, scale = fixed.e, driven(fixed.base.noise, fixed.a, draw.drive), fixed.r, fixed.scale
    x_lift, wait, u_lift, source = fixed.x_lift, fixed.wait, fixed.u_lift, fixed.source
    return Constants(fixed.base, e, a, r, scale, x_lift, wait, u_lift, source, draw)


@jit
def random_drive(noise: Noise | None) -> int | None:
    """Return the field `drive` of the noise of a base; None if there is no noise."""
    if noise is None:
        return None
    return noise.drive


@jit
def _first_lift(fixed: Constants, n: float, x: float) -> tuple[float, float]:
    """Whole periods and phase at which the kick first exceeds r from (n, x) on.

    The counts include the whole turns in the phase at t = 0.  After `LONGEST` periods the search
    ends: the count is NaN then.
    """
    noise, period, size = fixed.base.noise, period_of(n, x), fixed.source.drive
    key, stream = noise.key, fixed.source.stream  # type: ignore[union-attr]
    after = x + (n - period)  # turns from the beginning of the period, in [0, 1]
    for _ in range(LONGEST):
        kick = driven(noise, fixed.a, size * deviate(key, stream, 0.0, period, OF_DRIVE))
        lifts, after = lift_in(fixed.base.waveform, kick, fixed.r, after, True)
        if lifts:
            whole = np.rint(after)
            return period + whole, after - whole
        period, after = period + 1.0, 0.0
    return np.nan, 0.0


@jit
def first_lift_error(fixed: Constants, n: float, x: float, error: float) -> StateError:
    """Bounds on the errors of `_first_lift`, from that of the phase x of the rest.

    The bound of the phase is infinite where it is in doubt which forcing period lifts the particle.
    """
    shape, a, r = fixed.base.waveform, fixed.a, fixed.r
    period, size = period_of(n + fixed.source.turns, x), fixed.source.drive
    key, stream = fixed.base.noise.key, fixed.source.stream  # type: ignore[union-attr]
    after = x + (n + fixed.source.turns - period)
    for _ in range(LONGEST):
        drive = size * deviate(key, stream, 0.0, period, OF_DRIVE)
        lifts, off = lift_in_error(shape, a, drive, r, after, error)
        if lifts:
            return StateError(off, REST_ERROR * r if off < np.inf else np.inf)
        period, after, error = period + 1.0, 0.0, 0.0
    return StateError(np.inf, np.inf)


@implements(bases.wake, Constants)
def wake_high_bounce(fixed: Constants, n: float, x: float, origin: float) -> tuple[float, float]:
    return _wake(random_drive(fixed.base.noise), fixed, n, x, origin)


@jit
def _wake(
    on: int | None, fixed: Constants, n: float, x: float, origin: float
) -> tuple[float, float]:
    if on is None or n == np.inf:
        return n, x
    origin += fixed.source.turns
    whole, phase = _first_lift(fixed, n + origin, x)
    return whole - origin, phase


@implements(bases.prepare, HighBounce)
def prepare_high_bounce(base: HighBounce, s: Floats, lanes: int) -> None:
    _wake_lanes(random_drive(base.noise), base, s, lanes)


@jit
def _wake_lanes(on: int | None, base: HighBounce, s: Floats, lanes: int) -> None:
    """Check in each resting lane if its present period ends the rest, as `_first_lift` does."""
    if on is not None:
        wide_vectors()
        for j in range(lanes):
            a, r = s[ROW.CONSTANTS + STRIDE + j], s[ROW.CONSTANTS + 2 * STRIDE + j]
            n, x, origin = s[ROW.N + j], s[ROW.X + j], s[ROW.ORIGIN + j]
            tried = s[ROW.ASLEEP + j]
            period = period_of(n + origin, x)
            kick = driven(base.noise, a, s[ROW.DRIVE + j])
            rests = tried > 0.0
            lifts, after = lift_in(base.waveform, kick, r, x + (n + origin - period), rests)
            given_up = rests & (tried >= LONGEST) & (not lifts)
            whole = np.rint(after) if lifts else 1.0
            x_off = after - whole if lifts else 0.0
            s[ROW.N + j] = period + whole - origin if rests else n
            s[ROW.X + j] = (np.nan if given_up else x_off) if rests else x
            s[ROW.AGE + j] = np.inf if given_up else s[ROW.AGE + j]
            s[ROW.ASLEEP + j] = (-1.0 if lifts else tried + 1.0) if rests else tried
