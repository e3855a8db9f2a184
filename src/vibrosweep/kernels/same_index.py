"""Smallest separation between landings with equal impact numbers."""

from __future__ import annotations

import numpy as np

from vibrosweep.kernels._jit import Floats, Integers, jit
from vibrosweep.kernels.bases import Constants, after_rest, fly, lifts_alike
from vibrosweep.kernels.impact import Instant, land
from vibrosweep.kernels.joint import Joint
from vibrosweep.kernels.lanes import VECTOR
from vibrosweep.kernels.listing import compare, due_first, next_landings, nobody
from vibrosweep.kernels.ordering import (
    LIST,
    ORDERED,
    PERIODS_REMEMBERED,
    STATE,
    Workspace,
    closest,
    put_in_order,
)


@jit
def _append_all(
    s: Floats, lanes: int, windowed: bool, begin: Instant, listed: Floats, k: int
) -> tuple[int, int]:
    """Append the landings that were due; return the length of the list and how many were early.

    A landing before the window gets a negative name.
    """
    n_begin, x_begin = begin
    early = 0
    for j in range(lanes):
        listed[LIST.WHOLE, k], listed[LIST.PHASE, k] = s[STATE.N_LAND + j], s[STATE.X_LAND + j]
        listed[LIST.STAY, k] = 0.0
        who = s[STATE.WHO + j]
        if windowed:
            before = (n_begin - s[STATE.N_LAND + j]) + (x_begin - s[STATE.X_LAND + j]) > 0.0
            early += 1 if before and s[STATE.DUE + j] != 0.0 else 0
            who = -1.0 - who if before else who
        listed[LIST.WHO, k] = who
        k += int(s[STATE.DUE + j])
    return k, early


@jit
def _lift_off_together(s: Floats, lanes: int, low: float, high: float, rests: Floats) -> bool:
    """Return whether a lane that just rested lifts off in the same period as another one did.

    They are on one orbit from then on.  Only lift-offs after whole period `low` and up to `high`
    count: those that are followed by a landing inside the window.
    """
    together = False
    for j in range(lanes):
        n = s[STATE.N_REST + j]
        if n < np.inf and s[STATE.DUE + j] != 0.0:
            place = int(n) & (PERIODS_REMEMBERED - 1)
            together |= rests[place] == n and low < n <= high
            rests[place] = n
    return together


@jit
def _next_numbers(
    fixed: Constants,
    windowed: bool,
    begin: Instant,
    ends: tuple[float, float, float],
    state: Floats,
    lanes_of: Integers,
    listed: Floats,
    rests: Floats,
) -> tuple[int, int, bool]:
    """List the next landing of every particle.

    `ends` are the phase of the end and the bounds of lift-offs.  The arrays are those of a
    workspace, one by one: numba would count references to all that a named tuple holds.

    Returns their number, how many are before the window, and whether two lift off together.
    """
    x_end, low, high = ends
    k, early, together = 0, 0, False
    for block in range(lanes_of.size):
        s, lanes = state[block], lanes_of[block]
        padded = (lanes + VECTOR - 1) // VECTOR * VECTOR
        next_landings(s, padded, fixed, (0.0, x_end))
        start = k
        k, outside = _append_all(s, lanes, windowed, begin, listed, k)
        early += outside
        together |= _lift_off_together(s, lanes, low, high, rests)
        if k - start < lanes:  # the others have passed the end
            lanes_of[block] = due_first(s, lanes)
    return k, early, together


@jit
def _extent(listed: Floats, k: int) -> tuple[float, float, float]:
    """The first of k landings, whole periods and phase, and the periods from it to the last."""
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
    """Pass over whole cycles of every particle, as long as none of them enters the window."""
    listed = work.listed
    times = np.inf
    for q in range(k):
        who = int(listed[LIST.WHO, q])
        if who < 0:
            before = (begin[0] - listed[LIST.WHOLE, q]) + (begin[1] - listed[LIST.PHASE, q])
            cycle = joint.impacts * work.pace[-1 - who]
            times = min(times, np.floor(before / cycle) - 1.0)
    if times > 0.0:
        for block in range(work.lanes.size):
            s = work.state[block]
            for j in range(work.lanes[block]):
                s[STATE.N + j] += times * np.rint(joint.impacts * work.pace[int(s[STATE.WHO + j])])


@jit
def _followed_by_landings(
    fixed: Constants, windowed: bool, begin: Instant, x_end: float
) -> Instant:
    """Whole periods that bound the lift-offs from rest whose next landing is inside the window.

    None is where a rest may end at several phases of a period.
    """
    if not lifts_alike(fixed.base):
        return np.inf, -np.inf
    x_lift, u_lift = after_rest(fixed)
    flight, _ = fly(fixed, x_lift, u_lift)
    x, passed = land(x_lift, flight)
    low = -np.inf
    if windowed:
        low = begin[0] + np.ceil(begin[1] - x) - passed - 1.0
    return low, np.floor(x_end - x) - passed


@jit
def same_index(
    fixed: Constants,
    windowed: bool,
    begin: Instant,
    x_end: float,
    work: Workspace,
    joint: Joint,
) -> tuple[float, bool]:
    """Smallest gap between landings with equal impact numbers, and whether two particles are one.

    Once all particles are on
    their cycles the gaps of equally fast ones repeat after the joint cycle, and those of others
    grow as soon as the slower one is the later one.  When that has held for one joint cycle,
    nothing smaller can follow.
    """
    gap, together = np.inf, False
    number, repeated, early = 0, 0, 0
    lift_offs = _followed_by_landings(fixed, windowed, begin, x_end)
    state, listed, cells, rests = work.state, work.listed, work.cells, work.rests
    lanes_of, pace = work.lanes, work.pace
    rests[:] = np.inf
    n, x, span, moved = -np.inf, 0.0, 0.0, 0.0
    while gap > 0.0:
        before = early
        k, early, met = _next_numbers(
            fixed, windowed, begin, (x_end, *lift_offs), state, lanes_of, listed, rests
        )
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
            same = early == before and _drift_apart(listed, k, pace)
            repeated = repeated + 1 if same else 0
            if repeated > joint.impacts:
                if early == 0:
                    break
                _pass_over(work, k, begin, joint)
                n, repeated = -np.inf, 0
    together |= gap == 0.0
    return gap, together
