"""Landings of one realization, listed as they are found and put in the order of time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels._jit import Floats, Integers, jit
from vibrosweep.kernels.lanes import LANES, STRIDE, VECTOR

__all__ = ["Workspace", "closest", "put_in_order", "workspace"]

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


# rows of a list of landings: whole periods, phase, stay on the base, and particle
WHOLE, PHASE, LASTS, WHO_LANDS = 0, 1, 2, 3
ORDERED = 4  # from a row to the same in the order of time
# rows of the table of cells: that of each landing, or the next one in its cell; end, or head, of a
# cell
CELL, ENDS = 0, 1


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


def workspace(particles: int) -> Workspace:
    """Memory for realizations of that many particles, independent of the length of the run."""
    blocks = -(-particles // LANES)
    capacity = max(4096, 4 * particles)
    memory = np.zeros(blocks * BLOCK + VECTOR)
    offset = (-memory.ctypes.data // memory.itemsize) % VECTOR

    return Workspace(
        state=memory[offset : offset + blocks * BLOCK].reshape(blocks, BLOCK),
        saved=np.zeros((blocks, BLOCK)),
        lanes=np.zeros(blocks, np.int64),
        listed=np.zeros((2 * ORDERED, capacity)),
        cells=np.zeros((2, capacity + 1), np.int32),
        rests=np.zeros(PERIODS_REMEMBERED),
    )


@jit
def _sort(listed: Floats, start: int, stop: int, gap: int) -> None:
    """Put the ordered landings start ... stop - 1 exactly in the order of time.

    Shell's method with shrinking gaps; a first gap of 1 makes it an insertion sort.
    """
    whole, phase = ORDERED + WHOLE, ORDERED + PHASE
    lasts, who = ORDERED + LASTS, ORDERED + WHO_LANDS
    while gap > 0:
        for q in range(start + gap, stop):
            n, x, place = listed[whole, q], listed[phase, q], q
            if not (listed[whole, q - gap] - n) + (listed[phase, q - gap] - x) > 0.0:
                continue
            stay, name = listed[lasts, q], listed[who, q]
            while place >= start + gap:
                before = place - gap
                if not (listed[whole, before] - n) + (listed[phase, before] - x) > 0.0:
                    break
                for row in range(ORDERED, 2 * ORDERED):
                    listed[row, place] = listed[row, before]
                place = before
            listed[whole, place], listed[phase, place] = n, x
            listed[lasts, place], listed[who, place] = stay, name
        gap = 1 if gap == 2 else gap * 5 // 11


@jit
def put_in_order(listed: Floats, cells: Places, k: int, n: float, x: float, span: float) -> None:
    """Put the k landings that were found into the order of time.

    They are counted into k cells of time, which begin at (n, x) and reach over `span` periods;
    what lies outside falls into the first or the last cell.  Exact comparisons do the rest, so
    that the cells decide on the speed only.
    """
    scale = k / span if span > 1e-290 else 0.0
    last = k - 1.0
    for q in range(k):
        place = ((listed[WHOLE, q] - n) + (listed[PHASE, q] - x)) * scale
        place = place if place > 0.0 else 0.0
        cells[CELL, q] = np.int32(place if place < last else last)
    cells[ENDS, : k + 1] = 0
    for q in range(k):
        cells[ENDS, cells[CELL, q] + 1] += 1
    for c in range(k):
        cells[ENDS, c + 1] += cells[ENDS, c]
    for q in range(k):
        to = cells[ENDS, cells[CELL, q]]
        cells[ENDS, cells[CELL, q]] = to + 1
        for row in range(ORDERED):
            listed[ORDERED + row, to] = listed[row, q]
    start = 0
    for c in range(k):  # this is by now the end of cell c
        end = cells[ENDS, c]
        if end - start > FEW:
            _sort(listed, start, end, (end - start) // 2)
        start = end
    _sort(listed, 0, k, 1)


@jit
def closest(listed: Floats, cells: Places, k: int, gap: float) -> float:
    """Smallest gap between k landings of different particles, where it is below `gap`; else `gap`.

    Names below zero, of what is not inside the window, are left out.  Nothing is put in order: time
    is cut into cells of four gaps, and a landing is compared with those in its own cell and in
    the nearer one beside it; cells that are a multiple of the table's length apart share an entry.
    Where the gap is infinite or below `NARROWEST`, or landings lie beyond `FARTHEST`, NaN is
    returned.
    """
    if not NARROWEST <= gap < np.inf:
        return np.nan
    entries = 64
    while entries < 8 * k and 2 * entries < cells.shape[1]:
        entries *= 2
    cells[ENDS, :entries] = -1
    n, x, scale = listed[WHOLE, 0], listed[PHASE, 0], 0.5 / gap
    for q in range(k):
        who = listed[WHO_LANDS, q]
        if who < 0.0:
            continue
        whole, phase = listed[WHOLE, q], listed[PHASE, q]
        after = (whole - n) + (phase - x)
        if abs(after) > FARTHEST:
            return np.nan
        half = int(np.floor(after * scale))
        cell = half >> 1
        for near in (cell, cell + 1 if half & 1 else cell - 1):
            other = cells[ENDS, near & (entries - 1)]
            while other >= 0:
                apart = abs((whole - listed[WHOLE, other]) + (phase - listed[PHASE, other]))
                gap = apart if who != listed[WHO_LANDS, other] and apart < gap else gap
                other = cells[CELL, other]
        cells[CELL, q] = cells[ENDS, cell & (entries - 1)]
        cells[ENDS, cell & (entries - 1)] = np.int32(q)
    return gap
