"""Landings of independent particles: smallest separations between different ones, and order."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels import bases, ordering
from vibrosweep.kernels._jit import Flags, Floats, Integers, jit, part, uncounted, wide_vectors
from vibrosweep.kernels.bases import Constants, Instant
from vibrosweep.kernels.cycles import Cycles, Joint, affordable, joint_cycle
from vibrosweep.kernels.impact import Batch, impact, land, launch, launch_speed
from vibrosweep.kernels.memory import LANES, STRIDE, VECTOR, aligned, empty
from vibrosweep.kernels.ordering import Listed, Order, Orders, Turns

# --- Lists of landings ----------------------------------------------------------------------------


FEW = 24  # a cell with more landings is sorted by itself
PERIODS_REMEMBERED = 64
NARROWEST = 2.0**-40  # gap, in periods; rounding could lose it over more than FARTHEST periods
FARTHEST = 2.0**10

Places = NDArray[np.int32]


class StateRows(NamedTuple):
    """First indices of the rows of a block of lanes: the state, then the next landing."""

    X: int  # after the last landing taken: phase, whole periods, speed, and which particle
    N: int
    U: int
    NUMBER: int  # of landings taken
    WHO: int
    X_LAND: int
    N_LAND: int
    STAY: int
    DUE: int
    N_REST: int  # whole periods of the lift-off from a rest, else infinite


STATE: Final = StateRows(*(row * STRIDE for row in range(len(StateRows._fields))))
OF_STATE: Final = STATE.WHO + STRIDE  # numbers of a block that are state
BLOCK: Final = len(STATE) * STRIDE


class ListRows(NamedTuple):
    """Rows of a list of landings; those in the order of time follow from row ORDERED on."""

    WHOLE: int = 0
    PHASE: int = 1
    STAY: int = 2  # periods on the base
    WHO: int = 3  # particle, or `before_window` of one that landed before the window


LIST: Final = ListRows()
ORDERED: Final = len(LIST)


class CellRows(NamedTuple):
    """Rows of the table of cells of time."""

    OF_LANDING: int = 0  # cell of each landing, or the next landing in its cell
    ENDS: int = 1  # end, or head, of each cell


CELL: Final = CellRows()


class Workspace(NamedTuple):
    """Memory of one caller of `separate`.

    Few arrays: numba counts references to each that a function takes, with atomic instructions.
    """

    state: Floats
    saved: Floats
    lanes: Integers
    listed: Floats
    cells: Places
    rests: Floats
    pace: Floats


def workspace(particles: int) -> Workspace:
    """Memory for realizations of that many particles, independent of the length of the run."""
    blocks = -(-particles // LANES)
    capacity = max(4096, 4 * particles)
    return Workspace(
        state=aligned(blocks * BLOCK).reshape(blocks, BLOCK),
        saved=np.zeros((blocks, BLOCK)),
        lanes=np.zeros(blocks, np.int64),
        listed=np.zeros((2 * ORDERED, capacity)),
        cells=np.zeros((len(CELL), capacity + 1), np.int32),
        rests=np.zeros(PERIODS_REMEMBERED),
        pace=np.zeros(particles),
    )


@jit
def _is_after(listed: Floats, q: int, n: float, x: float, name: float) -> bool:
    """Return whether ordered landing q comes after another one, of this particle."""
    later = (listed[ORDERED + LIST.WHOLE, q] - n) + (listed[ORDERED + LIST.PHASE, q] - x)
    return bool(later > 0.0 or (later == 0.0 and listed[ORDERED + LIST.WHO, q] > name))


@part
def _sort(listed: Floats, start: int, stop: int, gap: int) -> None:
    """Put the ordered landings start ... stop - 1 exactly in the order of time.

    Simultaneous ones are ordered by particle.  The method is Shell's, with shrinking gaps; a
    first gap of 1 makes it an insertion sort.
    """
    whole, phase = ORDERED + LIST.WHOLE, ORDERED + LIST.PHASE
    lasts, who = ORDERED + LIST.STAY, ORDERED + LIST.WHO
    while gap > 0:
        for q in range(start + gap, stop):
            n, x, name, place = listed[whole, q], listed[phase, q], listed[who, q], q
            if not _is_after(listed, q - gap, n, x, name):
                continue
            stay = listed[lasts, q]
            while place >= start + gap:
                before = place - gap
                if not _is_after(listed, before, n, x, name):
                    break
                for row in range(ORDERED, 2 * ORDERED):
                    listed[row, place] = listed[row, before]
                place = before
            listed[whole, place], listed[phase, place] = n, x
            listed[lasts, place], listed[who, place] = stay, name
        gap = 1 if gap == 2 else gap * 5 // 11


@part
def put_in_order(listed: Floats, cells: Places, k: int, n: float, x: float, span: float) -> None:
    """Sort the k landings that were found by time.

    A counting sort puts them into k cells of time, which begin at (n, x) and cover `span` periods;
    landings outside are put into the first or the last cell.  Exact comparisons complete the order,
    so that only the speed depends on the cells.
    """
    scale = k / span if span > 1e-290 else 0.0
    last = k - 1.0
    for q in range(k):
        place = ((listed[LIST.WHOLE, q] - n) + (listed[LIST.PHASE, q] - x)) * scale
        place = place if place > 0.0 else 0.0
        cells[CELL.OF_LANDING, q] = np.int32(place if place < last else last)
    cells[CELL.ENDS, : k + 1] = 0
    for q in range(k):
        cells[CELL.ENDS, cells[CELL.OF_LANDING, q] + 1] += 1
    for c in range(k):
        cells[CELL.ENDS, c + 1] += cells[CELL.ENDS, c]
    for q in range(k):
        to = cells[CELL.ENDS, cells[CELL.OF_LANDING, q]]
        cells[CELL.ENDS, cells[CELL.OF_LANDING, q]] = to + 1
        for row in range(ORDERED):
            listed[ORDERED + row, to] = listed[row, q]
    start = 0
    for c in range(k):  # entry c is by now the end of cell c
        end = cells[CELL.ENDS, c]
        if end - start > FEW:
            _sort(listed, start, end, (end - start) // 2)
        start = end
    _sort(listed, 0, k, 1)


@part
def closest(listed: Floats, cells: Places, k: int, gap: float) -> float:
    """Smallest gap between k landings of different particles, where it is below `gap`; else `gap`.

    Landings before the window, whose particle is negative, are ignored.  The landings are not
    sorted: time is divided into cells of four gaps, and a landing is compared with those in its own
    cell and in the nearer neighbouring cell; cells that are a multiple of the table's length apart
    share an entry.  Returns NaN if the gap is infinite or below `NARROWEST`, or if landings lie
    beyond `FARTHEST`.
    """
    if not NARROWEST <= gap < np.inf:
        return np.nan
    entries = 64
    while entries < 8 * k and 2 * entries < cells.shape[1]:
        entries *= 2
    cells[CELL.ENDS, :entries] = -1
    n, x, scale = listed[LIST.WHOLE, 0], listed[LIST.PHASE, 0], 0.5 / gap
    for q in range(k):
        who = listed[LIST.WHO, q]
        if who < 0.0:
            continue
        whole, phase = listed[LIST.WHOLE, q], listed[LIST.PHASE, q]
        after = (whole - n) + (phase - x)
        if abs(after) > FARTHEST:
            return np.nan
        half = int(np.floor(after * scale))
        cell = half >> 1
        for near in (cell, cell + 1 if half & 1 else cell - 1):
            other = cells[CELL.ENDS, near & (entries - 1)]
            while other >= 0:
                apart = abs(
                    (whole - listed[LIST.WHOLE, other]) + (phase - listed[LIST.PHASE, other])
                )
                gap = apart if who != listed[LIST.WHO, other] and apart < gap else gap
                other = cells[CELL.OF_LANDING, other]
        cells[CELL.OF_LANDING, q] = cells[CELL.ENDS, cell & (entries - 1)]
        cells[CELL.ENDS, cell & (entries - 1)] = np.int32(q)
    return gap


class Window(NamedTuple):
    """The window in which landings count, or a part of it that gives the same results."""

    late: bool  # True if a particle is launched before it begins
    begin: Instant
    end: Instant


@jit
def listed_at(listed: Floats, first: int, q: int) -> Listed:
    """Landing q of a list whose rows begin with `first`: 0 as found, `ORDERED` in order."""
    return Listed(
        listed[first + LIST.WHOLE, q],
        listed[first + LIST.PHASE, q],
        listed[first + LIST.STAY, q],
        listed[first + LIST.WHO, q],
    )


@jit
def start(work: Workspace, batch: Batch, i: int) -> Window:
    """Put all particles of realization i at their launch; return its window.

    Whole periods are counted from the end of the window.
    """
    problem, launches = batch.problem, batch.launches
    fixed = bases.constants(batch.base, problem, i)
    begin = Instant(problem.begin_count[i] - problem.end_count[i], problem.begin_phase[i])
    late = False
    particles = launches.whole.shape[1]
    for p in range(particles):
        s, j = work.state[p // LANES], p % LANES
        n, x = launch(launches, i, p, problem.phase[i])
        s[STATE.X + j] = x
        s[STATE.N + j] = n - problem.end_count[i]
        s[STATE.U + j] = launch_speed(fixed, problem, i, x)
        s[STATE.NUMBER + j] = 0.0
        s[STATE.WHO + j] = p
        late |= (begin.whole - s[STATE.N + j]) + (begin.phase - x) > 0.0
    for block in range(work.lanes.size):
        work.lanes[block] = min(LANES, particles - block * LANES)
    return Window(late, begin, Instant(0.0, problem.end_phase[i]))


@part
def next_landings(s: Floats, lanes: int, fixed: Constants, stop: Instant) -> None:
    """Find the next landing of each lane; take those up to the stop, leave the others unchanged."""
    n_stop, x_stop = stop
    wide_vectors()
    shortest, origin = bases.contact_time(fixed), fixed.source.end
    for j in range(lanes):
        n, x, u = s[STATE.N + j], s[STATE.X + j], s[STATE.U + j]
        hit = impact(fixed, n, x, u, s[STATE.WHO + j], s[STATE.NUMBER + j], origin)
        due = hit.n - n_stop <= x_stop - hit.x
        rest = 0.0 if hit.leaves else (hit.n_off - hit.n) + (hit.x_off - hit.x)
        rest = np.inf if hit.n_off == np.inf else rest  # the phase of a rest for good is NaN
        s[STATE.X_LAND + j] = hit.x
        s[STATE.N_LAND + j] = hit.n
        s[STATE.STAY + j] = rest if rest > shortest else shortest
        s[STATE.N_REST + j] = np.inf if hit.leaves else hit.n_off
        s[STATE.DUE + j] = 1.0 if due else 0.0
        s[STATE.X + j] = hit.x_off if due else s[STATE.X + j]
        s[STATE.N + j] = hit.n_off if due else s[STATE.N + j]
        s[STATE.U + j] = hit.u if due else s[STATE.U + j]
        s[STATE.NUMBER + j] += 1.0 if due else 0.0


@part
def append_due(s: Floats, lanes: int, listed: Floats, k: int) -> int:
    """Append the landings that were due to a list of k; return its length."""
    for j in range(lanes):  # each lane is written, and overwritten unless it was due
        listed[LIST.WHOLE, k], listed[LIST.PHASE, k] = s[STATE.N_LAND + j], s[STATE.X_LAND + j]
        listed[LIST.STAY, k], listed[LIST.WHO, k] = s[STATE.STAY + j], s[STATE.WHO + j]
        k += int(s[STATE.DUE + j])
    return k


@part
def due_first(s: Floats, lanes: int) -> int:
    """Move the lanes that were due to the front of their block; return how many there are."""
    front = 0
    for j in range(lanes):
        if s[STATE.DUE + j] != 0.0:
            if j > front:
                for row in (STATE.X, STATE.N, STATE.U, STATE.NUMBER, STATE.WHO):
                    kept = s[row + front]
                    s[row + front] = s[row + j]
                    s[row + j] = kept
            front += 1
    return front


@part
def compare(
    listed: Floats, k: int, latest: Listed, gap: float, shared: int
) -> tuple[Listed, float, int]:
    """Compare k ordered landings with their neighbours; `latest` is the last one before them.

    Returns the new `latest`, the smallest gap and whether the base was shared.
    """
    for i in range(k):
        landing = listed_at(listed, ORDERED, i)
        gap, shared = ordering.neighbours(latest, landing, gap, shared)
        latest = landing
    return latest, gap, shared


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
        landing = ordering.in_window(listed_at(listed, 0, q), begin)
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
            flight, _ = bases.fly(fixed, s[STATE.X + j], s[STATE.U + j])
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
    slab, latest = first_slab(fixed, window, work), ordering.no_landing()
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
    every, order = Window(False, window.begin, window.end), ordering.no_order(memory)
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
            name = landing.who if seen else ordering.before_window(landing.who)
            named = Listed(landing.whole, landing.phase, landing.stay, name)
            order = ordering.note_turn(memory, order, named, late)
        slab = following
    return order, True


# --- Landings with equal impact numbers -----------------------------------------------------------


# Whole periods after which, and up to which, the landings after lift-offs are in the window
LiftOffs = tuple[float, float]


@jit
def _mark_early(listed: Floats, first: int, k: int, begin: Instant) -> int:
    """Mark the landings before the window by negative numbers; return how many there are."""
    early = 0
    for q in range(first, k):
        who = listed[LIST.WHO, q]
        before = (begin.whole - listed[LIST.WHOLE, q]) + (begin.phase - listed[LIST.PHASE, q]) > 0.0
        listed[LIST.WHO, q] = ordering.before_window(who) if before else who
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
            early += _mark_early(work.listed, before, k, window.begin)
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
        periods = pace[int(ordering.particle_of(listed[ORDERED + LIST.WHO, q]))]
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
            cycle = joint.impacts * work.pace[int(ordering.particle_of(who))]
            times = min(times, np.floor(before / cycle) - 1.0)
    if times > 0.0:
        for block in range(work.lanes.size):
            s = work.state[block]
            for j in range(work.lanes[block]):
                s[STATE.N + j] += times * np.rint(joint.impacts * work.pace[int(s[STATE.WHO + j])])


@jit
def _with_counted_landings(fixed: Constants, window: Window) -> LiftOffs:
    """Bounds of the lift-offs from rest whose next landing is inside the window.

    There are none where a rest may end at several phases of a period.
    """
    if not bases.lifts_alike(fixed.base):
        return np.inf, -np.inf
    x_lift, u_lift = bases.after_rest(fixed)
    flight, _ = bases.fly(fixed, x_lift, u_lift)
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
    counted = _with_counted_landings(fixed, window)
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
        _, gap, _ = compare(listed, k, ordering.no_landing(), gap, 0)
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
    If all particles of a realization have entered a cycle, only the joint cycle of all is
    simulated; the result is the same, bit for bit.
    """
    base, problem, launches = batch
    particles = launches.whole.shape[1]
    for i in range(first, last):
        write_separations(out, i, np.nan, np.nan, UNKNOWN)
        if not complete[i]:
            continue
        fixed, window = bases.constants(base, problem, i), start(work, batch, i)
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

    Arguments are those of `separate`; `work` holds turns and the lists.  All landings are
    simulated, those of a cycle too, because changes of the order are counted.  Where a particle
    lands more than `budget` times, the order is unknown.
    """
    base, problem, launches = batch
    particles, (lists, turns) = launches.whole.shape[1], work
    for i in range(first, last):
        order = ordering.no_order(turns)
        known = complete[i] and affordable(cycles, i * particles, particles, 0.0, budget)
        if known:
            window = start(lists, batch, i)
            order, known = order_all(bases.constants(base, problem, i), window, lists, turns)
        ordering.write_order(out, i, turns, order, known)
