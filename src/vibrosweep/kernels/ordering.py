"""Landings of one realization, listed as they are found and put in the order of time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels._jit import Floats, Integers, jit
from vibrosweep.kernels.lanes import LANES, STRIDE, VECTOR

__all__ = ["Landings", "Workspace", "closest", "put_in_order", "workspace"]

# rows of a block of lanes: state after the last landing taken, then the landing in question
X, N, U, WHO = 0 * STRIDE, 1 * STRIDE, 2 * STRIDE, 3 * STRIDE
X_LAND, N_LAND, STAY, DUE = 4 * STRIDE, 5 * STRIDE, 6 * STRIDE, 7 * STRIDE
N_REST = 8 * STRIDE  # whole periods of the lift-off from a rest, else infinite
BLOCK = 9 * STRIDE

FEW = 24  # a cell with more landings is sorted by itself
PERIODS_REMEMBERED = 64
NARROWEST = (
    2.0**-40
)  # gap, in periods; over more than FARTHEST periods it could be lost by rounding
FARTHEST = 2.0**10

Places = NDArray[np.int32]


class Landings(NamedTuple):
    """A list of landings: whole periods, phase, stay on the base, and particle."""

    whole: Floats
    phase: Floats
    stay: Floats
    who: Integers


class Workspace(NamedTuple):
    """Memory of one caller of `separate`."""

    state: Floats
    saved: Floats
    lanes: Integers
    found: Landings
    ordered: Landings
    cell: Places
    ends: Places
    rests: Floats


def workspace(particles: int) -> Workspace:
    """Memory for realizations of that many particles, independent of the length of the run."""
    blocks = -(-particles // LANES)
    capacity = max(4096, 4 * particles)
    memory = np.zeros(blocks * BLOCK + VECTOR)
    offset = (-memory.ctypes.data // memory.itemsize) % VECTOR

    def landings() -> Landings:
        whole, phase, stay = (np.zeros(capacity) for _ in range(3))
        return Landings(whole, phase, stay, np.zeros(capacity, np.int64))

    return Workspace(
        state=memory[offset : offset + blocks * BLOCK].reshape(blocks, BLOCK),
        saved=np.zeros((blocks, BLOCK)),
        lanes=np.zeros(blocks, np.int64),
        found=landings(),
        ordered=landings(),
        cell=np.zeros(capacity, np.int32),
        ends=np.zeros(capacity + 1, np.int32),
        rests=np.zeros(PERIODS_REMEMBERED),
    )


@jit
def _sort(listed: Landings, start: int, stop: int, gap: int) -> None:
    """Put the landings start ... stop - 1 exactly in the order of time.

    Shell's method with shrinking gaps; a first gap of 1 makes it an insertion sort.
    """
    whole, phase, stay, who = listed
    while gap > 0:
        for q in range(start + gap, stop):
            n, x, place = whole[q], phase[q], q
            if not (whole[q - gap] - n) + (phase[q - gap] - x) > 0.0:
                continue
            lasts, name = stay[q], who[q]
            while place >= start + gap:
                before = place - gap
                if not (whole[before] - n) + (phase[before] - x) > 0.0:
                    break
                whole[place], phase[place] = whole[before], phase[before]
                stay[place], who[place] = stay[before], who[before]
                place = before
            whole[place], phase[place], stay[place], who[place] = n, x, lasts, name
        gap = 1 if gap == 2 else gap * 5 // 11


@jit
def put_in_order(work: Workspace, k: int, n: float, x: float, span: float) -> None:
    """Put the k landings that were found into the order of time.

    They are counted into k cells of time, which begin at (n, x) and reach over `span` periods;
    what lies outside falls into the first or the last cell.  Exact comparisons do the rest, so
    that the cells decide on the speed only.
    """
    found, ordered, cell, ends = work.found, work.ordered, work.cell, work.ends
    scale = k / span if span > 1e-290 else 0.0
    last = k - 1.0
    for q in range(k):
        place = ((found.whole[q] - n) + (found.phase[q] - x)) * scale
        place = place if place > 0.0 else 0.0
        cell[q] = np.int32(place if place < last else last)
    ends[: k + 1] = 0
    for q in range(k):
        ends[cell[q] + 1] += 1
    for c in range(k):
        ends[c + 1] += ends[c]
    for q in range(k):
        to = ends[cell[q]]
        ends[cell[q]] = to + 1
        ordered.whole[to], ordered.phase[to] = found.whole[q], found.phase[q]
        ordered.stay[to], ordered.who[to] = found.stay[q], found.who[q]
    start = 0
    for c in range(k):  # ends[c] is by now the end of cell c
        if ends[c] - start > FEW:
            _sort(ordered, start, ends[c], (ends[c] - start) // 2)
        start = ends[c]
    _sort(ordered, 0, k, 1)


@jit
def closest(work: Workspace, k: int, gap: float) -> float:
    """Smallest gap between k landings of different particles, where it is below `gap`; else `gap`.

    Names below zero, of what is not inside the window, are left out.  Nothing is put in order: time
    is cut into cells of four gaps, and a landing is compared with those in its own cell and in
    the nearer one beside it; cells that are a multiple of the table's length apart share an entry.
    Where the gap is infinite or below `NARROWEST`, or landings lie beyond `FARTHEST`, NaN is
    returned.
    """
    found, following, heads = work.found, work.cell, work.ends
    if not NARROWEST <= gap < np.inf:
        return np.nan
    entries = 64
    while entries < 8 * k and 2 * entries < heads.size:
        entries *= 2
    heads[:entries] = -1
    n, x, scale = found.whole[0], found.phase[0], 0.5 / gap
    for q in range(k):
        if found.who[q] < 0:
            continue
        after = (found.whole[q] - n) + (found.phase[q] - x)
        if abs(after) > FARTHEST:
            return np.nan
        half = int(np.floor(after * scale))
        cell = half >> 1
        for near in (cell, cell + 1 if half & 1 else cell - 1):
            other = heads[near & (entries - 1)]
            while other >= 0:
                apart = abs(
                    (found.whole[q] - found.whole[other]) + (found.phase[q] - found.phase[other])
                )
                gap = apart if found.who[q] != found.who[other] and apart < gap else gap
                other = following[other]
        following[q] = heads[cell & (entries - 1)]
        heads[cell & (entries - 1)] = np.int32(q)
    return gap
