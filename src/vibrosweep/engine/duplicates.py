"""Realizations that are one and the same problem."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels.distinct import first_of_each
from vibrosweep.model.parameters import Dimensionless, Launches

__all__ = ["find_equal"]

Array = NDArray[np.float64]
Places = NDArray[np.int64]

AT_ONCE = Launches(np.zeros((1, 1)), np.zeros((1, 1)))  # the same for all


def find_equal(problem: Dimensionless, launch: Launches, *others: Array) -> Places | None:
    """Find realizations that are the same problem.

    Parameters
    ----------
    problem, launch
        The batch.
    others
        What else has to be equal, each of shape (realization,).

    Returns
    -------
    numpy.ndarray or None
        For each realization the first one that is the same; None where all differ.
    """
    if _firsts([problem.kick], AT_ONCE) is None:  # as is plain where they are drawn
        return None
    return _firsts([*problem, *others], launch)


def _firsts(columns: list[Array], launch: Launches) -> Places | None:
    """The first place that agrees in all columns and launches, for each; None where all differ."""
    first = np.empty(columns[0].size, np.int64)
    return first if first_of_each(np.stack(columns), launch, first) < first.size else None
