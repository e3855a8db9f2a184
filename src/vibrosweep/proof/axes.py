"""Check of the arrays that a file holds under the names of its dimensions.

A dimension of netCDF-4 without a variable is an HDF5 array that is never written.  A program that
saves a dataset again may turn it into a variable that numbers realizations, particles or impacts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import h5py
import numpy as np

from vibrosweep.proof.judgement import Judgement
from vibrosweep.store.dataset import NO_VARIABLE

NUMBERED: Final = ("realization", "particle", "impact")
MARK: Final = NO_VARIABLE.partition("%")[0]


def judge_axes(path: Path) -> Iterator[Judgement]:
    """Judge the axes of a file and of its record: variables, and arrays that must hold zeros."""
    with h5py.File(path) as file:
        for place in ("", "record"):
            group = file.get(place or "/")
            # links may lead out of the file, or in circles
            named = [
                n for n in group or () if isinstance(group.get(n, getlink=True), h5py.HardLink)
            ]
            for name in named:
                axis = group[name]
                if isinstance(axis, h5py.Dataset) and axis.ndim == 1:
                    yield from _judged(f"{place}/{name}".lstrip("/"), axis)


def _judged(name: str, axis: h5py.Dataset) -> Iterator[Judgement]:
    mark = axis.attrs.get("NAME", b"")
    mark = mark.decode(errors="replace") if isinstance(mark, bytes) else str(mark)
    variable = not mark.startswith(MARK)
    if (variable and name.rpartition("/")[2] not in NUMBERED) or axis.dtype.kind not in "iuf":
        return
    values = np.asarray(axis[...])
    expected = np.arange(values.size) if variable else np.zeros(values.size)
    wrong = np.flatnonzero(values != expected)
    if wrong.size:
        at, value = int(wrong[0]), float(values[wrong[0]])
        complaint = f"is {value!r} at {at}, where a file of vibrosweep has {expected[at]:g}"
        yield Judgement(name, None, math.inf, 0.0, None, complaint)
    elif variable:
        yield Judgement(name, None, 0.0, 0.0)
