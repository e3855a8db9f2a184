"""Every landing of a trajectory, in physical units."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Flags, Floats, jit, kernel
from vibrosweep.kernels.bases import constants, speed
from vibrosweep.kernels.impact import Batch, impact, launch, launch_speed
from vibrosweep.kernels.unwritten import unwritten


class Record(NamedTuple):
    """Landings of trajectories: each array has shape (trajectory, impact)."""

    # landing_time, liftoff_time: s; NaN past the last landing, and for the lift-off that never
    # comes
    landing_time: Floats
    liftoff_time: Floats
    rebound_velocity: Floats  # speed at lift-off, m s-1; NaN where there is none
    rested: Flags  # 1 where the particle rested after the landing


def empty_record(trajectories: int, impacts: int) -> Record:
    """Allocate at most `impacts` landings of each trajectory."""
    shape = (trajectories, impacts)
    landing, liftoff, velocity = (unwritten(shape) for _ in range(3))
    return Record(landing, liftoff, velocity, unwritten(shape, np.int8))


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
    # origin, phase: what whole periods are counted from, and phase of the forcing at t = 0
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


@kernel
def record(first: int, last: int, batch: Batch, units: Units, out: Record) -> None:
    """Write the landings of trajectories first ... last - 1 until the end of the window.

    A trajectory with more landings than the capacity of the record is cut off.
    """
    base, problem, launches = batch
    particles = launches.whole.shape[1]
    no_landings(out, first, last)
    for t in range(first, last):
        i, p = t // particles, t % particles
        fixed = constants(base, problem, i)
        n, x = launch(launches, i, p, problem.phase[i])
        u = launch_speed(fixed, problem, i, x)
        scale = Scale(units.frequency[i], units.velocity[i], 0.0, problem.phase[i])
        for k in range(out.rested.shape[1]):
            hit = impact(fixed, n, x, u, p, k)
            if not hit.n - problem.end_count[i] <= problem.end_phase[i] - hit.x:
                break
            write_landing(out, t, k, scale, hit.n, hit.x, not hit.leaves)
            if hit.n_off == np.inf:
                break
            n, x, u = hit.n_off, hit.x_off, hit.u
            write_lift_off(out, t, k, scale, n, x, speed(fixed, x, u))
