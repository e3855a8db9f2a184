"""Landings on a base of finite mass, which are found in the order of time, one by one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, Integers, jit
from vibrosweep.kernels.bases import Instant
from vibrosweep.kernels.coupled.state import NOW, System
from vibrosweep.kernels.listing import Listed, in_window, neighbours, nobody
from vibrosweep.kernels.sequence import (
    Order,
    Turns,
    empty_turns,
    has_landed,
    latest,
    no_order,
    note_turn,
)

INDICES = 256  # impact numbers remembered at first
MOST_INDICES = 2**22


class Landings(NamedTuple):
    """The landings that are remembered; not shared between threads."""

    turns: Turns
    # How long each particle stays on the base after its last landing, at least the contact time;
    # infinite while it rests
    stay: Floats
    total: Integers  # landings of each particle since its launch
    # Last landing in the window with an impact number: whole periods, phase, and particle; shape
    # (3, place)
    numbered: Floats
    number: Integers  # the impact number that stands in each place, 0 for none


class Noted(NamedTuple):
    """Separations and order so far."""

    # gap, same: smallest separation of landings of different particles, and of those with the same
    # impact number
    gap: float
    same: float
    shared: int  # 1 where two particles were on the base at once in the window
    seen: bool  # True if the last landing was in the window
    order: Order


def landings(particles: int, indices: int = INDICES) -> Landings:
    """Allocate memory of landings, for `indices` impact numbers."""
    stay, numbered = np.zeros(particles), np.zeros((3, indices))
    total, number = np.zeros(particles, np.int64), np.zeros(indices, np.int64)
    return Landings(empty_turns(particles), stay, total, numbered, number)


@jit
def clear(memory: Landings) -> Noted:
    """Forget all landings."""
    for j in range(memory.total.size):
        memory.total[j] = 0
    for place in range(memory.number.size):
        memory.number[place] = 0
    return Noted(np.inf, np.inf, 0, False, no_order(memory.turns))


@jit
def _displaced(memory: Landings, mine: int) -> bool:
    """Return whether landing number `mine` displaces a number that a particle has yet to reach."""
    there = memory.number[mine % memory.number.size]
    if there in (0, mine):
        return False
    least = there
    for total in memory.total:
        least = min(least, total)
    return bool(least < there)


@jit
def lacks_memory(memory: Landings, who: int, seen: bool) -> bool:
    """Return whether the next landing of particle `who` needs more memory.

    Results do not depend on the initial memory, which grows up to `MOST_INDICES`; beyond that the
    separation is undetermined.
    """
    return seen and memory.number.size < MOST_INDICES and _displaced(memory, memory.total[who] + 1)


@jit
def _numbered(memory: Landings, landing: Listed, mine: int, gap: float) -> float:
    """Compare landing number `mine` of a particle with the previous landing of that number.

    Returns the smallest separation so far; NaN, from then on, if a landing is no longer remembered.
    Independent particles are followed number by number (`vibrosweep.kernels.same_index`), which
    needs no memory of other numbers.  Coupled particles land in the order of time, so that a number
    is remembered until all particles have reached it.
    """
    place, numbered = mine % memory.number.size, memory.numbered
    if memory.number[place] == mine:
        before = Listed(numbered[0, place], numbered[1, place], 0.0, numbered[2, place])
        gap, _ = neighbours(before, landing, gap, 0)
    elif _displaced(memory, mine):
        return np.nan
    numbered[0, place], numbered[1, place] = landing.whole, landing.phase
    numbered[2, place], memory.number[place] = landing.who, mine
    return gap


@jit
def _last_of(memory: Landings, j: int) -> Listed:
    """Return the last landing of particle j, in the window or before."""
    last = memory.turns.last
    return Listed(last[0, j], last[1, j], memory.stay[j], float(j))


@jit
def _occupants(memory: Landings, begin: Instant) -> tuple[Listed, int]:
    """Return a particle that is on the base as the window begins, and whether there is another."""
    before, shared = nobody(), 0
    for j in range(memory.total.size):
        if has_landed(memory.turns, j):
            occupant = in_window(_last_of(memory, j), begin)
            if occupant.whole < np.inf:
                _, shared = neighbours(before, occupant, np.inf, shared)
                before = occupant
    return before, shared


@jit
def close(memory: Landings, noted: Noted, begin: Instant) -> Noted:
    """Note the end of the window; if nobody has landed in it, the base may still be shared."""
    gap, same, shared, seen, order = noted
    if not seen:
        _, shared = _occupants(memory, begin)
    return Noted(gap, same, shared, seen, order)


@jit  # as a `part` it would make the loop that calls it a sixth slower
def note(memory: Landings, noted: Noted, landing: Listed, late: bool, begin: Instant) -> Noted:
    """Note a landing; `late` is True if it is in the last period of the window."""
    seen = landing.who >= 0.0
    who = int(landing.who) if seen else -1 - int(landing.who)
    gap, shared, same = noted.gap, noted.shared, noted.same
    memory.total[who] += 1
    if seen:
        if noted.seen:
            before = _last_of(memory, latest(memory.turns))
        else:
            before, shared = _occupants(memory, begin)
        gap, shared = neighbours(before, landing, gap, shared)
        same = _numbered(memory, landing, memory.total[who], same)
    memory.stay[who] = landing.stay
    order = note_turn(memory.turns, noted.order, landing, late)
    return Noted(gap, same, shared, seen, order)


@jit
def end_stay(state: System, memory: Landings, who: int, least: float) -> None:
    """Note that particle `who` leaves the base, now."""
    last = memory.turns.last
    stayed = (state.now[NOW.N] - last[0, who]) + (state.now[NOW.X] - last[1, who])
    memory.stay[who] = max(stayed, least)
