"""Smallest separation between landings with equal impact numbers."""

from __future__ import annotations

import numpy as np

from vibrosweep.kernels._jit import Floats, jit
from vibrosweep.kernels.impact import Scene, land
from vibrosweep.kernels.joint import Joint
from vibrosweep.kernels.lanes import VECTOR
from vibrosweep.kernels.listing import Instant, compare, due_first, next_landings
from vibrosweep.kernels.ordering import (
    DUE,
    N_LAND,
    N_REST,
    PERIODS_REMEMBERED,
    WHO,
    X_LAND,
    Landings,
    N,
    Workspace,
    closest,
    put_in_order,
)

__all__ = ["same_index"]


@jit
def _append_all(
    s: Floats, lanes: int, window: int | None, begin: Instant, work: Workspace, k: int
) -> tuple[int, int]:
    """Append the landings that were due; return the length of the list and how many were early.

    A landing before the window gets a negative name.
    """
    found = work.found
    n_begin, x_begin = begin
    early = 0
    for j in range(lanes):
        found.whole[k], found.phase[k], found.stay[k] = s[N_LAND + j], s[X_LAND + j], 0.0
        who = int(s[WHO + j])
        if window is not None:
            before = (n_begin - s[N_LAND + j]) + (x_begin - s[X_LAND + j]) > 0.0
            early += 1 if before and s[DUE + j] != 0.0 else 0
            who = -1 - who if before else who
        found.who[k] = who
        k += int(s[DUE + j])
    return k, early


@jit
def _lift_off_together(s: Floats, lanes: int, low: float, high: float, rests: Floats) -> bool:
    """Whether a lane that just rested lifts off in the same period as another one did.

    They are on one orbit from then on.  Only lift-offs after whole period `low` and up to `high`
    count: those that are followed by a landing inside the window.
    """
    together = False
    for j in range(lanes):
        n = s[N_REST + j]
        if n < np.inf and s[DUE + j] != 0.0:
            place = int(n) & (PERIODS_REMEMBERED - 1)
            together |= rests[place] == n and low < n <= high
            rests[place] = n
    return together


@jit
def _next_numbers(
    fixed: Scene,
    window: int | None,
    begin: Instant,
    x_end: float,
    reflect: int | None,
    work: Workspace,
    lift_offs: Instant,
) -> tuple[int, int, bool]:
    """List the next landing of every particle.

    Returns their number, how many are before the window, and whether two lift off together.
    """
    k, early, together = 0, 0, False
    for block in range(work.lanes.size):
        s, lanes = work.state[block], work.lanes[block]
        padded = (lanes + VECTOR - 1) // VECTOR * VECTOR
        next_landings(s, padded, fixed, 0.0, x_end, reflect)
        start = k
        k, outside = _append_all(s, lanes, window, begin, work, k)
        early += outside
        together |= _lift_off_together(s, lanes, lift_offs[0], lift_offs[1], work.rests)
        if k - start < lanes:  # the others have passed the end
            work.lanes[block] = due_first(s, lanes)
    return k, early, together


@jit
def _extent(found: Landings, k: int) -> tuple[float, float, float]:
    """The first of k landings, whole periods and phase, and the periods from it to the last."""
    n, x = found.whole[0], found.phase[0]
    low, high = 0.0, 0.0
    for q in range(k):
        after = (found.whole[q] - n) + (found.phase[q] - x)
        low, high = min(low, after), max(high, after)
    return n, x + low, high - low


@jit
def _drift_apart(ordered: Landings, k: int, joint: Joint) -> bool:
    """Whether, of k ordered landings of equal number, later ones are never of faster particles."""
    slowest = -np.inf
    for q in range(k):
        who = ordered.who[q]
        pace = joint.pace[who if who >= 0 else -1 - who]
        if pace < slowest:
            return False
        slowest = pace
    return True


@jit
def _pass_over(work: Workspace, k: int, begin: Instant, joint: Joint) -> None:
    """Pass over whole cycles of every particle, as long as none of them enters the window."""
    found = work.found
    times = np.inf
    for q in range(k):
        if found.who[q] < 0:
            before = (begin[0] - found.whole[q]) + (begin[1] - found.phase[q])
            cycle = joint.impacts * joint.pace[-1 - found.who[q]]
            times = min(times, np.floor(before / cycle) - 1.0)
    if times > 0.0:
        for block in range(work.lanes.size):
            s = work.state[block]
            for j in range(work.lanes[block]):
                s[N + j] += times * np.rint(joint.impacts * joint.pace[int(s[WHO + j])])


@jit
def _followed_by_landings(
    fixed: Scene, window: int | None, begin: Instant, x_end: float
) -> Instant:
    """Whole periods that bound the lift-offs from rest whose next landing is inside the window."""
    x, passed = land(fixed[3], fixed[5])
    low = -np.inf
    if window is not None:
        low = begin[0] + np.ceil(begin[1] - x) - passed - 1.0
    return low, np.floor(x_end - x) - passed


@jit
def same_index(
    fixed: Scene,
    window: int | None,
    begin: Instant,
    x_end: float,
    reflect: int | None,
    work: Workspace,
    joint: Joint,
) -> tuple[float, bool]:
    """Smallest gap between landings with equal impact numbers, and whether two particles are one.

    Once all particles are on their cycles the gaps of equally fast ones repeat after the joint
    cycle, and those of others grow as soon as the slower one is the later one.  When that has held
    for one joint cycle, nothing smaller can follow.
    """
    gap, together = np.inf, False
    number, repeated, early = 0, 0, 0
    lift_offs = _followed_by_landings(fixed, window, begin, x_end)
    work.rests[:] = np.inf
    n, x, span, moved = -np.inf, 0.0, 0.0, 0.0
    while gap > 0.0:
        before = early
        k, early, met = _next_numbers(fixed, window, begin, x_end, reflect, work, lift_offs)
        together |= met
        if k < 2:
            break
        number += 1
        drifting = joint.impacts > 0 and number > joint.age
        nearer = np.nan if drifting else closest(work, k, gap)
        if nearer <= gap:  # not NaN: no order is needed
            gap, n = nearer, -np.inf
            continue
        if n == -np.inf:
            n, x, span = _extent(work.found, k)
            moved = 0.0
        put_in_order(work, k, n, x + moved, span)
        ordered = work.ordered
        _, gap, _ = compare(ordered, k, (np.inf, 0.0, 0.0, 0), gap, 0)
        # the next ones are expected to move on as far as these did
        moved = (ordered.whole[0] - n) + (ordered.phase[0] - x)
        n, x = ordered.whole[0], ordered.phase[0]
        span = (ordered.whole[k - 1] - n) + (ordered.phase[k - 1] - x)
        if drifting:
            same = early == before and _drift_apart(ordered, k, joint)
            repeated = repeated + 1 if same else 0
            if repeated > joint.impacts:
                if early == 0:
                    break
                _pass_over(work, k, begin, joint)
                n, repeated = -np.inf, 0
    return gap, together or gap == 0.0
