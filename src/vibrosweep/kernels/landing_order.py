"""Order of the landings of independent particles, realization by realization."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels._jit import uncounted
from vibrosweep.kernels.bases import constants
from vibrosweep.kernels.cycles import Cycles
from vibrosweep.kernels.impact import Batch
from vibrosweep.kernels.joint import affordable
from vibrosweep.kernels.listing import start
from vibrosweep.kernels.ordering import Workspace, workspace
from vibrosweep.kernels.sequence import Orders, Turns, empty_turns, no_order, write_order
from vibrosweep.kernels.slabs import order_all


class OrderWork(NamedTuple):
    """Memory of one caller of `find_order`."""

    lists: Workspace
    turns: Turns


def order_work(particles: int) -> OrderWork:
    """Memory for realizations of that many particles, independent of the length of the run."""
    return OrderWork(workspace(particles), empty_turns(particles))


@uncounted
def find_order(
    first: int,
    last: int,
    batch: Batch,
    complete: NDArray[np.bool_],
    budget: int,
    work: OrderWork,
    cycles: Cycles,
    out: Orders,
) -> None:
    """Find the order of realizations first ... last - 1; write only their slots.

    Arguments are those of `vibrosweep.kernels.separation.separate`.  All landings are followed,
    those of a cycle too, because changes of the order are counted; where a particle lands more than
    `budget` times, the order is unknown.
    """
    base, problem, launches = batch
    particles = launches.whole.shape[1]
    for i in range(first, last):
        order = no_order(work.turns)
        known = complete[i] and affordable(cycles, i * particles, particles, 0.0, budget)
        if known:
            window = start(work.lists, batch, i)
            order, known = order_all(constants(base, problem, i), window, work.lists, work.turns)
        write_order(out, i, work.turns, order, known)
