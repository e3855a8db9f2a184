"""Separations between landings on a base of finite mass, and the order of the particles.

Landings come in the order of time: of all pairs the closest is one of neighbours.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, Integers, kernel
from vibrosweep.kernels.coupled.state import NOW, System
from vibrosweep.kernels.sine import cos_turns, sin_turns

__all__ = ["HARMONICS", "Landings", "Order", "clear", "landings", "note", "order_of"]

GAPS = 4096  # of the last period; with more they are left undetermined
INDICES = 256  # impact numbers remembered at first
MOST_INDICES = 2**22
# multiples of the forcing frequency at which the phases of the last landings are compared
HARMONICS = (1.0, 2.0, 3.0, 0.5, 1.0 / 3.0)


class Landings(NamedTuple):
    """What is remembered of landings; of no use to more than one thread.

    Attributes
    ----------
    last
        Whole periods and phase of the last landing of each particle; shape (2, particle).
    turn
        Number of that landing among all of the realization, 0 without any; shape (particle,).
    total
        Landings of each particle since its launch.
    numbered
        Last landing of each impact number: whole periods and phase; shape (2, number).
    number
        The impact number that stands in each place, 0 for none in the window.
    gaps
        Between neighbouring landings of different particles in the last period.
    """

    last: Floats
    turn: Integers
    total: Integers
    numbered: Floats
    number: Integers
    gaps: Floats


class Order(NamedTuple):
    """Separations and order so far.

    Attributes
    ----------
    gap, same
        Smallest separation of landings of different particles, and of those of the same number.
    shared
        1 where two particles were on the base at once.
    who, number, seen
        The last particle that landed, how many landings there were, and whether the last one was
        in the window.
    changes
        Landings in the window of another particle than that whose turn it was.
    gaps
        How many of `Landings.gaps` are in use.
    """

    gap: float
    same: float
    shared: int
    who: int
    number: int
    seen: bool
    changes: int
    gaps: int


def landings(particles: int) -> Landings:
    """Allocate what is remembered of landings."""
    last, numbered = np.zeros((2, particles)), np.zeros((2, INDICES))
    turn, total = np.zeros(particles, np.int64), np.zeros(particles, np.int64)
    return Landings(last, turn, total, numbered, np.zeros(INDICES, np.int64), np.zeros(GAPS))


@kernel
def clear(room: Landings) -> Order:
    """Forget all landings."""
    room.turn[:] = 0
    room.total[:] = 0
    room.number[:] = 0
    return Order(np.inf, np.inf, 0, -1, 0, False, 0, 0)


@kernel
def _numbered(of: System, room: Landings, who: int, seen: bool) -> tuple[Landings, float]:
    """Compare with the last landing of the same number; return the separation.

    Infinity without one, NaN where it is no longer remembered.
    """
    mine = room.total[who]
    if room.number[mine % room.number.size] not in (0, mine):
        room = _with_room(of, room, mine)
    place, gap = mine % room.number.size, np.inf
    if room.number[place] == mine and seen:
        gap = (of.now[NOW.N] - room.numbered[0, place]) + (of.now[NOW.X] - room.numbered[1, place])
    elif room.number[place] > mine:
        return room, np.nan
    room.numbered[0, place], room.numbered[1, place] = of.now[NOW.N], of.now[NOW.X]
    room.number[place] = mine if seen else 0
    return room, gap


@kernel
def _with_room(of: System, room: Landings, most: int) -> Landings:
    """Return memory for all numbers that another particle may still reach."""
    least = most
    for j in range(of.mode.size):
        least = min(least, room.total[j])
    size = room.number.size
    while size <= most - least and size < MOST_INDICES:
        size *= 2
    if size == room.number.size:
        return room
    numbered, number = np.zeros((2, size)), np.zeros(size, np.int64)
    for old in range(room.number.size):
        k = room.number[old]
        if k > 0:
            number[k % size] = k
            for row in range(2):  # slices take the compiler long
                numbered[row, k % size] = room.numbered[row, old]
    return Landings(room.last, room.turn, room.total, numbered, number, room.gaps)


@kernel
def note(
    of: System,
    rides: Integers,
    room: Landings,
    order: Order,
    who: int,
    windows: tuple[bool, bool],
    r: float,
) -> tuple[Landings, Order]:
    """Note a landing of particle `who`, now.

    `rides`: 1 for each particle that rests.  `windows`: whether now is in the window, and in its
    last period.
    """
    seen, late = windows
    n, x = of.now[NOW.N], of.now[NOW.X]
    gap, shared, gaps, longest = order.gap, order.shared, order.gaps, who
    for j in range(rides.size):
        if 0 < room.turn[j] < room.turn[longest]:
            longest = j
        if j != who and seen and rides[j] == 1:
            shared = 1
    if order.who >= 0 and order.who != who:
        apart = (n - room.last[0, order.who]) + (x - room.last[1, order.who])
        shared = 1 if seen and apart <= r else shared
        gap = min(gap, apart) if seen and order.seen else gap
        if late:
            if gaps < GAPS:
                room.gaps[gaps] = apart
            gaps += 1
    out_of_turn = seen and room.turn[who] > 0 and longest != who
    room.total[who] += 1
    room, same = _numbered(of, room, who, seen)
    room.last[0, who], room.last[1, who] = n, x
    room.turn[who] = order.number + 1
    same = order.same if order.same < same else same  # NaN once it is not known
    changes = order.changes + (1 if out_of_turn else 0)
    return room, Order(gap, same, shared, who, order.number + 1, seen, changes, gaps)


@kernel
def order_of(room: Landings, harmonic: float) -> float:
    """Return the mean of exp(2 pi i h t) over the last landings, as an absolute value.

    NaN where no particle has landed.
    """
    even, odd, count = 0.0, 0.0, 0
    for j in range(room.turn.size):
        if room.turn[j] > 0:
            turns = harmonic * room.last[0, j]
            turns = (turns - np.rint(turns)) + harmonic * room.last[1, j]
            turns -= np.rint(turns)
            even += cos_turns(turns)
            odd += sin_turns(turns)
            count += 1
    return np.sqrt(even * even + odd * odd) / count if count > 0 else np.nan
