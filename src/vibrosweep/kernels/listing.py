"""The landings of one realization, found block by block, and compared with their neighbours.

Of all pairs of different particles the closest is a neighbouring one: a landing in between would
be closer to one of the two.  And a landing on a base that is occupied follows directly on the
landing of its occupant, or on another that shares the base already.
"""

from __future__ import annotations

import numpy as np

from vibrosweep.kernels._jit import Floats, jit, wide_vectors
from vibrosweep.kernels.bases import Constants, constants, contact_time
from vibrosweep.kernels.impact import Batch, Instant, impact, launch, launch_speed
from vibrosweep.kernels.lanes import LANES
from vibrosweep.kernels.ordering import LIST, ORDERED, STATE, Workspace

Latest = tuple[float, float, float, float]  # whole periods, phase, stay, particle


@jit
def start(work: Workspace, batch: Batch, i: int) -> None:
    """Put all particles of realization i at their launch; counts are relative to the end."""
    problem, launches = batch.problem, batch.launches
    fixed = constants(batch.base, problem, i)
    particles = launches.whole.shape[1]
    for p in range(particles):
        s, j = work.state[p // LANES], p % LANES
        n, x = launch(launches, i, p, problem.phase[i])
        s[STATE.X + j] = x
        s[STATE.N + j] = n - problem.end_count[i]
        s[STATE.U + j] = launch_speed(fixed, problem, i, x)
        s[STATE.WHO + j] = p
    for block in range(work.lanes.size):
        work.lanes[block] = min(LANES, particles - block * LANES)


@jit
def next_landings(s: Floats, lanes: int, fixed: Constants, stop: Instant) -> None:
    """Find the next landing of each lane; take those up to the stop and leave the others be."""
    n_stop, x_stop = stop
    wide_vectors()
    shortest = contact_time(fixed)
    for j in range(lanes):
        hit = impact(fixed, s[STATE.N + j], s[STATE.X + j], s[STATE.U + j])
        due = hit.n - n_stop <= x_stop - hit.x
        rest = 0.0 if hit.leaves else (hit.n_off - hit.n) + (hit.x_off - hit.x)
        rest = np.inf if hit.n_off == np.inf else rest  # there is no phase to a rest for good
        s[STATE.X_LAND + j] = hit.x
        s[STATE.N_LAND + j] = hit.n
        s[STATE.STAY + j] = rest if rest > shortest else shortest
        s[STATE.N_REST + j] = np.inf if hit.leaves else hit.n_off
        s[STATE.DUE + j] = 1.0 if due else 0.0
        s[STATE.X + j] = hit.x_off if due else s[STATE.X + j]
        s[STATE.N + j] = hit.n_off if due else s[STATE.N + j]
        s[STATE.U + j] = hit.u if due else s[STATE.U + j]


@jit
def due_first(s: Floats, lanes: int) -> int:
    """Move the lanes that were due to the front of their block; return how many there are."""
    front = 0
    for j in range(lanes):
        if s[STATE.DUE + j] != 0.0:
            if j > front:
                for row in (STATE.X, STATE.N, STATE.U, STATE.WHO):
                    kept = s[row + front]
                    s[row + front] = s[row + j]
                    s[row + j] = kept
            front += 1
    return front


@jit
def compare(
    listed: Floats, k: int, latest: Latest, gap: float, shared: int
) -> tuple[Latest, float, int]:
    """Compare k ordered landings with their neighbours.

    `latest` is (count, phase, stay, name) of the last landing of the slab before; an infinite count
    stands for none.  The name of particle p is p, or -1 - p if it landed before the window.
    Returns the new `latest`, the smallest gap and whether the base was shared.
    """
    n, x, stay, who = latest
    for i in range(k):
        n_next, x_next = listed[ORDERED + LIST.WHOLE, i], listed[ORDERED + LIST.PHASE, i]
        other = listed[ORDERED + LIST.WHO, i]
        if n < np.inf and (other if other >= 0 else -1 - other) != (who if who >= 0 else -1 - who):
            apart = abs((n_next - n) + (x_next - x))
            if apart <= stay:
                shared = 1
            if who >= 0 and other >= 0 and apart < gap:
                gap = apart
        n, x, stay, who = n_next, x_next, listed[ORDERED + LIST.STAY, i], other
    return (n, x, stay, who), gap, shared
