"""Landings of one realization, listed as they are found and put in the order of time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, Integers, jit
from vibrosweep.kernels.lanes import LANES, STRIDE, VECTOR

__all__ = ["Workspace", "put_in_order", "workspace"]

# rows of a block of lanes: state after the last landing taken, then the landing in question
X, N, U, WHO = 0 * STRIDE, 1 * STRIDE, 2 * STRIDE, 3 * STRIDE
X_LAND, N_LAND, STAY, DUE = 4 * STRIDE, 5 * STRIDE, 6 * STRIDE, 7 * STRIDE
BLOCK = 8 * STRIDE

FEW = 24  # up to this many landings are ordered by insertion alone


class Workspace(NamedTuple):
    """Memory of one caller of `separate`."""

    state: Floats
    saved: Floats
    lanes: Integers
    whole: Floats
    phase: Floats
    stay: Floats
    who: Integers
    key: Floats
    order: Integers
    cells: Integers


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
        whole=np.zeros(capacity),
        phase=np.zeros(capacity),
        stay=np.zeros(capacity),
        who=np.zeros(capacity, np.int64),
        key=np.zeros(capacity),
        order=np.zeros(capacity, np.int64),
        cells=np.zeros(capacity + 1, np.int64),
    )


@jit
def _sort(work: Workspace, start: int, stop: int, gap: int) -> None:
    """Put the landings order[start:stop] exactly in the order of time.

    Shell's method with shrinking gaps; a first gap of 1 makes it an insertion sort.
    """
    order, whole, phase = work.order, work.whole, work.phase
    while gap > 0:
        for q in range(start + gap, stop):
            i, place = order[q], q
            while place >= start + gap:
                before = order[place - gap]
                if not (whole[before] - whole[i]) + (phase[before] - phase[i]) > 0.0:
                    break
                order[place] = before
                place -= gap
            order[place] = i
        gap = 1 if gap == 2 else gap * 5 // 11


@jit
def _bucket(work: Workspace, k: int) -> None:
    """Order k landings roughly, by counting them into k cells of time."""
    order, key, cells = work.order, work.key, work.cells
    n, x = work.whole[0], work.phase[0]
    low, high = np.inf, -np.inf
    for q in range(k):
        key[q] = (work.whole[q] - n) + (work.phase[q] - x)
        low, high = min(low, key[q]), max(high, key[q])
    if not high - low > 1e-290:
        _sort(work, 0, k, k // 2)
        return
    scale = (k - 1) / (high - low)
    for q in range(k + 1):
        cells[q] = 0
    for q in range(k):
        cells[min(int((key[q] - low) * scale), k - 1) + 1] += 1
    for c in range(k):
        cells[c + 1] += cells[c]
    for q in range(k):
        c = min(int((key[q] - low) * scale), k - 1)
        order[cells[c]] = q
        cells[c] += 1
    start = 0
    for c in range(k):  # cells[c] is by now the end of cell c
        if cells[c] - start > FEW:
            _sort(work, start, cells[c], (cells[c] - start) // 2)
        start = cells[c]


@jit
def put_in_order(work: Workspace, k: int) -> None:
    """Put k landings in the order of time: roughly by cells, then exactly by insertion."""
    for q in range(k):
        work.order[q] = q
    if k > FEW:
        _bucket(work, k)
    _sort(work, 0, k, 1)
