"""Landings of one realization in the order of time: lists, neighbours, and whose turn it is."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels._jit import Floats, Integers, jit, part, wide_vectors
from vibrosweep.kernels.arithmetic import cos_turns, sin_turns
from vibrosweep.kernels.bases import Constants, Instant, constants, contact_time
from vibrosweep.kernels.impact import Batch, impact, launch, launch_speed
from vibrosweep.kernels.memory import LANES, STRIDE, aligned, unwritten
from vibrosweep.model.measures import UNDETERMINED

# --- Lists ----------------------------------------------------------------------------------------


FEW = 24  # a cell with more landings is sorted by itself
PERIODS_REMEMBERED = 64
NARROWEST = 2.0**-40  # gap, in periods; rounding could lose it over more than FARTHEST periods
FARTHEST = 2.0**10

Places = NDArray[np.int32]


class StateRows(NamedTuple):
    """First indices of the rows of a block of lanes: the state, then the landing in question."""

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
    """Return whether ordered landing q comes after another one, which has this name."""
    later = (listed[ORDERED + LIST.WHOLE, q] - n) + (listed[ORDERED + LIST.PHASE, q] - x)
    return bool(later > 0.0 or (later == 0.0 and listed[ORDERED + LIST.WHO, q] > name))


@part
def _sort(listed: Floats, start: int, stop: int, gap: int) -> None:
    """Put the ordered landings start ... stop - 1 exactly in the order of time.

    Simultaneous ones are ordered by their names.  The method is Shell's, with shrinking gaps; a
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

    Negative names, of landings outside the window, are ignored.  The landings are not sorted: time
    is divided into cells of four gaps, and a landing is compared with those in its own cell and in
    the nearer neighbouring cell; cells that are a multiple of the table's length apart share an
    entry.  Returns NaN if the gap is infinite or below `NARROWEST`, or if landings lie beyond
    `FARTHEST`.
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


# --- Neighbours -----------------------------------------------------------------------------------
# The closest pair of landings of different particles consists of neighbours: any landing between
# them would be closer to one of the two.  Similarly, a landing on an occupied base directly follows
# the landing of its occupant, or another landing during that stay.


class Window(NamedTuple):
    """The window in which landings count, or a part of it that gives the same results."""

    late: bool  # True if a particle is launched before it begins
    begin: Instant
    end: Instant


class Listed(NamedTuple):
    """A landing in a list."""

    # whole, phase: of the instant; an infinite count stands for no landing
    whole: float
    phase: float
    stay: float  # periods on the base, at least the contact time
    who: float  # particle, or `before_window` of one that landed before the window


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
def before_window(particle: float) -> float:
    """Return the number below 0 that a list has for a particle that lands before the window."""
    return -1.0 - particle


@jit
def particle_of(who: float) -> float:
    """Return the particle of a landing in a list, before the window or in it."""
    return who if who >= 0.0 else -1.0 - who


@jit
def nobody() -> Listed:
    """No landing."""
    return Listed(np.inf, 0.0, 0.0, 0.0)


@jit
def in_window(landing: Listed, begin: Instant) -> Listed:
    """Return a landing as it counts in a window: unchanged if it is inside.

    A particle that lands before the window and is still on the base when the window begins counts
    as an occupant, not as a landing.  It is listed with a negative name, one period before the
    beginning, where it separates no two landings, and with a stay that ends at its lift-off.  A
    particle that leaves before the window is dropped.
    """
    early = (begin.whole - landing.whole) + (begin.phase - landing.phase)
    if not early > 0.0:
        return landing
    if landing.stay < early:
        return nobody()
    return Listed(
        begin.whole - 1.0, begin.phase, (landing.stay - early) + 1.0, before_window(landing.who)
    )


@jit
def neighbours(latest: Listed, landing: Listed, gap: float, shared: int) -> tuple[float, int]:
    """Compare a landing with the one before it, in the order of time.

    Returns the smallest gap so far of landings of different particles in the window, and whether
    the base was shared.
    """
    who, other = latest.who, landing.who
    if latest.whole < np.inf and particle_of(other) != particle_of(who):
        apart = abs((landing.whole - latest.whole) + (landing.phase - latest.phase))
        if apart <= latest.stay:
            shared = 1
        if who >= 0 and other >= 0 and apart < gap:
            gap = apart
    return gap, shared


@jit
def start(work: Workspace, batch: Batch, i: int) -> Window:
    """Put all particles of realization i at their launch; return its window.

    Whole periods are counted from the end of the window.
    """
    problem, launches = batch.problem, batch.launches
    fixed = constants(batch.base, problem, i)
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
    """Find the next landing of each lane; take those up to the stop and leave the others be."""
    n_stop, x_stop = stop
    wide_vectors()
    shortest, origin = contact_time(fixed), fixed.source.end
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
        gap, shared = neighbours(latest, landing, gap, shared)
        latest = landing
    return latest, gap, shared


# --- Turns ----------------------------------------------------------------------------------------


