"""Landings of independent particles: smallest separations between different ones, and order."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels._jit import Flags, Floats, jit, uncounted
from vibrosweep.kernels.bases import Instant, constants
from vibrosweep.kernels.cycles import Cycles, Joint, affordable, joint_cycle
from vibrosweep.kernels.impact import Batch
from vibrosweep.kernels.listing import Window, start
from vibrosweep.kernels.ordering import Workspace
from vibrosweep.kernels.same_index import same_index
from vibrosweep.kernels.sequence import Orders, Turns, no_order, write_order
from vibrosweep.kernels.slabs import UNKNOWN, all_landings, order_all
from vibrosweep.kernels.unwritten import empty


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
    return empty(Separations, realizations)


@jit
def write_separations(out: Separations, i: int, gap: float, same: float, shared: int) -> None:
    """Write the separations of realization i, which are infinite where there is no pair."""
    out.shared[i] = shared
    known = shared != UNKNOWN
    out.gap[i] = gap if known and gap < np.inf else np.nan
    out.same[i] = same if known and same < np.inf else np.nan


@jit
def _part(window: Window, joint: Joint) -> Window:
    """Return a part of the window, of at most two joint cycles, with all its gaps and stays."""
    if joint.impacts == 0:
        return window
    n_begin, n_end, known = window.begin.whole, 0.0, joint.known
    if window.late:
        shift = np.floor((n_begin - known) / joint.periods) * joint.periods
        if shift > 0.0:
            n_begin, n_end = n_begin - shift, -shift
        known = max(known, n_begin)
    n_end = min(n_end, known + 2.0 * joint.periods + 2.0)
    begin, end = Instant(n_begin, window.begin.phase), Instant(n_end, window.end.phase)
    return Window(window.late, begin, end)


@uncounted
def separate(
    first: int,
    last: int,
    batch: Batch,
    complete: NDArray[np.bool_],
    budget: int,
    work: Workspace,
    cycles: Cycles,
    out: Separations,
) -> None:
    """Measure the separations of realizations first ... last - 1 and write only their slots.

    Separations are unknown in realizations that are not `complete`, because a trajectory ran out of
    its budget, or in which a particle lands more than `budget` times.  `work` is not shared between
    threads.

    `cycles` is from `vibrosweep.kernels.cycles.empty_cycles`, or of size 0 if cycles are unknown.
    If all particles of a realization have entered a cycle, only the joint cycle of all is followed;
    the result is the same, bit for bit.
    """
    base, problem, launches = batch
    particles = launches.whole.shape[1]
    for i in range(first, last):
        write_separations(out, i, np.nan, np.nan, UNKNOWN)
        if not complete[i]:
            continue
        fixed, window = constants(base, problem, i), start(work, batch, i)
        joint = joint_cycle(cycles, i * particles, work.pace)
        part = _part(window, joint)
        if not affordable(cycles, i * particles, particles, part.end.whole, budget):
            continue
        same, together = same_index(fixed, window, work, joint)
        gap, shared = 0.0, 1
        if not together:
            start(work, batch, i)
            gap, shared = all_landings(fixed, part, work)
        write_separations(out, i, gap, same, shared)


@uncounted
def find_order(
    first: int,
    last: int,
    batch: Batch,
    complete: NDArray[np.bool_],
    budget: int,
    work: tuple[Workspace, Turns],
    cycles: Cycles,
    out: Orders,
) -> None:
    """Find the order of realizations first ... last - 1; write only their slots.

    Arguments are those of `separate`; `work` holds turns beside the lists.  All landings are
    followed, those of a cycle too, because changes of the order are counted.  Where a particle
    lands more than `budget` times, the order is unknown.
    """
    base, problem, launches = batch
    particles, (lists, turns) = launches.whole.shape[1], work
    for i in range(first, last):
        order = no_order(turns)
        known = complete[i] and affordable(cycles, i * particles, particles, 0.0, budget)
        if known:
            window = start(lists, batch, i)
            order, known = order_all(constants(base, problem, i), window, lists, turns)
        write_order(out, i, turns, order, known)
