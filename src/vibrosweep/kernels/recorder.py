"""An observer that writes every landing of a batch."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, Integers, implements, uncounted, wide_vectors
from vibrosweep.kernels.bases import Base, constants, speed, take, wake
from vibrosweep.kernels.lanes import ROW, ROWS, STRIDE, VECTOR
from vibrosweep.kernels.observer import note, observe
from vibrosweep.kernels.record import Record, Scale, Units, seconds
from vibrosweep.kernels.statistics import KINDS, Kinds
from vibrosweep.kernels.totals import OF_LANDINGS, scratch
from vibrosweep.model.observables import Landing
from vibrosweep.model.parameters import Dimensionless

KINDS_RECORDED: Final[Kinds] = KINDS[:2]  # landings and rests; a record takes no others


class Recorder(NamedTuple):
    """An observer of `vibrosweep.kernels.observer` that writes every landing of a batch."""

    record: Record  # arrays of shape (landing,), one trajectory after the other
    first: Integers  # where trajectories begin and the last one ends; what exceeds it is cut off
    units: Units
    problem: Dimensionless
    particles: int


class Noted(NamedTuple):
    """First indices of the rows of the last landing of each lane, behind `KINDS_RECORDED`."""

    SEEN: int
    RESTS: int
    PHASE: int
    PERIODS: int
    SPEED: int


BEHIND: Final = ROWS + 3 * len(KINDS_RECORDED) + 1
NOTED: Final = Noted(*((BEHIND + row) * STRIDE for row in range(len(Noted._fields))))


def recorder_scratch() -> Floats:
    """Scratch memory of `vibrosweep.kernels.totals.scratch`, with the rows of a landing."""
    return scratch(KINDS_RECORDED, len(Noted._fields))


@implements(note, Recorder)
def note_for_record(
    observer: Recorder, s: Floats, j: int, landing: Landing, n: float, seen: bool
) -> None:
    s[NOTED.SEEN + j] = 1.0 if seen else 0.0
    s[NOTED.RESTS + j] = 1.0 if landing.rests else 0.0
    s[NOTED.PHASE + j], s[NOTED.PERIODS + j] = landing.phase, n


@implements(observe, Recorder)
def write_landings(observer: Recorder, s: Floats, lanes: int, base: Base) -> None:
    wide_vectors()
    out, first, problem = observer.record, observer.first, observer.problem
    for j in range((lanes + VECTOR - 1) // VECTOR * VECTOR):
        s[NOTED.SPEED + j] = speed(take(base, s, j), s[ROW.X + j], s[ROW.U + j])
    for j in range(lanes):
        if s[NOTED.SEEN + j] == 0.0:
            continue
        t = int(s[ROW.LANE + j])
        k = first[t] + int(s[OF_LANDINGS + j]) - 1
        if not 0 <= k < first[t + 1]:
            continue
        i = t // observer.particles
        frequency, velocity = observer.units.frequency[i], observer.units.velocity[i]
        scale = Scale(frequency, velocity, problem.end_count[i], problem.phase[i])
        out.landing_time[k] = seconds(scale, s[NOTED.PERIODS + j], s[NOTED.PHASE + j])
        out.rested[k] = 1 if s[NOTED.RESTS + j] > 0.0 else 0
        n, x = s[ROW.N + j], s[ROW.X + j]
        # under noise of the drive, a resting particle is lifted later
        if base.noise is not None and s[NOTED.RESTS + j] > 0.0 and n + x < np.inf:
            n, x = wake(constants(base, problem, i), n, x, problem.end_count[i])
        leaves = n + x < np.inf  # NaN after a rest for good
        out.liftoff_time[k] = seconds(scale, n, x) if leaves else np.nan
        out.rebound_velocity[k] = s[NOTED.SPEED + j] * velocity if leaves else np.nan


@uncounted
def mark_unused_places(out: Record, first: Integers, landings: Integers) -> None:
    """Mark the places past the last landing of each trajectory as unused."""
    for t in range(landings.size):
        for k in range(first[t] + landings[t], first[t + 1]):
            out.landing_time[k] = out.liftoff_time[k] = out.rebound_velocity[k] = np.nan
            out.rested[k] = 0
