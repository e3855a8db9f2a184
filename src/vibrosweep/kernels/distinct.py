"""Search for duplicate realizations by hashing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels._jit import Floats, Integers, jit, kernel
from vibrosweep.model.parameters import Launches

Words = NDArray[np.uint64]

SEED = np.uint64(88172645463325252)
LEFT, RIGHT, AGAIN = np.uint64(13), np.uint64(7), np.uint64(17)


@jit
def _mixed(code: np.uint64, word: np.uint64) -> np.uint64:
    """Mix a word into a hash code by one step of xorshift (Marsaglia 2003)."""
    code ^= word
    code ^= code << LEFT
    code ^= code >> RIGHT
    return code ^ (code << AGAIN)


@jit
def _same(bits: Words, launches: Launches, i: int, j: int) -> bool:
    for c in range(bits.shape[0]):
        if bits[c, i] != bits[c, j]:
            return False
    if launches.whole.shape[0] > 1:
        for p in range(launches.whole.shape[1]):
            same = launches.whole[i, p] == launches.whole[j, p]
            if not same or launches.phase[i, p] != launches.phase[j, p]:
                return False
    return True


@kernel
def first_of_each(columns: Floats, launches: Launches, first: Integers) -> int:
    """Find the first realization that equals each one; return the number of distinct ones.

    The columns, of shape (quantity, realization), hold all numbers that determine a trajectory;
    they and the launches are compared bit by bit.
    """
    bits = columns.view(np.uint64)
    size = bits.shape[1]
    places = 16
    while places < 2 * size:
        places *= 2
    table = np.full(places, -1)
    found = 0
    for i in range(size):
        code = SEED
        for c in range(bits.shape[0]):
            code = _mixed(code, bits[c, i])
        place = np.int64(code & np.uint64(places - 1))
        while table[place] >= 0 and not _same(bits, launches, table[place], i):
            place = (place + 1) & (places - 1)
        if table[place] < 0:
            table[place] = i
            found += 1
        first[i] = table[place]
    return found
