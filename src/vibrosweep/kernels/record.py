"""Every landing of a trajectory, in physical units."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Flags, Floats, kernel
from vibrosweep.kernels.impact import impact, launch, scene
from vibrosweep.scene import Dimensionless, Launches

__all__ = ["Record", "empty_record", "record"]


class Record(NamedTuple):
    """Landings of trajectories: each array has shape (trajectory, impact).

    Attributes
    ----------
    landing_time, liftoff_time
        s; NaN past the last landing, and for the lift-off that never comes.
    rebound_velocity
        Speed at lift-off, m s-1; NaN where there is none.
    rested
        1 where the particle rested after the landing.
    """

    landing_time: Floats
    liftoff_time: Floats
    rebound_velocity: Floats
    rested: Flags


def empty_record(trajectories: int, impacts: int) -> Record:
    """Room for at most `impacts` landings of each trajectory."""
    shape = (trajectories, impacts)
    landing, liftoff, velocity = (np.full(shape, np.nan) for _ in range(3))
    return Record(landing, liftoff, velocity, np.zeros(shape, np.int8))


@kernel
def record(
    first: int,
    last: int,
    problem: Dimensionless,
    launches: Launches,
    frequency: Floats,
    velocity_unit: Floats,
    reflect: int | None,
    out: Record,
) -> None:
    """Write the landings of trajectories first ... last - 1 until the end of the window.

    Parameters
    ----------
    first, last
        Range of trajectories; trajectory t is particle t % N of realization t // N.
    problem : vibrosweep.scene.Dimensionless
    launches : vibrosweep.scene.Launches
    frequency
        Hz, shape (realization,).
    velocity_unit
        Speed whose flight lasts one forcing period, g / (2 f) in m s-1, shape (realization,).
    reflect
        None, or 1 for the `reflect` law; chosen at compile time.
    out : Record
        Its capacity ends a trajectory that is longer.
    """
    particles = launches.whole.shape[1]
    for t in range(first, last):
        i, p = t // particles, t % particles
        fixed = scene(problem, i)
        n, x = launch(problem, launches, i, p)
        u = problem.launch_flight[i]
        for k in range(out.rested.shape[1]):
            n_land, x_land, n, x, u, leaves = impact(fixed, n, x, u, reflect)
            if not n_land - problem.end_count[i] <= problem.end_phase[i] - x_land:
                break
            out.landing_time[t, k] = (n_land + (x_land - problem.phase[i])) / frequency[i]
            out.rested[t, k] = 0 if leaves else 1
            if n == np.inf:
                break
            out.liftoff_time[t, k] = (n + (x - problem.phase[i])) / frequency[i]
            out.rebound_velocity[t, k] = u * velocity_unit[i]
