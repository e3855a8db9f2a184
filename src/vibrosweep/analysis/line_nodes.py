"""Points along a step of a line, and the events between them.

Each condition of an event is a function of the position, known with its slope at every node.  A
change of sign between two nodes encloses an event, which is accepted only inside its bracket.
Where the slopes let a function come near 0 between two values of one sign, a node is put there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.analysis.line_equations import Equations, Held
from vibrosweep.arrays import Array
from vibrosweep.kernels.bifurcations import (
    BORN,
    CONDITIONS,
    DOUBLING,
    FOLLOWED,
    GRAZE,
    LANDING,
    REST,
    SADDLE_NODE,
)
from vibrosweep.kernels.closed import SAME

ENDING: Final = (GRAZE, REST, LANDING, BORN)  # no particle follows the orbit beyond
NEAR_PREDICTED: Final = 0.15  # distance of a point from its prediction, relative to the step
NEAR_ZERO: Final = 0.7  # least value of a condition, relative to those at both ends, worth a look
MOST_PARTS: Final = 24  # of a step
MOST_HALVINGS: Final = 60  # of a step, to find an event
SHORTEST_STEP: Final = 1e-7
ROUNDING: Final = 1e-11  # of a point, more than there is
VERTICAL: Final = 1e-9  # share of parameters in a direction, below which it is rounding
NEAR: Final = 100.0 * SAME  # largest distance of two points of one orbit


class Mark(NamedTuple):
    """A value of a parameter that lines pass, or at which they end."""

    column: int  # of the parameter, in a point
    value: float
    ends: int  # 1, or -1: lines end there, above and below it; 0: they pass
    of_axis: int = -1  # index among the values of the axis


class Node(NamedTuple):
    """A point of a line."""

    z: Array
    along: Array  # direction
    values: Array  # of conditions and marks
    slopes: Array  # their derivatives along the line


class Nodes:
    """Nodes of lines through the points that meet some equations.

    `marks` are values of parameters to be noted or to end at.  On lines of orbits there are events.
    """

    def __init__(self, equations: Equations, marks: Sequence[Mark]) -> None:
        self.equations, self.marks = equations, marks
        self.of_orbits = equations.condition < 0
        self._columns = np.array([mark.column for mark in marks])
        self._levels = np.array([mark.value for mark in marks])
        self._inside = np.array([*[0] * CONDITIONS, *(mark.ends for mark in marks)])
        self.ends = self._inside != 0
        self.ends[[*ENDING]] = True

    def node(self, z: Array, along: Array, apart: Array | None = None) -> Node:
        """Return a point with the values of all conditions.

        `apart` is the direction in which an orbit differs from itself half a cycle later.
        """
        values, slopes = np.full((2, CONDITIONS), np.nan)
        if self.of_orbits:
            values, slopes = self.equations.values(z, along)
        if apart is not None:
            values[BORN], slopes[BORN] = apart @ self.apart(z), apart @ self._parting(along)
        marks, turned = z[self._columns] - self._levels, along[self._columns]
        return Node(z, along, np.append(values, marks), np.append(slopes, turned))

    def apart(self, z: Array) -> Array:
        """Return how far an orbit differs from itself half a cycle later."""
        return np.asarray(self._parting(z) - 0.5 * self.equations.cycle.q)

    def _parting(self, z: Array) -> Array:
        half = self.equations.cycle.p // 2
        return np.asarray(z[half : 2 * half] - z[:half])

    def holds(self, z: Array) -> bool:
        """Return whether a point is inside the range, but for rounding."""
        off = self._inside[CONDITIONS:] * (z[self._columns] - self._levels)
        return bool((off > -ROUNDING).all())

    def _begins(self, node: Node) -> Array:
        """Signs of all conditions just after a node."""
        slopes = np.where(self._inside != 0, self._inside, node.slopes)
        return np.asarray(np.sign(np.where(node.values == 0.0, slopes, node.values)))

    def crossed(self, low: Node, high: Node) -> NDArray[np.bool_]:
        """Return which conditions change their sign between two nodes, or are 0 at the second."""
        begins, ends = self._begins(low), np.sign(high.values)
        crossed = np.asarray((begins * ends < 0.0) | ((ends == 0.0) & (low.values != 0.0)))
        crossed[SADDLE_NODE] &= not vertical(low, high)
        return crossed

    def dip(self, low: Node, high: Node) -> float:
        """Return where a condition may come near 0 between two nodes, as a share; 0 if none may."""
        begins, length = self._begins(low), np.linalg.norm(high.z - low.z)
        a, b = begins * low.values, begins * high.values
        falls, rises = begins * low.slopes * length, begins * high.slopes * length
        dips = (falls < 0.0) & (rises > 0.0) & (b > 0.0) & (a < np.inf)
        dips[SADDLE_NODE] &= not vertical(low, high)
        for k in np.flatnonzero(dips):
            # the cubic has one minimum
            fall, gain = falls[k], b[k] - a[k]
            c2, c3 = 3.0 * gain - 2.0 * fall - rises[k], fall + rises[k] - 2.0 * gain
            share = -fall / (c2 + np.sqrt(c2 * c2 - 3.0 * c3 * fall))
            least = a[k] + share * (fall + share * (c2 + share * c3))
            if least < NEAR_ZERO * min(a[k], b[k]):
                return float(np.clip(share, 0.1, 0.9))
        return 0.0

    def polished(self, k: int, z: Array) -> Array | None:
        """Return the event of a condition or mark to which Newton's method leads, if any."""
        if k >= CONDITIONS:
            mark = self.marks[k - CONDITIONS]
            z = z.copy()
            z[mark.column] = mark.value
            done = self.equations.correct(z, self.equations.holding(mark.column, z))
        elif k == FOLLOWED or (k == BORN and not self.of_orbits):
            return None
        elif k == BORN:
            half, guess = self.equations.halved(z)
            done = half.correct(guess, DOUBLING)
            if done is not None:
                times = done[0][:-2]
                return np.array([*times, *(times + half.cycle.q), *done[0][-2:]])
        else:
            done = self.equations.correct(z, k)
        return None if done is None else done[0]

    def between(self, low: Node, high: Node, share: float, apart: Array | None) -> Node | None:
        """Return a node of the line between two others."""
        guess, chord = _between(low, high, share), high.z - low.z
        length = float(np.linalg.norm(chord))
        done = self.equations.correct(guess, Held(chord / length, guess))
        if done is None or np.linalg.norm(done[0] - guess) > NEAR_PREDICTED * length + ROUNDING:
            return None
        along = tangent(done[1])
        return None if along is None else self.node(done[0], along, apart)

    def divided(self, low: Node, high: Node, apart: Array | None) -> list[Node] | None:
        """Return nodes from one to another, between which no condition changes its sign twice."""
        nodes, i = [low, high], 0
        while i < len(nodes) - 1:
            share = self.dip(nodes[i], nodes[i + 1]) if len(nodes) < MOST_PARTS else 0.0
            if not share or np.linalg.norm(nodes[i + 1].z - nodes[i].z) < SHORTEST_STEP:
                i += 1
                continue
            middle = self.between(nodes[i], nodes[i + 1], share, apart)
            if middle is None:
                return None
            nodes.insert(i + 1, middle)
        return nodes

    def locate(self, low: Node, high: Node, k: int, apart: Array | None) -> Array | None:
        """Return the event of a condition or mark in a step over which its sign changes."""
        chord, begins = high.z - low.z, self._begins(low)[k]
        width = float(np.linalg.norm(chord))
        chord /= width
        for turn in range(MOST_HALVINGS):
            a, b = low.values[k], high.values[k]
            share = a / (a - b) if turn % 2 == 0 and a != b and np.isfinite(a - b) else 0.5
            guess = _between(low, high, share)
            found = self.polished(k, guess)
            if found is not None and np.linalg.norm(found - guess) <= width + ROUNDING:
                inside = chord @ (found - low.z), chord @ (high.z - found)
                if min(inside) >= -ROUNDING:
                    return found
            middle = self.between(low, high, 0.5 if turn else np.clip(share, 0.1, 0.9), apart)
            if middle is None:
                break
            if np.sign(middle.values[k]) == begins:
                low = middle
            else:
                high = middle
            width = float(np.linalg.norm(high.z - low.z))
            if width < ROUNDING:
                break
        return low.z if width < NEAR else None


def vertical(low: Node, high: Node) -> bool:
    """Return whether a step changes no parameter, so that no fold can be told on it.

    Where the equations of two landings are linear, as over a base of constant acceleration, all
    orbits that are born at a period doubling exist at one value of the parameter.
    """
    return bool(max(np.abs([low.along[-2:], high.along[-2:]]).flat) < VERTICAL)


def tangent(matrix: Array) -> Array | None:
    """Return the direction of a line from the matrix of equations whose last row is linear."""
    try:
        along = np.linalg.solve(matrix, np.eye(matrix.shape[0])[-1])
    except np.linalg.LinAlgError:
        return None
    return np.asarray(along / np.linalg.norm(along))


def _between(low: Node, high: Node, share: float) -> Array:
    """Point of the cubic curve through two nodes, in their directions."""
    rest, length = 1.0 - share, np.linalg.norm(high.z - low.z)
    turned = rest * low.along - share * high.along
    first, last = rest * rest * (1.0 + 2.0 * share), share * share * (1.0 + 2.0 * rest)
    return np.asarray(first * low.z + last * high.z + share * rest * length * turned)
