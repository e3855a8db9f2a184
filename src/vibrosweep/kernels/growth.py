"""Mean growth per impact along an orbit, with the error of the mean from means of blocks.

Successive growths are correlated, so that the standard error of their mean does not follow from
their variance.  They are gathered into blocks of equal length.  The means of blocks much longer
than the correlation time are practically independent, and their variance gives the standard error
of the mean (the method of batch means).  When all blocks are full, neighbours are joined and blocks
become twice as long, because the number of impacts is not known beforehand.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from vibrosweep.kernels import elementary
from vibrosweep.kernels._jit import Floats, jit

BLOCKS = 32


class Places(NamedTuple):
    """Places of further numbers, which follow the means of the blocks in this order."""

    FILLED: int  # blocks
    LENGTH: int  # impacts of a block
    PARTIAL: int  # growth in the block that is being filled
    INSIDE: int  # impacts in it
    TOTAL: int  # growth
    COUNT: int  # impacts


AT: Final = Places(*range(BLOCKS, BLOCKS + len(Places._fields)))
SIZE: Final = BLOCKS + len(AT)


@jit
def logarithm(grown: float) -> float:
    """Logarithm of a growth, -inf of 0."""
    return elementary.log(grown) if grown > 0.0 else -np.inf


@jit
def empty(g: Floats) -> None:
    """Forget all growth; `g` has `SIZE` numbers."""
    g[:] = 0.0
    g[AT.LENGTH] = 1.0


@jit
def add(g: Floats, grown: float) -> None:
    """Add the logarithm of the growth in one impact."""
    g[AT.TOTAL] += grown
    g[AT.COUNT] += 1.0
    g[AT.PARTIAL] += grown
    g[AT.INSIDE] += 1.0
    if g[AT.INSIDE] < g[AT.LENGTH]:
        return
    g[int(g[AT.FILLED])] = g[AT.PARTIAL] / g[AT.LENGTH]
    g[AT.PARTIAL] = g[AT.INSIDE] = 0.0
    g[AT.FILLED] += 1.0
    if g[AT.FILLED] == BLOCKS:
        for b in range(BLOCKS // 2):
            g[b] = 0.5 * (g[2 * b] + g[2 * b + 1])
        g[AT.FILLED] = BLOCKS // 2
        g[AT.LENGTH] *= 2.0


@jit
def mean(g: Floats) -> float:
    """Mean growth per impact; NaN if there are no impacts."""
    if g[AT.COUNT] == 0.0:
        return np.nan
    return g[AT.TOTAL] / g[AT.COUNT]  # type: ignore[no-any-return]


@jit
def error(g: Floats) -> float:
    """Standard error of the mean, from at most 31 blocks; NaN below two, 0 for a mean of -inf."""
    filled = int(g[AT.FILLED])
    if g[AT.TOTAL] == -np.inf:
        return 0.0
    if filled < 2:
        return np.nan
    middle, squares = 0.0, 0.0
    for b in range(filled):  # numpy.sum would choose an order of its own
        middle += g[b] / filled
    for b in range(filled):
        squares += (g[b] - middle) * (g[b] - middle)
    return math.sqrt(squares / (filled * (filled - 1.0)))
