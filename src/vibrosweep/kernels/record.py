"""Every landing of a trajectory, in physical units."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from vibrosweep.kernels._jit import (
    Flags,
    Floats,
    Integers,
    implements,
    jit,
    uncounted,
    wide_vectors,
)
from vibrosweep.kernels.bases import Base, constants, later_lift_off, speed, take
from vibrosweep.kernels.memory import ROW, VECTOR, empty
from vibrosweep.kernels.statistics import KINDS, OF_LANDINGS, Kinds, observe
from vibrosweep.model.parameters import Dimensionless

__all__ = ["Record", "Scale", "empty_record", "no_landings", "write_landing", "write_lift_off"]


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
def scale_of(problem: Dimensionless, units: Units, i: int) -> Scale:
    """Units and origin of time of realization i."""
    return Scale(units.frequency[i], units.velocity[i], problem.end_count[i], problem.phase[i])


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
    """Write the instant of landing k of trajectory t; the record is truncated to its shape."""
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


# --- Records of independent particles -------------------------------------------------------------


KINDS_RECORDED: Final[Kinds] = KINDS[:2]  # landings and rests; a record takes no others


class Recorder(NamedTuple):
    """An observer that writes every landing of a batch."""

    record: Record  # arrays of shape (landing,), one trajectory after the other
    first: Integers  # where trajectories begin and the last one ends; longer ones are truncated
    units: Units
    problem: Dimensionless
    particles: int


@implements(observe, Recorder)
def write_landings(observer: Recorder, s: Floats, lanes: int, base: Base) -> None:
    wide_vectors()
    out, first, problem = observer.record, observer.first, observer.problem
    for j in range((lanes + VECTOR - 1) // VECTOR * VECTOR):
        s[ROW.LAST_LEFT + j] = speed(take(base, s, j), s[ROW.X + j], s[ROW.U + j])
    for j in range(lanes):
        if s[ROW.LAST_SEEN + j] == 0.0:
            continue
        t = int(s[ROW.LANE + j])
        k = first[t] + int(s[OF_LANDINGS + j]) - 1
        if not 0 <= k < first[t + 1]:
            continue
        i = t // observer.particles
        scale = scale_of(problem, observer.units, i)
        out.landing_time[k] = seconds(scale, s[ROW.LAST_N + j], s[ROW.LAST_X + j])
        out.rested[k] = 1 if s[ROW.LAST_RESTS + j] > 0.0 else 0
        n, x = s[ROW.N + j], s[ROW.X + j]
        # under noise of the drive, a resting particle is lifted later
        if base.noise is not None and s[ROW.LAST_RESTS + j] > 0.0 and n + x < np.inf:
            n, x = later_lift_off(constants(base, problem, i), n, x, problem.end_count[i])
        leaves = n + x < np.inf  # NaN after a rest for good
        out.liftoff_time[k] = seconds(scale, n, x) if leaves else np.nan
        out.rebound_velocity[k] = s[ROW.LAST_LEFT + j] * scale.velocity if leaves else np.nan


@uncounted
def mark_unused_places(out: Record, first: Integers, landings: Integers) -> None:
    """Mark the places past the last landing of each trajectory as unused."""
    for t in range(landings.size):
        for k in range(first[t] + landings[t], first[t + 1]):
            out.landing_time[k] = out.liftoff_time[k] = out.rebound_velocity[k] = np.nan
            out.rested[k] = 0
