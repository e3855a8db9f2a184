"""Continuation of orbits along one parameter, and of their bifurcations along two.

The method is pseudo-arclength continuation, which passes folds, of the equations of
`vibrosweep.kernels.bifurcations`.  Three tests keep a step on its line: Newton's method must end
near the predicted point, the direction must change little, and the sign of the determinant must
stay, which differs on the other sheet of a fold.  If one fails, the step is halved.

Along a step each condition of an event is a function of the position, known with its slope at both
ends.  A change of sign encloses an event, which is accepted only inside its bracket.  Where the
slopes let a function come near 0 between two values of one sign, the step is divided there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.kernels.bifurcations import (
    BORN,
    CONDITIONS,
    CORNER,
    DOUBLING,
    FOLLOWED,
    GRAZE,
    LANDING,
    REST,
    SADDLE_NODE,
    YIELD,
    Added,
    OrbitType,
    correct,
    describe,
    put_values,
)
from vibrosweep.kernels.closed import SAME
from vibrosweep.model.parameters import Dimensionless

__all__ = ["AT_CORNER", "AT_YIELDING", "FIX_E", "Line"]

FIX_E, FIX_DRIVE = -3, -2  # instead of a condition of all points: the parameter that is fixed
NEWTON_STEPS: Final = 10  # from points so near that 4 suffice
# Ends of a line: border of the range, its own beginning, a period doubling from which it branches,
# a graze or a rest, no next point found, too many points; a line may begin at a doubling, and end
# at a corner of the waveform or at the kink of a law, where its direction jumps
LEFT, RETURNED, DOUBLED, TOUCHED, LOST, SPENT, BEGUN, AT_CORNER, AT_YIELDING = range(9)
PASSED: Final = (SADDLE_NODE, DOUBLING, CORNER, YIELD)
LONGEST_STEP: Final = 0.02  # in phases (turns) and parameters, times the root of the impacts
FIRST_STEP: Final = 1e-3
SHORT_STEP: Final = 1e-5  # on which the sign of the determinant may change: two lines cross
# Cosine of the angle between directions at neighbouring points, and distance of a point from its
# prediction relative to the step, where a landing passes a corner or kink
STRAIGHT: Final = 0.97
STRAIGHT_AT_KINK, NEAR_AT_KINK = 0.9, 0.4
TURNS: Final = 0.12  # angle to which steps are adapted
UNRESOLVED: Final = 0.4  # difference from its slopes, relative to its size, of a known condition
BEFORE: Final = 0.9  # share of the way to a birth, up to which other events are searched for
AT_END: Final = 1e-7  # an event as near as this to the end of a line is tried there
NEAR_SWITCH: Final = 1e-4  # largest distance of a corner or kink from the line that it ends
ENDING: Final = (GRAZE, REST, LANDING, BORN)  # no particle follows the orbit beyond
NEAR_PREDICTED: Final = 0.15  # distance of a point from its prediction, relative to the step
NEAR_ZERO: Final = 0.7  # least value of a condition, relative to those at both ends, worth a look
MOST_PARTS: Final = 24  # of a step
MOST_HALVINGS: Final = 60  # of a step, to find an event
SHORTEST_STEP: Final = 1e-7
ROUNDING: Final = 1e-11  # of a point, more than there is
VERTICAL: Final = 1e-9  # share of parameters in a direction, below which it is rounding
NEAR: Final = 100.0 * SAME  # largest distance of two points of one orbit


class Event(NamedTuple):
    """A bifurcation: its kind and its point."""

    kind: int
    z: Array


@dataclass
class Line:
    """A line of orbits or bifurcations; arrays of shape (point, ...), in order along the line."""

    p: int
    q: int
    z: Array
    trace: Array
    determinant: Array
    admissible: NDArray[np.int8]
    speed: Array
    events: list[Event]
    marks: list[tuple[int, Array]]  # values of the axis that it passes: index and point
    ends: tuple[int, int]  # reasons why the line ends, at its first and last point
    parent: int = -1  # index of the line from which it was born at a doubling
    kind: int = -1  # bifurcation whose points form the line; -1 for a line of orbits


def follow(nodes: Nodes, z: Array, along: Array, most: int, *, born: bool = False) -> Line:
    """Follow a line in both directions; or only ahead, if it is born at a doubling there.

    `most` is the largest number of points in each direction.  A line of orbits ends where no
    particle can follow its orbit.
    """
    ahead = _Side(nodes, z, along, most, born=born, first=True)
    if born or ahead.end == RETURNED:
        return _line(nodes, ahead, [], BEGUN if born else RETURNED)
    back = _Side(nodes, z, -along, most)
    return _line(nodes, ahead, [back], back.end)


def _line(nodes: Nodes, ahead: _Side, back: Sequence[_Side], end: int) -> Line:
    points, events, marks = ahead.points, ahead.events, ahead.marks
    for side in back:
        points = side.points[:0:-1] + points
        events, marks = side.events[::-1] + events, side.marks[::-1] + marks
    of_points = zip(*(nodes.equations.described(z) for z in points), strict=True)
    trace, determinant, admissible, speed = (np.array(values) for values in of_points)
    p, q = nodes.equations.cycle.p, nodes.equations.cycle.q
    return Line(
        p,
        q,
        np.array(points),
        trace,
        determinant,
        admissible.astype(np.int8),
        speed,
        events,
        marks,
        (end, ahead.end),
        kind=-1 if nodes.of_orbits else nodes.equations.condition,
    )


def same_orbit(one: Array, other: Array, p: int, q: int) -> bool:
    """Return whether two points belong to one orbit, possibly beginning with different impacts."""
    times = other[:p]
    for k in range(p):
        turned = np.concatenate([times[k:], times[:k] + q])
        off = turned - one[:p]
        if np.abs(off - np.rint(off[0])).max() < NEAR:
            return bool(np.abs(one[p:] - other[p:]).max() < NEAR)
    return False


class _Side:
    """One side of a line, from a point in one direction.

    `born` says whether the line is born there, at the doubling of an orbit of half its length, and
    `first` whether events at the point itself belong to this side.
    """

    def __init__(
        self,
        nodes: Nodes,
        z: Array,
        along: Array,
        most: int,
        *,
        born: bool = False,
        first: bool = False,
    ) -> None:
        self._nodes, self._most, cycle = nodes, most, nodes.equations.cycle
        self.points, self.end = [z], SPENT
        self.events: list[Event] = []
        self.marks: list[tuple[int, Array]] = []
        self._may_be_born = cycle.p % 2 == 0 and cycle.q % 2 == 0
        self._longest = LONGEST_STEP * float(np.sqrt(cycle.p))
        self._orientation = 0.0
        self._apart: Array | None = None
        with np.errstate(invalid="ignore"):  # conditions may be infinite or NaN
            node = nodes.node(z, along)
            near = np.abs(node.values) <= AT_END * np.abs(node.slopes)
            near[CONDITIONS:] = np.abs(node.values[CONDITIONS:]) < ROUNDING
            if first and not born:
                self._meet_at(node)
            node.values[near] = 0.0  # the slopes decide
            if born:  # at the doubling of one orbit, a multiplier of the other is 1
                node.values[SADDLE_NODE] = np.nan
            self._begin = node
            self._follow(node, born=born)

    def _follow(self, node: Node, *, born: bool) -> None:
        """Add points until the line ends."""
        step = FIRST_STEP
        self._measure(node, may_be_born=not born)
        while len(self.points) < self._most:
            advanced = self._advance(node, step)
            met = None if advanced is None else self._events(node, advanced[0])
            if advanced is None or met is None:
                step *= 0.5
                if step >= SHORTEST_STEP:
                    continue
                self._lose(node)
                return
            high, self._orientation = advanced
            if any(self._meet(k, z, high) for k, z in met):
                return
            angle = float(np.arccos(np.minimum(1.0, node.along @ high.along)))
            step = min(step * min(1.5, max(0.5, TURNS / max(angle, 1e-9))), self._longest)
            node = high
            self.points.append(node.z)
            self._measure(node)

    def _lose(self, node: Node) -> None:
        """End the line at a node with no next one: at a corner or kink next to it, if any."""
        self.end = LOST
        for kind, end in ((CORNER, AT_CORNER), (YIELD, AT_YIELDING)):
            at = self._nodes.polished(kind, node.z) if self._nodes.of_orbits else None
            if at is not None and np.abs(at - node.z).max() < NEAR_SWITCH:
                self.events.append(Event(kind, at))
                self.end = end
                return

    def _measure(self, node: Node, *, may_be_born: bool = True) -> None:
        """Prepare to notice where the orbit becomes one of half the length."""
        self._apart = None
        if self._may_be_born and may_be_born:
            apart = self._nodes.apart(node.z)
            self._apart = apart / np.linalg.norm(apart)
            measured = self._nodes.node(node.z, node.along, self._apart)
            node.values[BORN], node.slopes[BORN] = measured.values[BORN], measured.slopes[BORN]

    def _advance(self, node: Node, step: float) -> tuple[Node, float] | None:
        """Return the next point of the line, about one step away, and the sign of the determinant.

        None if the step is too long.
        """
        nodes = self._nodes
        guess = node.z + step * node.along
        done = nodes.equations.correct(guess, Held(node.along, guess))
        along = None if done is None else tangent(done[1])
        if done is None or along is None:
            return None
        cosine, off = node.along @ along, np.linalg.norm(done[0] - guess) / step
        if not (cosine > STRAIGHT_AT_KINK and off < NEAR_AT_KINK):
            return None
        high = nodes.node(done[0], along, self._apart)
        crossed = nodes.crossed(node, high)
        smooth = cosine > STRAIGHT and off < NEAR_PREDICTED
        if not (smooth or crossed[CORNER] or crossed[YIELD]):
            return None
        sign = float(np.linalg.slogdet(done[1])[0])
        if sign * self._orientation < 0.0 and not crossed[BORN] and step > SHORT_STEP:
            return None
        known = [DOUBLING] if vertical(node, high) else [SADDLE_NODE, DOUBLING]
        low, new = node.values[known], high.values[known]
        slopes = 0.5 * (node.slopes[known] + high.slopes[known])
        missed = np.abs(new - low - np.linalg.norm(high.z - node.z) * slopes)
        if step > SHORT_STEP and (missed > UNRESOLVED * np.maximum(abs(low), abs(new))).any():
            return None
        return high, sign

    def _events(self, low: Node, high: Node) -> list[tuple[int, Array]] | None:
        """Return the events of a step in their order, until one ends the line.

        None if the step is too long to tell.
        """
        nodes, born, found = self._nodes, None, []
        whole = high
        if nodes.crossed(low, high)[BORN]:
            born = nodes.locate(low, high, BORN, self._apart)
            if born is None or np.linalg.norm(nodes.apart(born)) > NEAR:
                return None
            share = float(np.linalg.norm(born - low.z) / np.linalg.norm(high.z - low.z))
            before = nodes.between(low, high, BEFORE * min(1.0, share), self._apart)
            if before is None:
                return None
            high = before
        parts = nodes.divided(low, high, self._apart)
        if parts is None:
            return None
        for one, other in pairwise(parts):
            crossed = nodes.crossed(one, other)
            crossed[[BORN, FOLLOWED]] = False
            for k in np.flatnonzero(crossed):
                at = nodes.locate(one, other, int(k), self._apart)
                if at is None:
                    return None
                found.append((int(k), at))
        if born is not None:
            found.append((BORN, born))
        found.sort(key=lambda event: (whole.z - low.z) @ event[1])
        ending = [i for i, (k, _) in enumerate(found) if nodes.ends[k]]
        if ending:
            return found[: ending[0] + 1]
        return found if not high.values[FOLLOWED] < 0.0 else self._unnoticed(low, high, found)

    def _unnoticed(
        self, low: Node, high: Node, found: list[tuple[int, Array]]
    ) -> list[tuple[int, Array]] | None:
        """Add where the orbit ceases to be one that a particle follows, if no condition says it."""
        at = self._nodes.locate(low, high, FOLLOWED, self._apart)
        if at is None:
            return None
        for kind in (LANDING, GRAZE, REST):
            near = self._nodes.polished(kind, at)
            if near is not None and np.abs(near - at).max() < NEAR:
                return [*found, (kind, near)]
        return [*found, (FOLLOWED, at)]

    def _meet(self, k: int, z: Array, high: Node) -> bool:
        """Note an event; return whether the line ends there."""
        self._add(z)
        if k < CONDITIONS:
            if k != FOLLOWED:
                self.events.append(Event(k, z))
            ends = {BORN: DOUBLED, FOLLOWED: LOST, GRAZE: TOUCHED, REST: TOUCHED, LANDING: TOUCHED}
            self.end = ends.get(k, SPENT)
            return k in ends
        mark = self._nodes.marks[k - CONDITIONS]
        for one in self._nodes.marks:  # a line may end at a border and at a value of the axis
            if one.of_axis >= 0 and abs(z[one.column] - one.value) < AT_END:
                self.marks.append((one.of_axis, z))
        if mark.ends:
            self.end = LEFT
            if np.abs(z - self._begin.z).max() > AT_END:
                self._meet_at(self._nodes.node(z, self._nodes.equations.direction(z)))
            return True
        begin, cycle = self._begin, self._nodes.equations.cycle
        if (
            begin.values[k] == 0.0
            and begin.slopes[k] * high.values[k] > 0.0
            and same_orbit(begin.z, z, cycle.p, cycle.q)
        ):
            self.end = RETURNED
        return self.end == RETURNED

    def _add(self, z: Array) -> None:
        if np.abs(z - self.points[-1]).max() > ROUNDING:
            self.points.append(z)

    def _meet_at(self, node: Node) -> None:
        """Note the events at the end of a line, where a change of sign would be rounding."""
        near = np.abs(node.values) <= AT_END * np.abs(node.slopes)
        for kind in PASSED:
            if not near[kind]:
                continue
            at = self._nodes.polished(kind, node.z)
            if at is None or np.abs(at - node.z).max() > NEAR or not self._nodes.holds(at):
                continue
            known = [event.z for event in self.events if event.kind == kind]
            if not any(np.abs(z - at).max() < AT_END for z in known):
                self.events.append(Event(kind, at))
                self._add(at)


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
    """Return whether a step changes no parameter, so that no fold can be recognised on it.

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


