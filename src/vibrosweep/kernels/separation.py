"""Smallest separations between the landings of different particles of one realization.

The landings are found in slabs of time, put in order by a bucket pass and compared with their
neighbours only: of all pairs of different particles the closest is a neighbouring one (a landing
in between would be closer to one of the two), and a landing on a base that is occupied follows
directly on the landing of its occupant or on another that shares the base already.

Differences are taken as (difference of whole periods) + (difference of phases), and slabs end at
dyadic phases, where the comparison is exact: nothing is lost at late times.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels._jit import Flags, Floats, jit, kernel
from vibrosweep.kernels.cycles import Cycles
from vibrosweep.kernels.impact import Scene, land, launch, lift_off, rebound, scene
from vibrosweep.kernels.joint import Joint, affordable, joint_cycle, no_joint
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

__all__ = [
    "UNKNOWN",
    "Separations",
    "Workspace",
    "empty_separations",
    "separate",
    "workspace",
]

UNKNOWN = -1

# periods; when all particles rest for good, only the end is left to reach
LONGEST_SLAB = 2.0**50
SHORTEST_SLAB = 2.0**-40


class Separations(NamedTuple):
    """Separations of realizations, each array of shape (realization,).

    Attributes
    ----------
    gap, same
        Smallest separation over all landings, and over landings with equal impact numbers, in
        forcing periods; NaN where there is no pair.
    shared
        1 where two particles were on the base at once, each stay counted as at least the contact
        time; `UNKNOWN` where the realization was not measured.
    """

    gap: Floats
    same: Floats
    shared: Flags


def empty_separations(realizations: int) -> Separations:
    """Room for the separations of a batch of which nothing is known."""
    gap, same = (np.full(realizations, np.nan) for _ in range(2))
    return Separations(gap, same, np.full(realizations, UNKNOWN, np.int8))


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
    fixed: Scene,
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
            _next_landings(s, padded, fixed, n_stop, x_stop, reflect)
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
    fixed: Scene,
    window: int | None,
    begin: Instant,
    end: Instant,
    reflect: int | None,
    work: Workspace,
) -> tuple[float, int]:
    """Smallest gap between any landings of different particles, and whether the base was shared.

    Returns (inf, UNKNOWN) where landings crowd beyond what slabs can resolve.
    """
    n_end, x_end = end
    n_stop, x_stop = _earliest(work), -0.5
    if window is not None and begin[0] > n_stop:
        n_stop = begin[0]
    slab = 1.0
    latest = (np.inf, 0.0, 0.0, 0)
    gap, shared = np.inf, 0
    while n_stop - n_end <= x_end - x_stop and not (gap == 0.0 and shared == 1):
        _copy(work.state, work.saved)
        n_next, x_next = n_stop + np.floor(x_stop + slab + 0.5), x_stop + slab
        x_next -= np.floor(x_next + 0.5)
        at_end = not n_next - n_end <= x_end - x_next
        stop = end if at_end else (n_next, x_next)
        k = _collect(fixed, stop, window, begin, reflect, work)
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
def _append_all(
    s: Floats, lanes: int, window: int | None, begin: Instant, work: Workspace, k: int
) -> tuple[int, int]:
    """Append the landings that were due; return the length of the list and how many were early.

    A landing before the window gets a negative name.
    """
    n_begin, x_begin = begin
    early = 0
    for j in range(lanes):
        work.whole[k], work.phase[k], work.stay[k] = s[N_LAND + j], s[X_LAND + j], 0.0
        who = int(s[WHO + j])
        if window is not None:
            before = (n_begin - s[N_LAND + j]) + (x_begin - s[X_LAND + j]) > 0.0
            early += 1 if before and s[DUE + j] != 0.0 else 0
            who = -1 - who if before else who
        work.who[k] = who
        k += int(s[DUE + j])
    return k, early


@jit
def _drift_apart(work: Workspace, k: int, joint: Joint) -> bool:
    """Whether, of k ordered landings of equal number, later ones are never of faster particles."""
    slowest = -np.inf
    for q in range(k):
        who = work.who[work.order[q]]
        pace = joint.pace[who if who >= 0 else -1 - who]
        if pace < slowest:
            return False
        slowest = pace
    return True


@jit
def _pass_over(work: Workspace, k: int, begin: Instant, joint: Joint, impacts: int) -> None:
    """Pass over whole cycles of every particle, as long as none of them enters the window."""
    times = np.inf
    for q in range(k):
        if work.who[q] < 0:
            before = (begin[0] - work.whole[q]) + (begin[1] - work.phase[q])
            times = min(times, np.floor(before / (impacts * joint.pace[-1 - work.who[q]])) - 1.0)
    if times > 0.0:
        for block in range(work.lanes.size):
            s = work.state[block]
            for j in range(work.lanes[block]):
                s[N + j] += times * np.rint(impacts * joint.pace[int(s[WHO + j])])


@jit
def _same_index(
    fixed: Scene,
    window: int | None,
    begin: Instant,
    x_end: float,
    reflect: int | None,
    work: Workspace,
    bound: float,
    joint: Joint,
) -> float:
    """Smallest gap between landings with equal impact numbers; no smaller one than bound exists.

    Once all particles are on their cycles the gaps of equally fast ones repeat after the joint
    cycle, and those of others grow as soon as the slower one is the later one.  When that has held
    for one joint cycle, nothing smaller can follow.
    """
    gap = np.inf
    active, number, repeated, early = 2, 0, 0, 0
    while active > 1 and gap > bound:
        k, active, before = 0, 0, early
        early = 0
        for block in range(work.lanes.size):
            s, lanes = work.state[block], work.lanes[block]
            padded = (lanes + VECTOR - 1) // VECTOR * VECTOR
            _next_landings(s, padded, fixed, 0.0, x_end, reflect)
            start = k
            k, outside = _append_all(s, lanes, window, begin, work, k)
            early += outside
            if k - start < lanes:  # the others have passed the end
                work.lanes[block] = _due_first(s, lanes)
        active = k
        put_in_order(work, k)
        _, gap, _ = _compare(work, k, (np.inf, 0.0, 0.0, 0), gap, 0)
        number += 1
        if joint.impacts > 0 and number > joint.age:
            same = early == before and _drift_apart(work, k, joint)
            repeated = repeated + 1 if same else 0
            if repeated > joint.impacts:
                if early == 0:
                    break
                _pass_over(work, k, begin, joint, joint.impacts)
                repeated = 0
    return gap


@jit
def _until(
    window: int | None, begin: Instant, x_end: float, joint: Joint
) -> tuple[Instant, Instant]:
    """Window of two joint cycles, at most, in which every gap and stay of the true one occurs."""
    n_begin, n_end = begin[0], 0.0
    known = joint.known
    if window is not None:
        shift = np.floor((n_begin - known) / joint.periods) * joint.periods
        if shift > 0.0:
            n_begin, n_end = n_begin - shift, -shift
        known = max(known, n_begin)
    return (n_begin, begin[1]), (min(n_end, known + 2.0 * joint.periods + 2.0), x_end)


@kernel
def separate(
    first: int,
    last: int,
    problem: Dimensionless,
    launches: Launches,
    complete: NDArray[np.bool_],
    budget: int,
    reflect: int | None,
    window: int | None,
    work: Workspace,
    cycles: Cycles | None,
    out: Separations,
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
    budget
        Landings of a particle up to which a realization is measured.
    reflect, window
        None, or 1 for the `reflect` law and for a window that begins after the launch; chosen at
        compile time.
    work : Workspace
        Not shared between threads.
    cycles : vibrosweep.kernels.cycles.Cycles or None
        Where given, and all particles of a realization have entered theirs, no more is followed
        than the joint cycle of all; the result is the same, bit for bit.
    out : Separations
        Only the slots first ... last - 1 are written.
    """
    particles = launches.whole.shape[1]
    pace = np.empty(particles)
    for i in range(first, last):
        out.gap[i], out.same[i], out.shared[i] = np.nan, np.nan, UNKNOWN
        if not complete[i]:
            continue
        fixed = scene(problem, i)
        begin = (problem.begin_count[i] - problem.end_count[i], problem.begin_phase[i])
        x_end = problem.end_phase[i]
        joint, start, end = no_joint(pace), begin, (0.0, x_end)
        if cycles is not None:
            joint = joint_cycle(cycles, i * particles, pace)
            if joint.impacts > 0:
                start, end = _until(window, begin, x_end, joint)
            if not affordable(cycles, i * particles, particles, end[0], budget):
                continue
        _start(work, problem, launches, i)
        smallest, base = _all_landings(fixed, window, start, end, reflect, work)
        out.shared[i] = base
        if smallest == np.inf:
            continue
        out.gap[i] = smallest
        _start(work, problem, launches, i)
        smallest = _same_index(fixed, window, begin, x_end, reflect, work, smallest, joint)
        if smallest < np.inf:
            out.same[i] = smallest
