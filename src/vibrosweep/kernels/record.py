"""Every landing of a trajectory, in physical units."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Flags, Floats, jit
from vibrosweep.kernels.unwritten import empty


class Record(NamedTuple):
    """Landings of trajectories: each array has shape (trajectory, impact), or (landing,)."""

    # landing_time, liftoff_time: s; NaN past the last landing, and for a lift-off that never comes
    landing_time: Floats
    liftoff_time: Floats
    rebound_velocity: Floats  # speed at lift-off, m s-1; NaN where there is none
    rested: Flags  # 1 where the particle rested after the landing


def empty_record(*shape: int) -> Record:
    """Allocate arrays of a shape: (trajectories, most landings of each), or (landings,)."""
    return empty(Record, *shape)


class Units(NamedTuple):
    """Physical units of a batch."""

    frequency: Floats  # Hz, shape (realization,)
    # Speed whose flight lasts one forcing period, g / (2 f) in m s-1, shape (realization,)
    velocity: Floats


class Scale(NamedTuple):
    """Units and origin of time of one realization."""

    # frequency, velocity: Hz, and g / (2 f) in m s-1
    frequency: float
    velocity: float
    # origin, phase: whole periods at which counts begin, and phase of the forcing at t = 0
    origin: float
    phase: float


@jit
def seconds(scale: Scale, n: float, x: float) -> float:
    """Return the time in s of an instant, given in whole periods and phase."""
    return (n + scale.origin + (x - scale.phase)) / scale.frequency


@jit
def no_landings(out: Record, first: int, last: int) -> None:
    """Write that trajectories first ... last - 1 have not landed."""
    for t in range(first, last):
        for k in range(out.rested.shape[1]):
            out.landing_time[t, k] = out.liftoff_time[t, k] = out.rebound_velocity[t, k] = np.nan
            out.rested[t, k] = 0


@jit
def write_landing(
    out: Record, t: int, k: int, scale: Scale, n: float, x: float, rests: bool
) -> None:
    """Write the instant of landing k of trajectory t; what exceeds the record is cut off."""
    if k < out.rested.shape[1]:
        out.landing_time[t, k] = seconds(scale, n, x)
        out.rested[t, k] = 1 if rests else 0


@jit
def write_lift_off(
    out: Record, t: int, k: int, scale: Scale, n: float, x: float, speed: float
) -> None:
    """Write the lift-off that follows landing k of trajectory t, with a speed in g / (2 f)."""
    if k < out.rested.shape[1]:
        out.liftoff_time[t, k] = seconds(scale, n, x)
        out.rebound_velocity[t, k] = speed * scale.velocity
