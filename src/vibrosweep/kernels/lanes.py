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

__all__ = ["LANES", "ROW", "ROWS", "STRIDE", "VECTOR", "LaneRows", "aligned", "scratch"]

LANES: Final = 192
VECTOR: Final = 8
STRIDE: Final = LANES + VECTOR
OF_CONSTANTS: Final = 5  # rows that a base has for its constants

GOES_ON, ENDED, SPENT, RETURNED = 0.0, 1.0, 2.0, 3.0  # values of the row DONE


class LaneRows(NamedTuple):
    """Where the rows of the scratch memory begin, in order; CONSTANTS is the first of several.

    Those up to LARGEST take part in every impact.
    """

    CONSTANTS: int
    X_END: int
    X: int  # phase
    N: int  # whole periods from the end's
    U: int  # speed, as the time of the next flight
    LANDINGS: int
    RESTS: int
    NEW_SUM: int  # of the flight times since the last look, and of their squares
    NEW_SQUARES: int
    LARGEST: int
    SUM: int  # up to the last look
    SQUARES: int
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
    CYCLE_IMPACTS: int  # totals of the cycle that it has entered; 0 impacts while none is known
    CYCLE_PERIODS: int
    CYCLE_RESTS: int
    CYCLE_SUM: int
    CYCLE_SQUARES: int
    CYCLE_LARGEST: int


ROWS: Final = len(LaneRows._fields) - 1 + OF_CONSTANTS
ROW: Final = LaneRows(0, *(row * STRIDE for row in range(OF_CONSTANTS, ROWS)))


def aligned(numbers: int) -> Floats:
    """Zeros that begin on a line of the cache, so that no vector spans two."""
    memory = np.zeros(numbers + VECTOR)
    offset = (-memory.ctypes.data // memory.itemsize) % VECTOR
    return memory[offset : offset + numbers]


def scratch() -> Floats:
    """Scratch memory for one caller of `advance`."""
    return aligned(ROWS * STRIDE)
