"""Layout of the scratch memory in which blocks of lanes are advanced.

A block of lanes (trajectories) lives in one flat array, one row per quantity.  One array with
constant row offsets, rather than one array per quantity, lets the compiler prove that rows do not
overlap, and the padding keeps equal lanes of different rows off the same sets of the first-level
cache.  The rows that every impact touches lie side by side: with others between them, one placement
in memory out of six made the same code half as fast.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats

__all__ = ["LANES", "ROW", "ROWS", "STRIDE", "VECTOR", "Rows", "aligned"]

LANES: Final = 192
VECTOR: Final = 8
STRIDE: Final = LANES + VECTOR
OF_SCENE: Final = 5  # rows that a base has for its scene

GOES_ON, ENDED, SPENT, RETURNED = 0.0, 1.0, 2.0, 3.0  # values of the row DONE


class Rows(NamedTuple):
    """Where the rows of the scratch memory begin, in their order; SCENE is the first of several.

    Those from SCENE on take part in every impact, and so do some of `statistics`, which follow.
    """

    X_ANCHOR: int  # an earlier state, and the rests before it
    N_ANCHOR: int
    U_ANCHOR: int
    RESTS_ANCHOR: int
    NEXT_ANCHOR: int  # age at which the next one is taken
    AGE: int  # impacts so far
    N_BEGIN: int  # of the window
    X_BEGIN: int
    DONE: int  # why the trajectory leaves its place
    LANE: int  # which trajectory it is
    X_END: int
    X: int  # phase
    N: int  # whole periods from the end's
    U: int  # speed, as the time of the next flight
    SCENE: int


ROW: Final = Rows(*(row * STRIDE for row in range(len(Rows._fields))))
ROWS: Final = len(Rows._fields) - 1 + OF_SCENE


def aligned(numbers: int) -> Floats:
    """Zeros that begin on a line of the cache, so that no vector spans two."""
    memory = np.zeros(numbers + VECTOR)
    offset = (-memory.ctypes.data // memory.itemsize) % VECTOR
    return memory[offset : offset + numbers]
