"""Smallest separation between landings with equal impact numbers."""

from __future__ import annotations

import numpy as np

from vibrosweep.kernels._jit import Floats, jit
from vibrosweep.kernels.bases import Constants, Instant, after_rest, fly, lifts_alike
from vibrosweep.kernels.cycles import Joint
from vibrosweep.kernels.impact import land
from vibrosweep.kernels.lanes import VECTOR
from vibrosweep.kernels.listing import Window, append_due, compare, due_first, next_landings, nobody
from vibrosweep.kernels.ordering import (
    LIST,
    ORDERED,
    PERIODS_REMEMBERED,
    STATE,
    Workspace,
    closest,
    put_in_order,
)

# Whole periods after which, and up to which, lift-offs are followed by counted landings
LiftOffs = tuple[float, float]


@jit
def _name_early(listed: Floats, first: int, k: int, begin: Instant) -> int:
    """Give the landings before the window negative names; return how many there are."""
    early = 0
    for q in range(first, k):
        who = listed[LIST.WHO, q]
        before = (begin.whole - listed[LIST.WHOLE, q]) + (begin.phase - listed[LIST.PHASE, q]) > 0.0
        listed[LIST.WHO, q] = -1.0 - who if before else who
        early += 1 if before else 0
    return early


@jit
def _lift_off_together(s: Floats, lanes: int, counted: LiftOffs, rests: Floats) -> bool:
    """Return whether a lane that just rested lifts off in the same period as an earlier one.

    The two particles then move as one.
    """
    together, (after, until) = False, counted
    for j in range(lanes):
        n = s[STATE.N_REST + j]
        if n < np.inf and s[STATE.DUE + j] != 0.0:
            place = int(n) & (PERIODS_REMEMBERED - 1)
            together |= rests[place] == n and after < n <= until
            rests[place] = n
    return together


@jit
def _next_numbers(
    fixed: Constants, window: Window, counted: LiftOffs, work: Workspace
) -> tuple[int, int, bool]:
    """List the next landing of every particle.

    Returns their number, how many are before the window, and whether two lift off together.
    """
    k, early, together = 0, 0, False
    for block in range(work.lanes.size):
        s, lanes = work.state[block], work.lanes[block]
        padded = (lanes + VECTOR - 1) // VECTOR * VECTOR
        next_landings(s, padded, fixed, window.end)
        before = k
        k = append_due(s, lanes, work.listed, k)
        if window.late:
            early += _name_early(work.listed, before, k, window.begin)
        together |= _lift_off_together(s, lanes, counted, work.rests)
        if k - before < lanes:  # the others have passed the end
            work.lanes[block] = due_first(s, lanes)
    return k, early, together


@jit
def _extent(listed: Floats, k: int) -> tuple[float, float, float]:
    """Whole periods and phase of the earliest of k landings, and the periods to the latest."""
    n, x = listed[LIST.WHOLE, 0], listed[LIST.PHASE, 0]
    low, high = 0.0, 0.0
    for q in range(k):
        after = (listed[LIST.WHOLE, q] - n) + (listed[LIST.PHASE, q] - x)
        low, high = min(low, after), max(high, after)
    return n, x + low, high - low


@jit
def _drift_apart(listed: Floats, k: int, pace: Floats) -> bool:
    """Return whether k ordered landings of equal number are ordered by pace, the fastest first."""
    slowest = -np.inf
    for q in range(k):
        who = int(listed[ORDERED + LIST.WHO, q])
        periods = pace[who if who >= 0 else -1 - who]
        if periods < slowest:
            return False
        slowest = periods
    return True


@jit
def _pass_over(work: Workspace, k: int, begin: Instant, joint: Joint) -> None:
    """Skip whole cycles of every particle, as long as none of them enters the window."""
    listed = work.listed
    times = np.inf
    for q in range(k):
        who = int(listed[LIST.WHO, q])
        if who < 0:
            before = (begin.whole - listed[LIST.WHOLE, q]) + (begin.phase - listed[LIST.PHASE, q])
            cycle = joint.impacts * work.pace[-1 - who]
            times = min(times, np.floor(before / cycle) - 1.0)
    if times > 0.0:
        for block in range(work.lanes.size):
            s = work.state[block]
            for j in range(work.lanes[block]):
                s[STATE.N + j] += times * np.rint(joint.impacts * work.pace[int(s[STATE.WHO + j])])


@jit
def _followed_by_landings(fixed: Constants, window: Window) -> LiftOffs:
    """Bounds of the lift-offs from rest whose next landing is inside the window.

    There are none where a rest may end at several phases of a period.
    """
    if not lifts_alike(fixed.base):
        return np.inf, -np.inf
    x_lift, u_lift = after_rest(fixed)
    flight, _ = fly(fixed, x_lift, u_lift)
    x, passed = land(x_lift, flight)
    low = -np.inf
    if window.late:
        low = window.begin.whole + np.ceil(window.begin.phase - x) - passed - 1.0
    return low, np.floor(window.end.phase - x) - passed


@jit
def same_index(
    fixed: Constants, window: Window, work: Workspace, joint: Joint
) -> tuple[float, bool]:
    """Smallest gap of landings with equal impact numbers, and whether two particles move as one.

    Once all particles are on their cycles, gaps between particles of equal pace repeat after the
    joint cycle, and gaps between others grow as soon as the slower particle is behind.  If this
    has held for one joint cycle, no smaller gap can follow.
    """
    gap, together = np.inf, False
    number, repeated, early = 0, 0, 0
    counted = _followed_by_landings(fixed, window)
    listed, cells = work.listed, work.cells
    for place in range(PERIODS_REMEMBERED):
        work.rests[place] = np.inf
    n, x, span, moved = -np.inf, 0.0, 0.0, 0.0
    while gap > 0.0:
        before = early
        k, early, met = _next_numbers(fixed, window, counted, work)
        together |= met
        if k < 2:
            break
        number += 1
        drifting = joint.impacts > 0 and number > joint.age
        nearer = np.nan if drifting else closest(listed, cells, k, gap)
        if nearer <= gap:  # not NaN: no order is needed
            gap, n = nearer, -np.inf
            continue
        if n == -np.inf:
            n, x, span = _extent(listed, k)
            moved = 0.0
        put_in_order(listed, cells, k, n, x + moved, span)
        _, gap, _ = compare(listed, k, nobody(), gap, 0)
        # the next ones are expected to move on as far as these did
        whole, phase = listed[ORDERED + LIST.WHOLE, 0], listed[ORDERED + LIST.PHASE, 0]
        moved = (whole - n) + (phase - x)
        n, x = whole, phase
        span = (listed[ORDERED + LIST.WHOLE, k - 1] - n) + (listed[ORDERED + LIST.PHASE, k - 1] - x)
        if drifting:
            same = early == before and _drift_apart(listed, k, work.pace)
            repeated = repeated + 1 if same else 0
            if repeated > joint.impacts:
                if early == 0:
                    break
                _pass_over(work, k, window.begin, joint)
                n, repeated = -np.inf, 0
    together |= gap == 0.0
    return gap, together
