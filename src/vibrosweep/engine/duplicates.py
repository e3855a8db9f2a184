"""Duplicate realizations of a batch, which are computed only once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.kernels.distinct import first_of_each
from vibrosweep.model.parameters import Dimensionless, Launches

Places = NDArray[np.int64]


def find_equal(problem: Dimensionless, launch: Launches, *others: Array) -> Places | None:
    """Return the index of the first equal realization for each one; None if all are distinct.

    `others` are further arrays of shape (realization,) that have to agree.  The problem must be
    without noise.
    """
    known = [values for values in problem if isinstance(values, np.ndarray)]
    if any(map(_all_differ, known)):  # as in most designs that draw values
        return None
    columns = np.stack([*known, *others])
    first = np.empty(columns.shape[1], np.int64)
    return first if first_of_each(columns, launch, first) < first.size else None


def _all_differ(column: Array) -> bool:
    ordered = np.sort(column)  # np.unique would import the masked arrays
    return bool(np.all(ordered[1:] != ordered[:-1]))