GAPS = 4096  # of the last period; with more they are left undetermined
# multiples of the forcing frequency at which the phases of the last landings are compared
HARMONICS = (1.0, 2.0, 3.0, 0.5, 1.0 / 3.0)


class Turns(NamedTuple):
    """Particles in the order of their last landings; not shared between threads."""

    last: Floats  # whole periods and phase of the last landing of each; shape (2, particle)
    # The particle that landed next after each, and the one before it.  The place behind the last
    # particle closes the chain: it follows the latest landing and precedes the one longest ago.  A
    # particle that has not landed is its own neighbour.  Shape (particle + 1,)
    after: Integers
    before: Integers
    gaps: Floats  # between neighbouring landings of different particles in the last period


class Order(NamedTuple):
    """Order so far."""

    changes: int  # landings in the window of a particle whose turn it was not
    gaps: int  # how many of `Turns.gaps` are in use


class Orders(NamedTuple):
    """Order of realizations: arrays of shape (realization,) but for `phases`."""

    changes: Integers  # landings out of turn
    # gap_median, gap_least: of the gaps between neighbouring landings of different particles in the
    # last period
    gap_median: Floats
    gap_least: Floats
    phases: Floats  # order parameter of each of `HARMONICS`; shape (harmonic, realization)


def empty_turns(particles: int) -> Turns:
    """Allocate memory of turns."""
    after, before = (np.zeros(particles + 1, np.int64) for _ in range(2))
    return Turns(np.zeros((2, particles)), after, before, np.zeros(GAPS))


def empty_orders(realizations: int) -> Orders:
    """Allocate the order of a batch."""
    median, least = (unwritten(realizations) for _ in range(2))
    phases = unwritten((len(HARMONICS), realizations))
    return Orders(unwritten(realizations, np.int64), median, least, phases)


@jit
def no_order(memory: Turns) -> Order:
    """Forget all landings."""
    for j in range(memory.after.size):
        memory.after[j] = memory.before[j] = j
    return Order(0, 0)


@jit
def has_landed(memory: Turns, j: int) -> bool:
    """Return whether particle j has landed."""
    return bool(memory.after[j] != j)


@jit
def latest(memory: Turns) -> int:
    """Return the particle that landed last; the number of particles where none has."""
    return int(memory.before[memory.before.size - 1])


@part
def note_turn(memory: Turns, order: Order, landing: Listed, late: bool) -> Order:
    """Note a landing; `late` is whether it is in the last period of the window."""
    after, before, end = memory.after, memory.before, memory.after.size - 1
    seen, previous = landing.who >= 0.0, latest(memory)
    who = int(particle_of(landing.who))
    changes, gaps = order
    if late and previous not in (who, end):
        if gaps < GAPS:
            whole, phase = memory.last[0, previous], memory.last[1, previous]
            memory.gaps[gaps] = (landing.whole - whole) + (landing.phase - phase)
        gaps += 1
    if seen and has_landed(memory, who) and after[end] != who:
        changes += 1
    after[before[who]], before[after[who]] = after[who], before[who]
    previous = before[end]
    after[previous] = before[end] = who
    after[who], before[who] = end, previous
    memory.last[0, who], memory.last[1, who] = landing.whole, landing.phase
    return Order(changes, gaps)


@part
def write_order(out: Orders, i: int, memory: Turns, order: Order, known: bool) -> None:
    """Write the order of realization i; `known` is whether all landings up to the end are."""
    out.changes[i] = order.changes if known else UNDETERMINED
    median, least = _of_gaps(memory, order) if known else (np.nan, np.nan)
    out.gap_median[i], out.gap_least[i] = median, least
    for h in range(out.phases.shape[0]):
        out.phases[h, i] = _order_of(memory, HARMONICS[h]) if known else np.nan


@part
def _of_gaps(memory: Turns, order: Order) -> tuple[float, float]:
    """Return the median and the least of the gaps of the last period; NaN if none or too many."""
    gaps, count = memory.gaps, order.gaps
    if not 0 < count <= GAPS:
        return np.nan, np.nan
    step = count
    while step > 1:  # Shell's sort, with steps that shrink by Gonnet's factor
        step = max(1, int(step / 2.2))
        for k in range(step, count):
            gap, place = gaps[k], k
            while place >= step and gaps[place - step] > gap:
                gaps[place] = gaps[place - step]
                place -= step
            gaps[place] = gap
    return 0.5 * (gaps[(count - 1) // 2] + gaps[count // 2]), gaps[0]


@part
def _order_of(memory: Turns, harmonic: float) -> float:
    """Return the modulus of the mean of exp(2 pi i h t) over the last landings.

    NaN where no particle has landed.
    """
    even, odd, count = 0.0, 0.0, 0
    for j in range(memory.last.shape[1]):
        if has_landed(memory, j):
            turns = harmonic * memory.last[0, j]
            turns = (turns - np.rint(turns)) + harmonic * memory.last[1, j]
            turns -= np.rint(turns)
            even += cos_turns(turns)
            odd += sin_turns(turns)
            count += 1
    return np.sqrt(even * even + odd * odd) / count if count > 0 else np.nan
