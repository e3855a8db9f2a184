"""Edges of a code along an axis: a coarse scan, then bisection of all edges of all rows at once.

A code is the state at a point: 0 or 1 for a condition, and more values where a coarse scan could
step over an intermediate state.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.kernels.memory import unwritten

Codes = NDArray[np.int64]

# Rows, positions and initial states (first axis: point) -> codes and final states.  The states are
# empty if every point is evaluated independently.
Evaluate = Callable[[Codes, Array, Array], tuple[Codes, Array]]


class Edges(NamedTuple):
    """Brackets of edges, each array of shape (edge,), ordered by row and position.

    Between `low` and `high` the code changes to `code_high`.
    """

    row: Codes
    low: Array
    high: Array
    code_high: Codes


class _Brackets(NamedTuple):
    """Brackets during bisection, with the states at their near ends."""

    row: Codes
    near: Array
    far: Array
    code_near: Codes
    code_far: Codes
    state: Array

    def take(self, chosen: Any) -> _Brackets:
        return _Brackets._make(values[chosen] for values in self)

    def join(self, other: _Brackets) -> _Brackets:
        return _Brackets._make(np.concatenate(pair) for pair in zip(self, other, strict=True))


def find_edges(
    evaluate: Evaluate,
    rows: int,
    axis: Array,
    tolerance: float,
    *,
    start: Array | None = None,
    upward: bool = True,
) -> tuple[Codes, Edges]:
    """Codes (row, position) at the points of a scan, and all edges between unlike neighbours.

    `evaluate` is called with all rows and edges at once.  The axis ascends; the tolerance is the
    width of a bracket relative to its position.  With `start`, the initial states of all rows,
    states are continued from point to point, upwards or downwards, and in a bisection from the near
    end of its bracket; without it every point is evaluated independently.
    """
    codes, states = _scan(evaluate, rows, axis, start, upward)
    row, left = np.nonzero(codes[:, 1:] != codes[:, :-1])
    near, far = (left, left + 1) if upward else (left + 1, left)
    brackets = _Brackets(
        row, axis[near], axis[far], codes[row, near], codes[row, far], states[row, near]
    )
    done = _bisect(evaluate, brackets, tolerance)
    swap = done.near > done.far
    edges = Edges(
        done.row,
        np.minimum(done.near, done.far),
        np.maximum(done.near, done.far),
        np.where(swap, done.code_near, done.code_far),
    )
    order = np.lexsort((edges.low, edges.row))
    return codes, Edges._make(values[order] for values in edges)


def _scan(
    evaluate: Evaluate, rows: int, axis: Array, start: Array | None, upward: bool
) -> tuple[Codes, Array]:
    """Codes and states at all points, shape (row, position, ...)."""
    row = np.arange(rows)
    if start is None:
        nothing = np.empty((rows * axis.size, 0))
        codes, _ = evaluate(np.repeat(row, axis.size), np.tile(axis, rows), nothing)
        return codes.reshape(rows, axis.size), nothing.reshape(rows, axis.size, 0)
    codes = unwritten((rows, axis.size), np.int64)
    states = unwritten((rows, axis.size, *start.shape[1:]))
    for i in range(axis.size) if upward else range(axis.size - 1, -1, -1):
        codes[:, i], start = evaluate(row, np.full(rows, axis[i]), start)
        states[:, i] = start
    return codes, states


def _bisect(evaluate: Evaluate, brackets: _Brackets, tolerance: float) -> _Brackets:
    """Halve all brackets until they are narrow; one with a third code inside becomes two."""
    finished = brackets.take(slice(0, 0))
    while brackets.row.size:
        middle = 0.5 * (brackets.near + brackets.far)
        width = np.abs(brackets.far - brackets.near)
        narrow = width <= tolerance * np.maximum(brackets.near, brackets.far)
        narrow |= (middle == brackets.near) | (middle == brackets.far)
        finished = finished.join(brackets.take(narrow))
        brackets, middle = brackets.take(~narrow), middle[~narrow]
        if not middle.size:
            break
        code, state = evaluate(brackets.row, middle, brackets.state)
        left, moved = code != brackets.code_near, code != brackets.code_far
        beyond = brackets.take(left)._replace(far=middle[left], code_far=code[left])
        ahead = brackets.take(moved)._replace(
            near=middle[moved], code_near=code[moved], state=state[moved]
        )
        brackets = beyond.join(ahead)
    return finished


class Window(NamedTuple):
    """An interval in which the code is one of those wanted."""

    # Ends of the window, the middles of brackets; NaN where it reaches an end of the scan
    lower: float
    upper: float
    # Widths of the brackets
    lower_bracket: float
    upper_bracket: float
    # Codes beyond the ends; None where the window reaches an end of the scan
    below: int | None
    above: int | None


def windows_of_row(codes: Codes, edges: Edges, row: int, wanted: Collection[int]) -> list[Window]:
    """Return the windows of one row in which the code is one of those wanted."""
    windows, outside = [], Window(np.nan, np.nan, np.nan, np.nan, None, None)
    code, window = int(codes[row, 0]), outside
    for i in np.flatnonzero(edges.row == row):
        middle, gap = float(0.5 * (edges.low[i] + edges.high[i])), edges.high[i] - edges.low[i]
        before, code = code, int(edges.code_high[i])
        if before in wanted and code not in wanted:
            windows.append(window._replace(upper=middle, upper_bracket=float(gap), above=code))
        elif before not in wanted and code in wanted:
            window = outside._replace(lower=middle, lower_bracket=float(gap), below=before)
    return [*windows, window] if code in wanted else windows
