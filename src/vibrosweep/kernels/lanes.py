"""Layout of the scratch array in which blocks of lanes are advanced.

A block of lanes (trajectories) lives in one flat array, one row per quantity.  One array with
constant row offsets, rather than one array per quantity, lets the compiler prove that rows do not
overlap, and the padding keeps equal lanes of different rows off the same sets of the first-level
cache.
"""

from __future__ import annotations

import numpy as np

from vibrosweep.kernels._jit import Floats

__all__ = ["LANES", "VECTOR", "scratch"]

LANES = 192
VECTOR = 8
STRIDE = LANES + VECTOR

# rows of the scratch array
X, N, U = 0 * STRIDE, 1 * STRIDE, 2 * STRIDE  # phase, count (from the end), flight time
LANDINGS, RESTS = 3 * STRIDE, 4 * STRIDE
SUM, SQUARES, LARGEST = 5 * STRIDE, 6 * STRIDE, 7 * STRIDE  # of the flight times
X_ANCHOR, N_ANCHOR, U_ANCHOR = 8 * STRIDE, 9 * STRIDE, 10 * STRIDE  # an earlier state
NEXT_ANCHOR, AGE = 11 * STRIDE, 12 * STRIDE  # age at which the next one is taken; impacts so far
MOVING = 13  # rows so far: what changes from impact to impact
E, A, R = 13 * STRIDE, 14 * STRIDE, 15 * STRIDE  # restitution, kick, rest threshold
X_LIFT, WAIT, U_LIFT = 16 * STRIDE, 17 * STRIDE, 18 * STRIDE  # where a rest ends
X_END, N_BEGIN, X_BEGIN = 19 * STRIDE, 20 * STRIDE, 21 * STRIDE  # window
DONE, LANE = 22 * STRIDE, 23 * STRIDE  # why it leaves, name
# totals of the cycle that it has entered; 0 impacts while that is not known
C_IMPACTS, C_PERIODS, C_RESTS = 24 * STRIDE, 25 * STRIDE, 26 * STRIDE
C_SUM, C_SQUARES, C_LARGEST = 27 * STRIDE, 28 * STRIDE, 29 * STRIDE
ROWS = 30
SAVED = ROWS * STRIDE  # the moving rows again, as they were at an earlier impact
ALL_ROWS = ROWS + MOVING
# sums since the last look, which are zero when lanes are moved, saved and filled
NEW_SUM, NEW_SQUARES = ALL_ROWS * STRIDE, (ALL_ROWS + 1) * STRIDE

GOES_ON, ENDED, SPENT, LOOK = 0.0, 1.0, 2.0, 3.0  # values of DONE


def scratch() -> Floats:
    """Scratch memory for one caller of `advance`, on a cache line so that no vector spans two."""
    size = NEW_SQUARES + STRIDE
    memory = np.zeros(size + VECTOR)
    offset = (-memory.ctypes.data // memory.itemsize) % VECTOR
    return memory[offset : offset + size]
