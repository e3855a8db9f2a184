"""Landings of one realization, listed as they are found and put in the order of time."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels._jit import Floats, Integers, jit, part
from vibrosweep.kernels.lanes import LANES, STRIDE, aligned

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
    WHO: int = 3  # particle p, or -1 - p for one that landed before the window


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
