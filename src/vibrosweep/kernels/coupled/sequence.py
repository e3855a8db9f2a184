"""Order of the landings on a base of finite mass, which are found in the order of time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, Integers, jit, part
from vibrosweep.kernels.bases import Instant
from vibrosweep.kernels.coupled.state import NOW, System
from vibrosweep.kernels.listing import Listed, in_window, neighbours, nobody
from vibrosweep.kernels.sine import cos_turns, sin_turns

GAPS = 4096  # of the last period; with more they are left undetermined
INDICES = 256  # impact numbers remembered at first
MOST_INDICES = 2**22
# multiples of the forcing frequency at which the phases of the last landings are compared
HARMONICS = (1.0, 2.0, 3.0, 0.5, 1.0 / 3.0)


class Landings(NamedTuple):
    """Landings as far as they are remembered; not shared between threads."""

    # Whole periods and phase of the last landing of each particle; shape (2, particle)
    last: Floats
    # How long each stays on the base after it, at least the contact time; infinite while it rests
    stay: Floats
    # Number of that landing among all of the realization, 0 without any; shape (particle,)
    turn: Integers
    total: Integers  # landings of each particle since its launch
    # Last landing in the window of an impact number: whole periods, phase, and particle; shape
    # (3, place)
    numbered: Floats
    number: Integers  # the impact number that stands in each place, 0 for none
    gaps: Floats  # between neighbouring landings of different particles in the last period


class Order(NamedTuple):
    """Separations and order so far."""

    # gap, same: smallest separation of landings of different particles, and of those of the same
    # number
    gap: float
    same: float
    shared: int  # 1 where two particles were on the base at once in the window
    # who, number, seen: the last particle that landed, how many landings there were, and whether
    # the last one was in the window
    who: int
    number: int
    seen: bool
    changes: int  # landings in the window of a particle whose turn it was not
    gaps: int  # how many of `Landings.gaps` are in use


def landings(particles: int, indices: int = INDICES) -> Landings:
    """Allocate memory of landings, for so many impact numbers."""
    last, stay, numbered = np.zeros((2, particles)), np.zeros(particles), np.zeros((3, indices))
    turn, total = np.zeros(particles, np.int64), np.zeros(particles, np.int64)
    return Landings(last, stay, turn, total, numbered, np.zeros(indices, np.int64), np.zeros(GAPS))


@jit
def clear(memory: Landings) -> Order:
    """Forget all landings."""
    for j in range(memory.turn.size):
        memory.turn[j] = memory.total[j] = 0
    for place in range(memory.number.size):
        memory.number[place] = 0
    return Order(np.inf, np.inf, 0, -1, 0, False, 0, 0)


@jit
def _displaced(memory: Landings, mine: int) -> bool:
    """Return whether landing number `mine` displaces one that others are still compared with."""
    there = memory.number[mine % memory.number.size]
    if there in (0, mine):
        return False
    least = there
    for total in memory.total:
        least = min(least, total)
    return bool(least < there)  # of that particle the same number is still to come


@jit
def lacks_memory(memory: Landings, who: int, seen: bool) -> bool:
    """Return whether the next landing of particle `who` needs more memory.

    Results do not depend on the memory at first: it grows up to `MOST_INDICES`, beyond which the
    separation is undetermined.
    """
    return seen and memory.number.size < MOST_INDICES and _displaced(memory, memory.total[who] + 1)


@jit
def _numbered(memory: Landings, landing: Listed, mine: int, gap: float) -> float:
    """Compare landing number `mine` of a particle with the previous landing of that number.

    Returns the smallest separation so far; NaN, from then on, if a landing is no longer remembered.
    Independent particles are followed number by number (`vibrosweep.kernels.same_index`), which
    needs no memory of other numbers.  Coupled particles land in the order of time, so that a number
    is remembered until all particles have had it.
    """
    place, numbered = mine % memory.number.size, memory.numbered
    if memory.number[place] == mine:
        latest = Listed(numbered[0, place], numbered[1, place], 0.0, numbered[2, place])
        gap, _ = neighbours(latest, landing, gap, 0)
    elif _displaced(memory, mine):
        return np.nan
    numbered[0, place], numbered[1, place] = landing.whole, landing.phase
    numbered[2, place], memory.number[place] = landing.who, mine
    return gap


@jit
def _latest(memory: Landings, order: Order) -> Listed:
    """Return the last landing."""
    who = order.who
    if who < 0:
        return nobody()
    name = who if order.seen else -1 - who
    return Listed(memory.last[0, who], memory.last[1, who], memory.stay[who], float(name))


@jit
def _occupants(memory: Landings, begin: Instant) -> tuple[Listed, int]:
    """Return a particle that is on the base as the window begins, and whether there is another."""
    latest, shared = nobody(), 0
    for j in range(memory.turn.size):
        if memory.turn[j] > 0:
            landed = Listed(memory.last[0, j], memory.last[1, j], memory.stay[j], float(j))
            occupant = in_window(landed, begin)
            if occupant.whole < np.inf:
                _, shared = neighbours(latest, occupant, np.inf, shared)
                latest = occupant
    return latest, shared


@jit
def close(memory: Landings, order: Order, begin: Instant) -> Order:
    """Return the order at the end of the window, occupants of the base without landing included."""
    gap, same, shared, who, number, seen, changes, gaps = order
    if not seen:
        _, shared = _occupants(memory, begin)
    return Order(gap, same, shared, who, number, seen, changes, gaps)


@part
def note(memory: Landings, order: Order, landing: Listed, late: bool, begin: Instant) -> Order:
    """Note a landing, of which `late` says whether it is in the last period of the window."""
    seen = landing.who >= 0.0
    who = int(landing.who) if seen else -1 - int(landing.who)
    gap, gaps, shared, same = order.gap, order.gaps, order.shared, order.same
    mine = memory.turn[who]
    latest = _latest(memory, order)
    if late and order.who >= 0 and order.who != who:
        if gaps < GAPS:
            memory.gaps[gaps] = (landing.whole - latest.whole) + (landing.phase - latest.phase)
        gaps += 1
    if seen and not order.seen:
        latest, shared = _occupants(memory, begin)
    if seen:
        gap, shared = neighbours(latest, landing, gap, shared)
    earlier = 0  # particles whose turn was before
    if seen and mine > 0:
        for turn in memory.turn:
            earlier += 1 if 0 < turn < mine else 0
    memory.total[who] += 1
    if seen:
        same = _numbered(memory, landing, memory.total[who], same)
    memory.last[0, who], memory.last[1, who] = landing.whole, landing.phase
    memory.stay[who], memory.turn[who] = landing.stay, order.number + 1
    changes = order.changes + (1 if earlier > 0 else 0)
    return Order(gap, same, shared, who, order.number + 1, seen, changes, gaps)


@jit
def end_stay(state: System, memory: Landings, who: int, least: float) -> None:
    """Note that particle `who` leaves the base, now."""
    stayed = (state.now[NOW.N] - memory.last[0, who]) + (state.now[NOW.X] - memory.last[1, who])
    memory.stay[who] = max(stayed, least)


@part
def gap_median(memory: Landings, order: Order) -> tuple[float, float]:
    """Return the median of the gaps of the last period and the least; NaN if none, or too many."""
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
def order_of(memory: Landings, harmonic: float) -> float:
    """Return the mean of exp(2 pi i h t) over the last landings, as an absolute value.

    NaN where no particle has landed.
    """
    even, odd, count = 0.0, 0.0, 0
    for j in range(memory.turn.size):
        if memory.turn[j] > 0:
            turns = harmonic * memory.last[0, j]
            turns = (turns - np.rint(turns)) + harmonic * memory.last[1, j]
            turns -= np.rint(turns)
            even += cos_turns(turns)
            odd += sin_turns(turns)
            count += 1
    return np.sqrt(even * even + odd * odd) / count if count > 0 else np.nan
