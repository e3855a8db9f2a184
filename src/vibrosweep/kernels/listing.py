"""The landings of one realization, found block by block, and compared with their neighbours.

Of all pairs of different particles the closest is a neighbouring one: a landing in between would
be closer to one of the two.  And a landing on a base that is occupied follows directly on the
landing of its occupant, or on another that shares the base already.
"""

from __future__ import annotations

import numpy as np

from vibrosweep.kernels._jit import Floats, jit
from vibrosweep.kernels.impact import Scene, land, launch, lift_off, rebound
from vibrosweep.kernels.lanes import LANES
from vibrosweep.kernels.ordering import (
    DUE,
    LASTS,
    N_LAND,
    N_REST,
    ORDERED,
    PHASE,
    STAY,
    WHO,
    WHO_LANDS,
    WHOLE,
    X_LAND,
    N,
    U,
    Workspace,
    X,
)
from vibrosweep.scene import Dimensionless, Launches

__all__ = ["Instant", "Latest", "compare", "due_first", "next_landings", "start"]

Instant = tuple[float, float]  # whole periods and phase
Latest = tuple[float, float, float, float]  # whole periods, phase, stay, particle


@jit
def start(work: Workspace, problem: Dimensionless, launches: Launches, i: int) -> None:
    """Put all particles of realization i at their launch; counts are relative to the end."""
    for p in range(launches.whole.shape[1]):
        s, j = work.state[p // LANES], p % LANES
        n, x = launch(problem, launches, i, p)
        s[X + j] = x
        s[N + j] = n - problem.end_count[i]
        s[U + j] = problem.launch_flight[i]
        s[WHO + j] = p
    for block in range(work.lanes.size):
        work.lanes[block] = min(LANES, launches.whole.shape[1] - block * LANES)


@jit
def next_landings(
    s: Floats,
    lanes: int,
    fixed: Scene,
    n_stop: float,
    x_stop: float,
    reflect: int | None,
) -> None:
    """Find the next landing of each lane; take those up to the stop and leave the others be."""
    e, a, r, x_lift, wait, u_lift = fixed
    for j in range(lanes):
        x, passed = land(s[X + j], s[U + j])
        n = s[N + j] + passed
        due = n - n_stop <= x_stop - x
        w = rebound(x, s[U + j], e, a, reflect)
        n_off, x_off, u, leaves = lift_off(n, x, w, r, x_lift, wait, u_lift)
        rest = 0.0 if leaves else (n_off - n) + (x_off - x)
        s[X_LAND + j] = x
        s[N_LAND + j] = n
        s[STAY + j] = rest if rest > r else r
        s[N_REST + j] = np.inf if leaves else n_off
        s[DUE + j] = 1.0 if due else 0.0
        s[X + j] = x_off if due else s[X + j]
        s[N + j] = n_off if due else s[N + j]
        s[U + j] = u if due else s[U + j]


@jit
def due_first(s: Floats, lanes: int) -> int:
    """Move the lanes that were due to the front of their block; return how many there are."""
    front = 0
    for j in range(lanes):
        if s[DUE + j] != 0.0:
            if j > front:
                for row in (X, N, U, WHO):
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
        n_next, x_next = listed[ORDERED + WHOLE, i], listed[ORDERED + PHASE, i]
        other = listed[ORDERED + WHO_LANDS, i]
        if n < np.inf and (other if other >= 0 else -1 - other) != (who if who >= 0 else -1 - who):
            apart = abs((n_next - n) + (x_next - x))
            if apart <= stay:
                shared = 1
            if who >= 0 and other >= 0 and apart < gap:
                gap = apart
        n, x, stay, who = n_next, x_next, listed[ORDERED + LASTS, i], other
    return (n, x, stay, who), gap, shared
