"""Landings of independent particles, in slabs of time: smallest separation, and order.

The landings of a slab are listed and put in order by a bucket pass.  Differences are taken as
(difference of whole periods) + (difference of phases), and slabs end at dyadic phases, where the
comparison is exact: nothing is lost at late times.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, jit
from vibrosweep.kernels.bases import Constants, Instant, fly
from vibrosweep.kernels.impact import land
from vibrosweep.kernels.lanes import VECTOR
from vibrosweep.kernels.listing import (
    Listed,
    Window,
    append_due,
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
    ORDERED,
    STATE,
    Workspace,
    closest,
    put_in_order,
)
from vibrosweep.kernels.sequence import Order, Turns, no_order, note_turn

UNKNOWN = -1

# periods; when all particles rest for good, only the end is left to reach
LONGEST_SLAB = 2.0**50
ENOUGH = 128  # landings in a slab; more would delay the end once nothing smaller can be found
SHORTEST_SLAB = 2.0**-40


@jit
def _in_window(listed: Floats, first: int, k: int, begin: Instant) -> int:
    """List landings first ... k - 1 as they count in a window; return the length of the list."""
    kept = first
    for q in range(first, k):
        landing = in_window(listed_at(listed, 0, q), begin)
        listed[LIST.WHOLE, kept], listed[LIST.PHASE, kept] = landing.whole, landing.phase
        listed[LIST.STAY, kept], listed[LIST.WHO, kept] = landing.stay, landing.who
        kept += 1 if landing.whole < np.inf else 0
    return kept


@jit
def _collect(fixed: Constants, stop: Instant, window: Window, work: Workspace) -> int:
    """List all landings up to the stop; return their number, or -1 where the list is too short."""
    listed, k = work.listed, 0
    for block in range(work.lanes.size):
        s, lanes = work.state[block], work.lanes[block]
        while lanes > 0:
            if k + lanes >= listed.shape[1]:  # one place is for the last landing of the slab before
                return -1
            padded = (lanes + VECTOR - 1) // VECTOR * VECTOR
            next_landings(s, padded, fixed, stop)
            before = k
            k = append_due(s, lanes, listed, k)
            due = k - before
            if window.late:
                k = _in_window(listed, before, k, window.begin)
            if 2 * due < lanes or due == 0:
                lanes = due_first(s, lanes)
    return k


@jit
def _copy(source: Floats, target: Floats) -> None:
    for block in range(source.shape[0]):
        for q in range(OF_STATE):
            target[block, q] = source[block, q]


@jit
def _earliest(fixed: Constants, work: Workspace) -> float:
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
    """Append the last landing of the previous slab to the k of this one; return their number."""
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


class Slab(NamedTuple):
    """A slab of time."""

    # whole, phase: of the instant at which it begins, infinite periods after the end
    whole: float
    phase: float
    periods: float  # its length


@jit
def first_slab(fixed: Constants, window: Window, work: Workspace) -> Slab:
    """Slab to begin with: no landing in the window precedes it."""
    first = _earliest(fixed, work)
    return Slab(max(first, window.begin.whole) if window.late else first, -0.5, 1.0)


@jit
def fill(fixed: Constants, window: Window, work: Workspace, slab: Slab) -> tuple[int, Slab, Slab]:
    """List the landings of a slab, which is halved until they fit.

    Returns their number, -1 if they crowd beyond what slabs can resolve, the slab, and the next.
    """
    n_end, x_end = window.end
    while True:
        _copy(work.state, work.saved)
        n, x = slab.whole + np.floor(slab.phase + slab.periods + 0.5), slab.phase + slab.periods
        x -= np.floor(x + 0.5)
        at_end = not n - n_end <= x_end - x
        stop = window.end if at_end else Instant(n, x)
        k = _collect(fixed, stop, window, work)
        if k >= 0 or slab.periods <= SHORTEST_SLAB:
            break
        _copy(work.saved, work.state)
        slab = Slab(slab.whole, slab.phase, 0.5 * slab.periods)
    longer = 2.0 if k < ENOUGH and slab.periods < LONGEST_SLAB else 1.0
    return k, slab, Slab(np.inf if at_end else n, x, longer * slab.periods)


@jit
def all_landings(fixed: Constants, window: Window, work: Workspace) -> tuple[float, int]:
    """Smallest gap between any landings of different particles, and whether the base was shared.

    Returns (inf, UNKNOWN) where landings crowd beyond what slabs can resolve.
    """
    listed, cells = work.listed, work.cells
    n_end, x_end = window.end
    slab, latest = first_slab(fixed, window, work), nobody()
    gap, shared = np.inf, 0
    while slab.whole - n_end <= x_end - slab.phase and not (gap == 0.0 and shared == 1):
        k, slab, following = fill(fixed, window, work, slab)
        if k < 0:
            return np.inf, UNKNOWN
        nearer = np.nan
        if shared == 1:  # stays need the order, gaps do not
            nearer = closest(listed, cells, _with_latest(listed, k, latest), gap)
        if nearer <= gap:
            gap, latest = nearer, _last(listed, k, latest)
        else:
            put_in_order(listed, cells, k, slab.whole, slab.phase, slab.periods)
            latest, gap, shared = compare(listed, k, latest, gap, shared)
        slab = following
    return gap, shared


@jit
def order_all(
    fixed: Constants, window: Window, work: Workspace, memory: Turns
) -> tuple[Order, bool]:
    """Order of all landings, and whether it is known; not if they crowd beyond what slabs resolve.

    They are listed from the launch on, because turns begin there.
    """
    n_end, x_end = window.end
    every, order = Window(False, window.begin, window.end), no_order(memory)
    slab = first_slab(fixed, every, work)
    while slab.whole - n_end <= x_end - slab.phase:
        k, slab, following = fill(fixed, every, work, slab)
        if k < 0:
            return order, False
        put_in_order(work.listed, work.cells, k, slab.whole, slab.phase, slab.periods)
        for q in range(k):
            landing = listed_at(work.listed, ORDERED, q)
            seen = window.begin.whole - landing.whole <= landing.phase - window.begin.phase
            late = seen and (x_end - landing.phase) + (n_end - landing.whole) <= 1.0
            name = landing.who if seen else -1.0 - landing.who
            named = Listed(landing.whole, landing.phase, landing.stay, name)
            order = note_turn(memory, order, named, late)
        slab = following
    return order, True
