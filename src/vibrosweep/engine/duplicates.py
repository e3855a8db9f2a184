"""Duplicate realizations of a batch, which need to be computed only once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels.distinct import first_of_each
from vibrosweep.model.parameters import Dimensionless, Launches

__all__ = ["find_equal"]

Array = NDArray[np.float64]
Places = NDArray[np.int64]

AT_ONCE = Launches(np.zeros((1, 1)), np.zeros((1, 1)))  # one for the whole batch


def find_equal(problem: Dimensionless, launch: Launches, *others: Array) -> Places | None:
    """Find duplicate realizations.

    Parameters
    ----------
    problem, launch
        The batch.
    others
        Further arrays that have to agree, each of shape (realization,).

    Returns
    -------
    numpy.ndarray or None
        For each realization the index of the first equal one; None if all are distinct.
    """
    if _firsts([problem.kick], AT_ONCE) is None:  # as is plain where they are drawn
        return None
    return _firsts([*problem, *others], launch)


def _firsts(columns: list[Array], launch: Launches) -> Places | None:
    """Index of the first equal row of columns and launches, for each; None if all differ."""
    first = np.empty(columns[0].size, np.int64)
    return first if first_of_each(np.stack(columns), launch, first) < first.size else None
