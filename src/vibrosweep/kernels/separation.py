"""Landings of independent particles: smallest separations between different ones, and order."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels._jit import Flags, Floats, jit, uncounted
from vibrosweep.kernels.bases import Constants, Instant, after_rest, constants, fly, lifts_alike
from vibrosweep.kernels.cycles import Cycles, Joint, affordable, joint_cycle
from vibrosweep.kernels.impact import Batch, land
from vibrosweep.kernels.memory import VECTOR, empty
from vibrosweep.kernels.ordering import (
    LIST,
    OF_STATE,
    ORDERED,
    PERIODS_REMEMBERED,
    STATE,
    Listed,
    Order,
    Orders,
    Turns,
    Window,
    Workspace,
    append_due,
    before_window,
    closest,
    compare,
    due_first,
    in_window,
    listed_at,
    next_landings,
    no_order,
    nobody,
    note_turn,
    particle_of,
    put_in_order,
    start,
    write_order,
)

# --- Slabs of time --------------------------------------------------------------------------------
# The landings of a slab are listed and put in order by a bucket pass.  Differences are taken as
# (difference of whole periods) + (difference of phases), and slabs end at dyadic phases, where the
# comparison is exact: nothing is lost at late times.


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
            name = landing.who if seen else before_window(landing.who)
            named = Listed(landing.whole, landing.phase, landing.stay, name)
            order = note_turn(memory, order, named, late)
        slab = following
    return order, True


# --- Landings with equal impact numbers -----------------------------------------------------------


# Whole periods after which, and up to which, lift-offs are followed by counted landings
LiftOffs = tuple[float, float]


@jit
def _name_early(listed: Floats, first: int, k: int, begin: Instant) -> int:
    """Give the landings before the window negative names; return how many there are."""
    early = 0
    for q in range(first, k):
        who = listed[LIST.WHO, q]
        before = (begin.whole - listed[LIST.WHOLE, q]) + (begin.phase - listed[LIST.PHASE, q]) > 0.0
        listed[LIST.WHO, q] = before_window(who) if before else who
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
        periods = pace[int(particle_of(listed[ORDERED + LIST.WHO, q]))]
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
            cycle = joint.impacts * work.pace[int(particle_of(who))]
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


class Separations(NamedTuple):
    """Separations of realizations, each array of shape (realization,)."""

    # gap, same: smallest separation over all landings, and over landings with equal impact numbers,
    # in forcing periods; NaN where there is no pair
    gap: Floats
    same: Floats
    # 1 where two particles were on the base at once, each stay counted as at least the contact
    # time; `UNKNOWN` where the realization was not measured
    shared: Flags


def empty_separations(realizations: int) -> Separations:
    """Allocate the separations of a batch."""
    return empty(Separations, realizations)


@jit
def write_separations(out: Separations, i: int, gap: float, same: float, shared: int) -> None:
    """Write the separations of realization i, which are infinite where there is no pair."""
    out.shared[i] = shared
    known = shared != UNKNOWN
    out.gap[i] = gap if known and gap < np.inf else np.nan
    out.same[i] = same if known and same < np.inf else np.nan


@jit
def _part(window: Window, joint: Joint) -> Window:
    """Return a part of the window, of at most two joint cycles, with all its gaps and stays."""
    if joint.impacts == 0:
        return window
    n_begin, n_end, known = window.begin.whole, 0.0, joint.known
    if window.late:
        shift = np.floor((n_begin - known) / joint.periods) * joint.periods
        if shift > 0.0:
            n_begin, n_end = n_begin - shift, -shift
        known = max(known, n_begin)
    n_end = min(n_end, known + 2.0 * joint.periods + 2.0)
    begin, end = Instant(n_begin, window.begin.phase), Instant(n_end, window.end.phase)
    return Window(window.late, begin, end)


@uncounted
def separate(
    first: int,
    last: int,
    batch: Batch,
    complete: NDArray[np.bool_],
    budget: int,
    work: Workspace,
    cycles: Cycles,
    out: Separations,
) -> None:
    """Measure the separations of realizations first ... last - 1 and write only their slots.

    Separations are unknown in realizations that are not `complete`, because a trajectory ran out of
    its budget, or in which a particle lands more than `budget` times.  `work` is not shared between
    threads.

    `cycles` is from `vibrosweep.kernels.cycles.empty_cycles`, or of size 0 if cycles are unknown.
    If all particles of a realization have entered a cycle, only the joint cycle of all is followed;
    the result is the same, bit for bit.
    """
    base, problem, launches = batch
    particles = launches.whole.shape[1]
    for i in range(first, last):
        write_separations(out, i, np.nan, np.nan, UNKNOWN)
        if not complete[i]:
            continue
        fixed, window = constants(base, problem, i), start(work, batch, i)
        joint = joint_cycle(cycles, i * particles, work.pace)
        part = _part(window, joint)
        if not affordable(cycles, i * particles, particles, part.end.whole, budget):
            continue
        same, together = same_index(fixed, window, work, joint)
        gap, shared = 0.0, 1
        if not together:
            start(work, batch, i)
            gap, shared = all_landings(fixed, part, work)
        write_separations(out, i, gap, same, shared)


@uncounted
def find_order(
    first: int,
    last: int,
    batch: Batch,
    complete: NDArray[np.bool_],
    budget: int,
    work: tuple[Workspace, Turns],
    cycles: Cycles,
    out: Orders,
) -> None:
    """Find the order of realizations first ... last - 1; write only their slots.

    Arguments are those of `separate`; `work` holds turns beside the lists.  All landings are
    followed, those of a cycle too, because changes of the order are counted.  Where a particle
    lands more than `budget` times, the order is unknown.
    """
    base, problem, launches = batch
    particles, (lists, turns) = launches.whole.shape[1], work
    for i in range(first, last):
        order = no_order(turns)
        known = complete[i] and affordable(cycles, i * particles, particles, 0.0, budget)
        if known:
            window = start(lists, batch, i)
            order, known = order_all(constants(base, problem, i), window, lists, turns)
        write_order(out, i, turns, order, known)
