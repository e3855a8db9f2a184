"""Every landing of a trajectory, in physical units."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Flags, Floats, kernel
from vibrosweep.kernels.bases import constants, speed
from vibrosweep.kernels.impact import Batch, impact, launch, launch_speed


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
    landing, liftoff, velocity = (np.full(shape, np.nan) for _ in range(3))
    return Record(landing, liftoff, velocity, np.zeros(shape, np.int8))


class Units(NamedTuple):
    """Physical units of a batch."""

    frequency: Floats  # Hz, shape (realization,)
    # Speed whose flight lasts one forcing period, g / (2 f) in m s-1, shape (realization,)
    velocity: Floats


@kernel
def record(first: int, last: int, batch: Batch, units: Units, out: Record) -> None:
    """Write the landings of trajectories first ... last - 1 until the end of the window.

    A trajectory with more landings than the capacity of the record is cut off.
    """
    base, problem, launches = batch
    particles = launches.whole.shape[1]
    for t in range(first, last):
        i, p = t // particles, t % particles
        fixed = constants(base, problem, i)
        n, x = launch(launches, i, p, problem.phase[i])
        u = launch_speed(fixed, problem, i, x)
        for k in range(out.rested.shape[1]):
            hit = impact(fixed, n, x, u)
            if not hit.n - problem.end_count[i] <= problem.end_phase[i] - hit.x:
                break
            out.landing_time[t, k] = (hit.n + (hit.x - problem.phase[i])) / units.frequency[i]
            out.rested[t, k] = 0 if hit.leaves else 1
            if hit.n_off == np.inf:
                break
            n, x, u = hit.n_off, hit.x_off, hit.u
            out.liftoff_time[t, k] = (n + (x - problem.phase[i])) / units.frequency[i]
            out.rebound_velocity[t, k] = speed(fixed, x, u) * units.velocity[i]
