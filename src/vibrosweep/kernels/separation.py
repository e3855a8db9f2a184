"""Smallest separations between the landings of different particles of one realization."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels._jit import Flags, Floats, jit, kernel
from vibrosweep.kernels.bases import constants
from vibrosweep.kernels.cycles import Cycles
from vibrosweep.kernels.impact import Batch, Instant
from vibrosweep.kernels.joint import Joint, affordable, joint_cycle, no_joint
from vibrosweep.kernels.listing import start
from vibrosweep.kernels.ordering import Workspace
from vibrosweep.kernels.same_index import same_index
from vibrosweep.kernels.slabs import UNKNOWN, all_landings, earliest
from vibrosweep.kernels.unwritten import unwritten


class Separations(NamedTuple):
    """Separations of realizations, each array of shape (realization,)."""

    # gap, same: smallest separation over all landings, and over landings with equal impact numbers,
    # in forcing periods; NaN where there is no pair
    gap: Floats
    same: Floats
    # 1 where two particles were on the base at once, each stay counted as at least the contact
    # time; `UNKNOWN` where the realization was not measured
    shared: Flags


def empty_separations(realizations: int) -> Separations:
    """Allocate the separations of a batch."""
    return Separations(
        unwritten(realizations), unwritten(realizations), unwritten(realizations, np.int8)
    )


@jit
def write_separations(out: Separations, i: int, gap: float, same: float, shared: int) -> None:
    """Write the separations of realization i, which are infinite where there is no pair."""
    out.shared[i] = shared
    known = shared != UNKNOWN
    out.gap[i] = gap if known and gap < np.inf else np.nan
    out.same[i] = same if known and same < np.inf else np.nan


@jit
def _until(windowed: bool, begin: Instant, x_end: float, joint: Joint) -> tuple[Instant, Instant]:
    """Window of at most two joint cycles that contains every gap and stay of the full one."""
    n_begin, n_end = begin[0], 0.0
    known = joint.known
    if windowed:
        shift = np.floor((n_begin - known) / joint.periods) * joint.periods
        if shift > 0.0:
            n_begin, n_end = n_begin - shift, -shift
        known = max(known, n_begin)
    return (n_begin, begin[1]), (min(n_end, known + 2.0 * joint.periods + 2.0), x_end)


# whether it can be measured, the joint cycle, and begin and end of the part to simulate
Window = tuple[bool, Joint, Instant, Instant]


@jit
def _window(
    begin: Instant,
    x_end: float,
    first: int,
    budget: int,
    windowed: bool,
    cycles: Cycles,
    pace: Floats,
) -> Window:
    """Window of trajectories first, ... of a realization in which every gap and stay occurs."""
    joint, opening, end = no_joint(), begin, (0.0, x_end)
    if cycles.size == 0:
        return True, joint, opening, end
    joint = joint_cycle(cycles, first, pace)
    if joint.impacts > 0:
        opening, end = _until(windowed, begin, x_end, joint)
    return affordable(cycles, first, pace.size, end[0], budget), joint, opening, end


@kernel
def separate(
    span: tuple[int, int],
    batch: Batch,
    complete: NDArray[np.bool_],
    budget: int,
    windowed: bool,
    work: Workspace,
    cycles: Cycles,
    out: Separations,
) -> None:
    """Measure the separations of realizations span[0] ... span[1] - 1; write their slots alone.

    Unknown are those of realizations that are not `complete`, of which a trajectory ran out of its
    budget.  `budget` is the number of landings of a particle up
    to which others are, and `windowed` tells whether the window may begin after a launch.  `work`
    is not shared between threads.

    Cycles are those of `vibrosweep.kernels.cycles.empty_cycles`, of no length where unknown.  Where
    all particles of a realization have entered theirs, no more is followed than the joint cycle of
    all; the result is the same, bit for bit.
    """
    base, problem, launches = batch
    particles = launches.whole.shape[1]
    for i in range(span[0], span[1]):
        write_separations(out, i, np.nan, np.nan, UNKNOWN)
        if not complete[i]:
            continue
        begin = (problem.begin_count[i] - problem.end_count[i], problem.begin_phase[i])
        x_end = problem.end_phase[i]
        measurable, joint, opening, end = _window(
            begin, x_end, i * particles, budget, windowed, cycles, work.pace
        )
        if not measurable:
            continue
        fixed = constants(base, problem, i)
        start(work, batch, i)
        same, together = same_index(fixed, windowed, begin, x_end, work, joint)
        gap, shared = 0.0, 1
        if not together:
            start(work, batch, i)
            gap, shared = all_landings(fixed, windowed, opening, end, earliest(fixed, work), work)
        write_separations(out, i, gap, same, shared)
