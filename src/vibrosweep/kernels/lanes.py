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

LANES = 128
VECTOR = 8
STRIDE = LANES + VECTOR

# rows of the scratch array
X, N, U = 0 * STRIDE, 1 * STRIDE, 2 * STRIDE  # phase, count (from the end), flight time
E, A, R = 3 * STRIDE, 4 * STRIDE, 5 * STRIDE  # restitution, kick, rest threshold
X_LIFT, WAIT, U_LIFT = 6 * STRIDE, 7 * STRIDE, 8 * STRIDE  # where a rest ends
X_END, N_BEGIN, X_BEGIN = 9 * STRIDE, 10 * STRIDE, 11 * STRIDE  # window
LANDINGS, RESTS = 12 * STRIDE, 13 * STRIDE
SUM, SQUARES, LARGEST = 14 * STRIDE, 15 * STRIDE, 16 * STRIDE  # of the flight times
AGE, DONE, LANE = 17 * STRIDE, 18 * STRIDE, 19 * STRIDE  # impacts so far, why it leaves, name
X_ANCHOR, N_ANCHOR, U_ANCHOR = 20 * STRIDE, 21 * STRIDE, 22 * STRIDE  # an earlier state
NEXT_ANCHOR = 23 * STRIDE  # age at which the next one is taken
ROWS = 24

GOES_ON, ENDED, SPENT, LOOK = 0.0, 1.0, 2.0, 3.0  # values of DONE


def scratch() -> Floats:
    """Scratch memory for one caller of `advance`, on a cache line so that no vector spans two."""
    memory = np.zeros(ROWS * STRIDE + VECTOR)
    offset = (-memory.ctypes.data // memory.itemsize) % VECTOR
    return memory[offset : offset + ROWS * STRIDE]
