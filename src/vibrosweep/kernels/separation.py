"""Smallest separations between the landings of different particles of one realization.

The landings are found in slabs of time, put in order by a bucket pass and compared with their
neighbours only: of all pairs of different particles the closest is a neighbouring one (a landing
in between would be closer to one of the two), and a landing on a base that is occupied follows
directly on the landing of its occupant or on another that shares the base already.

Differences are taken as (difference of whole periods) + (difference of phases), and slabs end at
dyadic phases, where the comparison is exact: nothing is lost at late times.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels._jit import Flags, Floats, jit, kernel
from vibrosweep.kernels.impact import land, launch, lift_off, rebound
from vibrosweep.kernels.lanes import LANES, STRIDE, VECTOR
from vibrosweep.kernels.ordering import (
    DUE,
    N_LAND,
    STAY,
    WHO,
    X_LAND,
    N,
    U,
    Workspace,
    X,
    put_in_order,
    workspace,
)
from vibrosweep.scene import Dimensionless, Launches

__all__ = ["UNKNOWN", "Workspace", "separate", "workspace"]

UNKNOWN = -1

# periods; when all particles rest for good, only the end is left to reach
LONGEST_SLAB = 2.0**50
SHORTEST_SLAB = 2.0**-40


# restitution, kick, rest threshold, phase of lift-off, wait for ever or not, flight after a rest
Scene = tuple[float, float, float, float, float, float]
Instant = tuple[float, float]  # whole periods and phase
Latest = tuple[float, float, float, int]  # whole periods, phase, stay, particle


@jit
def _start(work: Workspace, problem: Dimensionless, launches: Launches, i: int) -> None:
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
def _next_landings(
    s: Floats,
    lanes: int,
    scene: Scene,
    n_stop: float,
    x_stop: float,
    reflect: int | None,
) -> None:
    """Find the next landing of each lane; take those up to the stop and leave the others be."""
    e, a, r, x_lift, wait, u_lift = scene
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
        s[DUE + j] = 1.0 if due else 0.0
        s[X + j] = x_off if due else s[X + j]
        s[N + j] = n_off if due else s[N + j]
        s[U + j] = u if due else s[U + j]


@jit
def _due_first(s: Floats, lanes: int) -> int:
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
def _append(
    s: Floats, lanes: int, window: int | None, begin: Instant, work: Workspace, k: int
) -> tuple[int, int]:
    """Append the landings that were due to the list; return its length and how many were due.

    A particle that lands before the window and is still on the base when the window begins is
    listed one period before the beginning, where it stands between no two landings, with a stay
    that ends when its own does and a negative name: no landing, but an occupant.
    """
    n_begin, x_begin = begin
    start, due = k, 0
    for j in range(lanes):  # each lane is written, and overwritten unless it was due
        work.whole[k] = s[N_LAND + j]
        work.phase[k] = s[X_LAND + j]
        work.stay[k] = s[STAY + j]
        work.who[k] = int(s[WHO + j])
        k += int(s[DUE + j])
    due = k - start
    if window is not None:
        k = start
        for q in range(start, start + due):
            n, x, stay, who = work.whole[q], work.phase[q], work.stay[q], work.who[q]
            early = (n_begin - n) + (x_begin - x)
            if early > 0.0:
                if stay < early:
                    continue
                n, x, stay, who = n_begin - 1.0, x_begin, (stay - early) + 1.0, -1 - who
            work.whole[k], work.phase[k], work.stay[k], work.who[k] = n, x, stay, who
            k += 1
    return k, due


@jit
def _collect(
    scene: Scene,
    stop: Instant,
    window: int | None,
    begin: Instant,
    reflect: int | None,
    work: Workspace,
) -> int:
    """List all landings up to the stop; return their number, or -1 where the list is too short."""
    n_stop, x_stop = stop
    k = 0
    for block in range(work.lanes.size):
        s, lanes = work.state[block], work.lanes[block]
        while lanes > 0:
            if k + lanes > work.whole.size:
                return -1
            padded = (lanes + VECTOR - 1) // VECTOR * VECTOR
            _next_landings(s, padded, scene, n_stop, x_stop, reflect)
            k, due = _append(s, lanes, window, begin, work, k)
            if 2 * due < lanes or due == 0:
                lanes = _due_first(s, lanes)
    return k


@jit
def _compare(
    work: Workspace, k: int, latest: Latest, gap: float, shared: int
) -> tuple[Latest, float, int]:
    """Compare k ordered landings with their neighbours.

    `latest` is (count, phase, stay, name) of the last landing of the slab before; name UNKNOWN - N
    stands for none.  Returns the new `latest`, the smallest gap and whether the base was shared.
    """
    n, x, stay, who = latest
    for q in range(k):
        i = work.order[q]
        other = work.who[i]
        if n < np.inf and (other if other >= 0 else -1 - other) != (who if who >= 0 else -1 - who):
            apart = abs((work.whole[i] - n) + (work.phase[i] - x))
            if apart <= stay:
                shared = 1
            if who >= 0 and other >= 0 and apart < gap:
                gap = apart
        n, x, stay, who = work.whole[i], work.phase[i], work.stay[i], other
    return (n, x, stay, who), gap, shared


@jit
def _copy(source: Floats, target: Floats) -> None:
    for block in range(source.shape[0]):
        for q in range(WHO + STRIDE):  # what follows is no state
            target[block, q] = source[block, q]


@jit
def _earliest(work: Workspace) -> float:
    """Whole periods of the earliest first landing."""
    earliest = np.inf
    for block in range(work.lanes.size):
        s = work.state[block]
        for j in range(work.lanes[block]):
            _, passed = land(s[X + j], s[U + j])
            earliest = min(earliest, s[N + j] + passed)
    return earliest


@jit
def _all_landings(
    scene: Scene,
    window: int | None,
    begin: Instant,
    x_end: float,
    reflect: int | None,
    work: Workspace,
) -> tuple[float, int]:
    """Smallest gap between any landings of different particles, and whether the base was shared.

    Returns (inf, UNKNOWN) where landings crowd beyond what slabs can resolve.
    """
    n_stop, x_stop = _earliest(work), -0.5
    if window is not None and begin[0] > n_stop:
        n_stop = begin[0]
    slab = 1.0
    latest = (np.inf, 0.0, 0.0, 0)
    gap, shared = np.inf, 0
    while n_stop <= x_end - x_stop and not (gap == 0.0 and shared == 1):
        _copy(work.state, work.saved)
        n_next, x_next = n_stop + np.floor(x_stop + slab + 0.5), x_stop + slab
        x_next -= np.floor(x_next + 0.5)
        at_end = not n_next <= x_end - x_next
        stop = (0.0, x_end) if at_end else (n_next, x_next)
        k = _collect(scene, stop, window, begin, reflect, work)
        if k < 0:
            if slab <= SHORTEST_SLAB:
                return np.inf, UNKNOWN
            _copy(work.saved, work.state)
            slab *= 0.5
            continue
        put_in_order(work, k)
        latest, gap, shared = _compare(work, k, latest, gap, shared)
        if at_end:
            break
        n_stop, x_stop = n_next, x_next
        if 4 * k < work.whole.size and slab < LONGEST_SLAB:
            slab *= 2.0
    return gap, shared


@jit
def _same_index(
    scene: Scene,
    window: int | None,
    begin: Instant,
    x_end: float,
    reflect: int | None,
    work: Workspace,
    bound: float,
) -> float:
    """Smallest gap between landings with equal impact numbers; no smaller one than bound exists."""
    gap = np.inf
    active = 2
    while active > 1 and gap > bound:
        k, active = 0, 0
        for block in range(work.lanes.size):
            s, lanes = work.state[block], work.lanes[block]
            padded = (lanes + VECTOR - 1) // VECTOR * VECTOR
            _next_landings(s, padded, scene, 0.0, x_end, reflect)
            k, due = _append(s, lanes, window, begin, work, k)
            if due < lanes:  # the others have passed the end
                work.lanes[block] = _due_first(s, lanes)
            active += due
        put_in_order(work, k)
        _, gap, _ = _compare(work, k, (np.inf, 0.0, 0.0, 0), gap, 0)
    return gap


@kernel
def separate(
    first: int,
    last: int,
    problem: Dimensionless,
    launches: Launches,
    complete: NDArray[np.bool_],
    reflect: int | None,
    window: int | None,
    work: Workspace,
    gap: Floats,
    same: Floats,
    shared: Flags,
) -> None:
    """Measure the separations of realizations first ... last - 1.

    Parameters
    ----------
    first, last
        Range of realizations.
    problem : vibrosweep.scene.Dimensionless
    launches : vibrosweep.scene.Launches
    complete
        Shape (realization,): false where a trajectory ran out of its budget; such a realization
        is not measured.
    reflect, window
        None, or 1 for the `reflect` law and for a window that begins after the launch; chosen at
        compile time.
    work : Workspace
        Not shared between threads.
    gap, same
        Written: smallest separation over all landings, and over landings with equal impact
        numbers, in forcing periods; NaN where there is no pair.
    shared
        Written: 1 where two particles were on the base at once, each stay counted as at least the
        contact time; `UNKNOWN` where the realization was not measured.
    """
    for i in range(first, last):
        gap[i], same[i], shared[i] = np.nan, np.nan, UNKNOWN
        if not complete[i]:
            continue
        a, r = problem.kick[i], problem.rest_flight[i]
        wait, u_lift = (0.0, r) if a > r else (np.inf, 0.0)
        scene = (problem.restitution[i], a, r, problem.liftoff_phase[i], wait, u_lift)
        begin = (problem.begin_count[i] - problem.end_count[i], problem.begin_phase[i])
        x_end = problem.end_phase[i]
        _start(work, problem, launches, i)
        smallest, base = _all_landings(scene, window, begin, x_end, reflect, work)
        shared[i] = base
        if smallest == np.inf:
            continue
        gap[i] = smallest
        _start(work, problem, launches, i)
        smallest = _same_index(scene, window, begin, x_end, reflect, work, smallest)
        if smallest < np.inf:
            same[i] = smallest
