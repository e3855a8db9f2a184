"""Smallest separation between any landings of different particles.

The landings are found in slabs of time and put in order by a bucket pass.  Differences are taken as
(difference of whole periods) + (difference of phases), and slabs end at dyadic phases, where the
comparison is exact: nothing is lost at late times.
"""

from __future__ import annotations

import numpy as np

from vibrosweep.kernels._jit import Floats, Integers, jit
from vibrosweep.kernels.bases import Constants, fly
from vibrosweep.kernels.impact import Instant, land
from vibrosweep.kernels.lanes import VECTOR
from vibrosweep.kernels.listing import (
    Listed,
    compare,
    due_first,
    in_window,
    listed_at,
    next_landings,
    nobody,
)
from vibrosweep.kernels.ordering import (
    LIST,
    OF_STATE,
    STATE,
    Workspace,
    closest,
    put_in_order,
)

UNKNOWN = -1

# periods; when all particles rest for good, only the end is left to reach
LONGEST_SLAB = 2.0**50
ENOUGH = 128  # landings in a slab; more would delay the end once nothing smaller can be found
SHORTEST_SLAB = 2.0**-40


@jit
def _append(
    s: Floats, lanes: int, windowed: bool, begin: Instant, listed: Floats, k: int
) -> tuple[int, int]:
    """Append the landings that were due to the list; return its length and how many were due."""
    start = k
    for j in range(lanes):  # each lane is written, and overwritten unless it was due
        listed[LIST.WHOLE, k], listed[LIST.PHASE, k] = s[STATE.N_LAND + j], s[STATE.X_LAND + j]
        listed[LIST.STAY, k], listed[LIST.WHO, k] = s[STATE.STAY + j], s[STATE.WHO + j]
        k += int(s[STATE.DUE + j])
    due = k - start
    if windowed:
        k = start
        for q in range(start, start + due):
            landing = in_window(listed_at(listed, 0, q), begin)
            listed[LIST.WHOLE, k], listed[LIST.PHASE, k] = landing.whole, landing.phase
            listed[LIST.STAY, k], listed[LIST.WHO, k] = landing.stay, landing.who
            k += 1 if landing.whole < np.inf else 0
    return k, due


@jit
def _collect(
    fixed: Constants,
    stop: Instant,
    windowed: bool,
    begin: Instant,
    state: Floats,
    lanes_of: Integers,
    listed: Floats,
) -> int:
    """List all landings up to the stop; return their number, or -1 where the list is too short."""
    k = 0
    for block in range(lanes_of.size):
        s, lanes = state[block], lanes_of[block]
        while lanes > 0:
            if k + lanes >= listed.shape[1]:  # one place is for the slab before
                return -1
            padded = (lanes + VECTOR - 1) // VECTOR * VECTOR
            next_landings(s, padded, fixed, stop)
            k, due = _append(s, lanes, windowed, begin, listed, k)
            if 2 * due < lanes or due == 0:
                lanes = due_first(s, lanes)
    return k


@jit
def _copy(source: Floats, target: Floats) -> None:
    for block in range(source.shape[0]):
        for q in range(OF_STATE):
            target[block, q] = source[block, q]


@jit
def earliest(fixed: Constants, work: Workspace) -> float:
    """Whole periods of the earliest first landing."""
    first = np.inf
    for block in range(work.lanes.size):
        s = work.state[block]
        for j in range(work.lanes[block]):
            flight, _ = fly(fixed, s[STATE.X + j], s[STATE.U + j])
            _, passed = land(s[STATE.X + j], flight)
            first = min(first, s[STATE.N + j] + passed)
    return first


@jit
def _with_latest(listed: Floats, k: int, latest: Listed) -> int:
    """List the last landing of the slab before behind the k of this one; return their number."""
    listed[LIST.WHOLE, k], listed[LIST.PHASE, k] = latest.whole, latest.phase
    listed[LIST.WHO, k] = latest.who
    return k + 1 if latest.whole < np.inf else k


@jit
def _last(listed: Floats, k: int, latest: Listed) -> Listed:
    """The last of k landings, which are in no order; `latest` where there is none."""
    for q in range(k):
        landing = listed_at(listed, 0, q)
        later = (landing.whole - latest.whole) + (landing.phase - latest.phase) > 0.0
        if later or latest.whole == np.inf:
            latest = landing
    return latest


@jit
def all_landings(
    fixed: Constants,
    windowed: bool,
    begin: Instant,
    end: Instant,
    n_first: float,
    work: Workspace,
) -> tuple[float, int]:
    """Smallest gap between any landings of different particles, and whether the base was shared.

    The first landing is in or after the whole period `n_first`.  Returns (inf, UNKNOWN) where
    landings crowd beyond what slabs can resolve.
    """
    state, listed, cells = work.state, work.listed, work.cells
    n_end, x_end = end
    n_stop, x_stop = n_first, -0.5
    if windowed and begin[0] > n_stop:
        n_stop = begin[0]
    slab = 1.0
    latest = nobody()
    gap, shared = np.inf, 0
    while n_stop - n_end <= x_end - x_stop and not (gap == 0.0 and shared == 1):
        _copy(state, work.saved)
        n_next, x_next = n_stop + np.floor(x_stop + slab + 0.5), x_stop + slab
        x_next -= np.floor(x_next + 0.5)
        at_end = not n_next - n_end <= x_end - x_next
        stop = end if at_end else (n_next, x_next)
        k = _collect(fixed, stop, windowed, begin, state, work.lanes, listed)
        if k < 0:
            if slab <= SHORTEST_SLAB:
                return np.inf, UNKNOWN
            _copy(work.saved, state)
            slab *= 0.5
            continue
        nearer = np.nan
        if shared == 1:  # stays need the order, gaps do not
            nearer = closest(listed, cells, _with_latest(listed, k, latest), gap)
        if nearer <= gap:
            gap, latest = nearer, _last(listed, k, latest)
        else:
            put_in_order(listed, cells, k, n_stop, x_stop, slab)
            latest, gap, shared = compare(listed, k, latest, gap, shared)
        if at_end:
            break
        n_stop, x_stop = n_next, x_next
        if k < ENOUGH and slab < LONGEST_SLAB:
            slab *= 2.0
    return gap, shared
