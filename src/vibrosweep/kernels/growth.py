"""Mean growth per impact along an orbit, with the error of the mean from means of blocks.

Successive growths are correlated, so their own scatter says little of the error of their mean.
They are gathered into blocks of equal length; the means of blocks much longer than the correlation
are as good as independent, and their scatter gives the standard error of the mean (the method of
batch means).  When all blocks are full, neighbours are joined and blocks become twice as long, so
that the length adapts to an orbit whose number of impacts is not known beforehand.
"""

from __future__ import annotations

import math

import numpy as np

from vibrosweep.kernels._jit import Floats, jit

__all__ = ["ROOM", "add", "count", "empty", "error", "logarithm", "mean"]

BLOCKS = 32
FILLED, LENGTH, PARTIAL, INSIDE, TOTAL, COUNT = range(BLOCKS, BLOCKS + 6)
ROOM = BLOCKS + 6


@jit
def logarithm(grown: float) -> float:
    """Logarithm of a growth, -inf of 0."""
    return math.log(grown) if grown > 0.0 else -np.inf


@jit
def empty(g: Floats) -> None:
    """Forget all growth; `g` has `ROOM` numbers."""
    g[:] = 0.0
    g[LENGTH] = 1.0


@jit
def add(g: Floats, grown: float) -> None:
    """Add the logarithm of the growth in one impact."""
    g[TOTAL] += grown
    g[COUNT] += 1.0
    g[PARTIAL] += grown
    g[INSIDE] += 1.0
    if g[INSIDE] < g[LENGTH]:
        return
    g[int(g[FILLED])] = g[PARTIAL] / g[LENGTH]
    g[PARTIAL] = g[INSIDE] = 0.0
    g[FILLED] += 1.0
    if g[FILLED] == BLOCKS:
        for b in range(BLOCKS // 2):
            g[b] = 0.5 * (g[2 * b] + g[2 * b + 1])
        g[FILLED] = BLOCKS // 2
        g[LENGTH] *= 2.0


@jit
def count(g: Floats) -> float:
    """Count the impacts whose growth was added."""
    return g[COUNT]  # type: ignore[no-any-return]


@jit
def mean(g: Floats) -> float:
    """Mean growth per impact; NaN without impacts."""
    if g[COUNT] == 0.0:
        return np.nan
    return g[TOTAL] / g[COUNT]  # type: ignore[no-any-return]


@jit
def error(g: Floats) -> float:
    """Standard error of the mean, from 16 to 31 blocks; NaN below two, 0 of a mean of -inf."""
    filled = int(g[FILLED])
    if g[TOTAL] == -np.inf:
        return 0.0
    if filled < 2:
        return np.nan
    middle, squares = 0.0, 0.0
    for b in range(filled):  # a sum of numpy's would depend on its order
        middle += g[b] / filled
    for b in range(filled):
        squares += (g[b] - middle) * (g[b] - middle)
    return math.sqrt(squares / (filled * (filled - 1.0)))
