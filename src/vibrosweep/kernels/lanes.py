"""Layout of the scratch array in which blocks of lanes are advanced.

A block of lanes (trajectories) lives in one flat array, one row per quantity.  One array with
constant row offsets, rather than one array per quantity, lets the compiler prove that rows do not
overlap, and the padding keeps equal lanes of different rows off the same sets of the first-level
cache.  The rows that every impact touches lie side by side: with others between them, one placement
in memory out of six made the same code half as fast.
"""

from __future__ import annotations

import numpy as np

from vibrosweep.kernels._jit import Floats

__all__ = ["LANES", "VECTOR", "scratch"]

LANES = 192
VECTOR = 8
STRIDE = LANES + VECTOR

# rows of the scratch array; those up to LARGEST take part in every impact
E, A, R = 0 * STRIDE, 1 * STRIDE, 2 * STRIDE  # restitution, kick, rest threshold
# where a rest ends: phase, NaN where it never does, and next flight
X_LIFT, U_LIFT = 3 * STRIDE, 4 * STRIDE
X_END = 5 * STRIDE
X, N, U = 6 * STRIDE, 7 * STRIDE, 8 * STRIDE  # phase, count (from the end), flight time
LANDINGS, RESTS = 9 * STRIDE, 10 * STRIDE
NEW_SUM, NEW_SQUARES = 11 * STRIDE, 12 * STRIDE  # of the flight times since the last look
LARGEST = 13 * STRIDE
SUM, SQUARES = 14 * STRIDE, 15 * STRIDE  # up to the last look
# an earlier state, and the rests before it
X_ANCHOR, N_ANCHOR, U_ANCHOR = 16 * STRIDE, 17 * STRIDE, 18 * STRIDE
RESTS_ANCHOR = 19 * STRIDE
NEXT_ANCHOR, AGE = 20 * STRIDE, 21 * STRIDE  # age at which the next one is taken; impacts so far
N_BEGIN, X_BEGIN = 22 * STRIDE, 23 * STRIDE  # window
DONE, LANE = 24 * STRIDE, 25 * STRIDE  # why it leaves, name
# totals of the cycle that it has entered; 0 impacts while that is not known
C_IMPACTS, C_PERIODS, C_RESTS = 26 * STRIDE, 27 * STRIDE, 28 * STRIDE
C_SUM, C_SQUARES, C_LARGEST = 29 * STRIDE, 30 * STRIDE, 31 * STRIDE
ROWS = 32

GOES_ON, ENDED, SPENT, RETURNED = 0.0, 1.0, 2.0, 3.0  # values of DONE


def scratch() -> Floats:
    """Scratch memory for one caller of `advance`, on a cache line so that no vector spans two."""
    size = ROWS * STRIDE
    memory = np.zeros(size + VECTOR)
    offset = (-memory.ctypes.data // memory.itemsize) % VECTOR
    return memory[offset : offset + size]