class Held(NamedTuple):
    """A linear condition: the product of `row` with the distance from a point is 0."""

    row: Array
    point: Array
    column: int = -1  # of the number that is held, if it is one


class Equations:
    """Equations of the orbits of a line, one fewer than a point has numbers.

    `condition` fixes a parameter at the value that it has in `z`, or is that of a bifurcation.
    """

    def __init__(
        self, base: Any, problem: Dimensionless, cycle: OrbitType, condition: int, z: Array
    ) -> None:
        self.cycle, self.condition = cycle, condition
        self._known = base, problem, cycle
        self.line = self.holding(self.fixed, z) if condition < 0 else condition

    @property
    def fixed(self) -> int:
        """Column of the parameter that is fixed."""
        return self.cycle.p + (self.condition == FIX_DRIVE)

    def holding(self, column: int, z: Array) -> Held:
        """Return the condition that a number keeps the value that it has in `z`."""
        return Held(np.eye(self.cycle.p + 2)[column], z.copy(), column)

    def correct(self, z: Array, last: int | Held) -> tuple[Array, Array] | None:
        """Correct a point to meet one more condition; return it and the matrix, or None."""
        z, conditions = z.copy(), (self.line, last)
        matrix = np.empty((z.size, z.size))
        if not correct(*self._known, z, self._added(conditions), NEWTON_STEPS, matrix):
            return None
        for held in conditions:
            if isinstance(held, Held) and held.column >= 0:
                z[held.column] = held.point[held.column]
        return z, matrix

    def _added(self, conditions: Sequence[int | Held]) -> Added:
        n, m = self.cycle.p + 2, len(conditions)
        added = Added(np.full(m, -1), np.zeros((m, n)), np.zeros((m, n)))
        for k, one in enumerate(conditions):
            if isinstance(one, Held):
                added.rows[k], added.points[k] = one.row, one.point
            else:
                added.kinds[k] = one
        return added

    def _matrix(self, z: Array, cycle: OrbitType, *conditions: int | Held) -> Array:
        """Return the derivatives of the equations of orbits and of some conditions."""
        base, problem, _ = self._known
        matrix = np.empty((cycle.p + len(conditions), cycle.p + 2))
        correct(base, problem, cycle, z.copy(), self._added(conditions), 0, matrix)
        return matrix

    def direction(self, z: Array) -> Array:
        """Return a direction of the line at a point, of either sign."""
        return np.asarray(np.linalg.svd(self._matrix(z, self.cycle, self.line))[2][-1])

    def values(self, z: Array, along: Array) -> tuple[Array, Array]:
        """Return the values of all conditions, and their derivatives in a direction."""
        values, slopes = np.empty(CONDITIONS), np.empty(CONDITIONS)
        put_values(*self._known, z.copy(), along, values, slopes)
        return values, slopes

    def described(self, z: Array) -> tuple[float, float, int, Array]:
        """Return trace, determinant and whether a particle can follow the orbit, and speeds."""
        speeds = np.empty(self.cycle.p)
        return (*describe(*self._known, z.copy(), speeds), speeds)

    def halved(self, z: Array) -> tuple[Equations, Array]:
        """Return the equations of orbits of half the length, and the one that is nearest."""
        p, q = self.cycle.p // 2, self.cycle.q // 2
        half = np.array([*(0.5 * (z[:p] + z[p:-2] - q)), *z[-2:]])
        base, problem, cycle = self._known
        return Equations(base, problem, cycle._replace(p=p, q=q), self.condition, half), half

    def splitting(self, z: Array) -> Array:
        """Return the direction in which the orbit of twice the length branches off."""
        p, q = self.cycle.p, self.cycle.q
        doubled = np.array([*z[:p], *(z[:p] + q), *z[p:]])
        matrix = self._matrix(doubled, self.cycle._replace(p=2 * p, q=2 * q))
        # the displacement changes its sign from one cycle to the next
        split = np.linalg.svd(matrix[:p, :p] - matrix[:p, p : 2 * p])[2][-1]
        return np.asarray(np.array([*split, *-split, 0.0, 0.0]) / np.sqrt(2.0))
