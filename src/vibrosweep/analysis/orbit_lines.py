"""Lines of orbits along one parameter, and curves of bifurcations along two."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.analysis.closed_orbits import SEEDS, find_all
from vibrosweep.arrays import Array
from vibrosweep.engine.workers import Workers
from vibrosweep.kernels.closed import ADMISSIBLE, SAME
from vibrosweep.kernels.continuation import BORN, LEFT, LOST, RETURNED, TOUCHED, follow_line
from vibrosweep.kernels.continuation import DOUBLED as AT_DOUBLING
from vibrosweep.kernels.continuation import SPENT as OUT_OF_POINTS
from vibrosweep.kernels.extended import (
    CORNER,
    DOUBLING,
    FIX_DRIVE,
    FIX_E,
    GRAZE,
    REST,
    SADDLE_NODE,
    YIELD,
    Range,
    correct_point,
    directions,
    splitting,
)
from vibrosweep.kernels.impact import base_of
from vibrosweep.kernels.orbit_points import empty_line, written
from vibrosweep.kernels.orbit_search import Wanted
from vibrosweep.model.forcing import AMPLITUDE, refuse_extreme
from vibrosweep.model.parameters import HIGH_BOUNCE, dimensionless, taken
from vibrosweep.model.restitution_laws import PLASTIC
from vibrosweep.model.shapes import PARABOLIC_NAME
from vibrosweep.scene.scene import Scene

BEGUN, AT_CORNER, AT_YIELDING = range(OUT_OF_POINTS + 1, OUT_OF_POINTS + 4)
CORNER_PHASE: Final = 0.25  # the parabolic waveform has corners at plus and minus this phase
NEAR_SWITCH: Final = 1e-3  # largest distance of a corner or kink from the line that it ends
NEAR: Final = 100.0 * SAME  # largest distance of two points of one orbit
EVENTS: Final = (
    (SADDLE_NODE, "saddle_node"),
    (DOUBLING, "period_doubling"),
    (GRAZE, "grazing"),
    (REST, "rest"),
    (BORN, "born_at_doubling"),
    (CORNER, "corner"),
    (YIELD, "yielding"),
)
ENDS: Final = (
    (LEFT, "border"),
    (RETURNED, "closed"),
    (AT_DOUBLING, "born_at_doubling"),
    (TOUCHED, "touches_base"),
    (LOST, "lost"),
    (OUT_OF_POINTS, "points_spent"),
    (BEGUN, "begins_at_doubling"),
    (AT_CORNER, "corner"),
    (AT_YIELDING, "yielding"),
)
LONGEST_STEP: Final = 0.02  # in phases (turns) and parameters


class Event(NamedTuple):
    """A bifurcation: its kind, and the point, as in `vibrosweep.kernels.continuation`."""

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
    ends: tuple[int, int]  # reasons why the line ends, at its first and last point
    parent: int = -1  # index of the line from which it was born at a doubling
    kind: int = -1  # bifurcation whose points form the line; -1 for a line of orbits


class Plane:
    """A rectangle of restitution and forcing in which lines are followed.

    Parameters
    ----------
    scene
        Scene of the orbits.
    forcing
        Name of the forcing.
    restitution, values
        Ascending values of the restitution and the forcing; their ends are the borders.
    points
        Most points of a line in each direction.
    """

    def __init__(
        self, scene: Scene, forcing: str, restitution: Array, values: Array, points: int
    ) -> None:
        self.forcing, self.points = forcing, points
        self.relative = forcing != AMPLITUDE
        top = {"restitution": restitution[-1:], forcing: values[-1:]}
        refuse_extreme(scene.quantities(top), forcing, scene.restitution_law)
        unit = {"restitution": np.array([0.0]), forcing: np.array([1.0])}
        self.problem = dimensionless(scene.parameters(unit), scene.duration)
        self.scale = float(self.problem.kick[0])  # drive of a forcing of 1
        self.base: Any = base_of(*scene.mechanics)
        self.corner = CORNER_PHASE if scene.waveform.name == PARABOLIC_NAME else math.inf
        plastic = scene.restitution_law == PLASTIC
        self.kink = float(self.problem.restitution_speed[0]) if plastic else math.inf
        self.balances = scene.base == HIGH_BOUNCE and scene.rebound == "rest"
        self.restitution, self.drives = restitution, values * self.scale

    def span(self, p: int, q: int, condition: int) -> Range:
        """Return the range of a line along which `condition` holds."""
        e, drive = self.restitution, self.drives
        longest = LONGEST_STEP * float(np.sqrt(p))
        borders = (float(e[0]), float(e[-1]), float(drive[0]), float(drive[-1]))
        return Range(p, q, condition, self.relative, *borders, longest, self.corner, self.kink)

    def orbits(
        self, e: Array, drive: Array, wanted: tuple[int, int], workers: Workers
    ) -> list[list[tuple[int, int, Array]]]:
        """Return p, q and the point of each admissible orbit, a list for each pair (e, drive)."""
        kick = drive * (1.0 + e) if self.relative else drive
        problem = taken(self.problem, np.zeros(e.size, np.int64))
        problem = problem._replace(restitution=np.array(e), kick=np.array(kick))
        found = find_all(self.base, problem, Wanted(*wanted, SEEDS, self.balances), workers)
        return [
            [
                (int(p), int(q), np.array([*found.times[i, k, :p], e[i], drive[i]]))
                for k, (p, q) in enumerate(zip(found.impacts[i], found.periods[i], strict=True))
                if p > 0 and found.admissible[i, k] == ADMISSIBLE
            ]
            for i in range(e.size)
        ]

    def corrected(self, z: Array, span: Range, condition: int) -> bool:
        """Correct `z` to where a line meets `condition`, in place; return whether it converges."""
        return bool(correct_point(self.base, self.problem, span, z, condition))

    def follow(self, z: Array, span: Range, along: Array | None = None) -> Line:
        """Follow a line from a point in both directions, or only in the direction `along`."""
        both = along is None
        if along is None:
            along = np.zeros(span.p + 2)
            along[span.p if span.condition == FIX_DRIVE else span.p + 1] = 1.0
            if not directions(self.base, self.problem, span, z, along):
                along = np.ones(span.p + 2)  # at a fold the parameter does not change
                along[span.p + (span.condition == FIX_DRIVE)] = 0.0
                directions(self.base, self.problem, span, z, along)
        ahead = self._one_side(z, span, along)
        if not both or ahead.ends[1] == RETURNED:
            return ahead
        back = self._one_side(z, span, -along)
        return Line(
            p=span.p,
            q=span.q,
            z=np.concatenate([back.z[:0:-1], ahead.z]),
            trace=np.concatenate([back.trace[:0:-1], ahead.trace]),
            determinant=np.concatenate([back.determinant[:0:-1], ahead.determinant]),
            admissible=np.concatenate([back.admissible[:0:-1], ahead.admissible]),
            speed=np.concatenate([back.speed[:0:-1], ahead.speed]),
            events=[*back.events[::-1], *ahead.events],
            ends=(back.ends[1], ahead.ends[1]),
        )

    def _one_side(self, z: Array, span: Range, along: Array) -> Line:
        out = empty_line(self.points, span.p)
        follow_line(self.base, self.problem, span, z, along, out)
        out, end = written(out), int(out.ends[2])
        events = [Event(int(kind), at) for kind, at in zip(out.kind, out.at, strict=True)]
        if end == LOST and (switch := self._switch(out.z[-1], span)):
            events.append(switch)
            end = AT_CORNER if switch.kind == CORNER else AT_YIELDING
        points = (out.z, out.trace, out.determinant, out.admissible, out.speed)
        return Line(span.p, span.q, *points, events, (end, end))

    def _switch(self, z: Array, span: Range) -> Event | None:
        """Return the corner of the waveform, or kink of the law, where a line was lost, if any."""
        for kind in (CORNER, YIELD):
            at = z.copy()
            if self.corrected(at, span, kind) and np.abs(at - z).max() < NEAR_SWITCH:
                return Event(kind, at)
        return None

    def doubled(self, z: Array, p: int, q: int, condition: int) -> Line | None:
        """Follow the orbit of 2 p impacts that is born where one of p impacts doubles."""
        split = np.empty(2 * p + 2)
        span = self.span(2 * p, 2 * q, condition)
        if not splitting(self.base, self.problem, self.span(p, q, condition), z, split):
            return None
        start = np.concatenate([z[:p], z[:p] + q, z[p:]])
        line = self.follow(start, span, split)
        line.ends = (BEGUN, line.ends[1])
        return line

    def crossings(self, line: Line, condition: int, at: Array) -> Iterator[tuple[int, Array]]:
        """Yield the index of each value in `at` that a line crosses, and the point there.

        `condition` fixes the parameter whose values these are.
        """
        c = line.p if condition == FIX_E else line.p + 1
        span = self.span(line.p, line.q, line.kind if line.kind >= 0 else _other(condition))
        values = line.z[:, c]
        for k, value in enumerate(at):
            side = values - value
            for i in np.flatnonzero((side[:-1] == 0.0) | (side[:-1] * side[1:] < 0.0)):
                share = side[i] / (side[i] - side[i + 1]) if side[i] else 0.0
                z = line.z[i] + share * (line.z[i + 1] - line.z[i])
                z[c] = value
                if self.corrected(z, span, condition):
                    yield k, z
            if side[-1] == 0.0:
                yield k, line.z[-1].copy()


def _other(condition: int) -> int:
    return FIX_DRIVE if condition == FIX_E else FIX_E


def same_orbit(one: Array, other: Array, p: int, q: int) -> bool:
    """Return whether two points belong to one orbit, possibly beginning with different impacts."""
    times = other[:p]
    for k in range(p):
        turned = np.concatenate([times[k:], times[:k] + q])
        off = turned - one[:p]
        if np.abs(off - np.rint(off[0])).max() < NEAR:
            return bool(np.abs(one[p:] - other[p:]).max() < NEAR)
    return False


@dataclass(eq=False)
class Task:
    """A line to be followed: from an orbit at one of the values, or from a doubling."""

    p: int
    q: int
    k: int  # index of the value, -1 for a doubling
    z: Array
    parent: int = -1  # index of the line that doubles
    level: int = 0  # number of doublings before

    def is_at(self, p: int, q: int, k: int, z: Array) -> bool:
        """Return whether the line begins at this orbit."""
        return (self.p, self.q, self.k) == (p, q, k) and same_orbit(self.z, z, p, q)


def branches_along(
    plane: Plane, condition: int, wanted: tuple[int, int], doublings: int, workers: Workers
) -> list[Line]:
    """Follow all orbits of up to the `wanted` impacts and periods along a parameter.

    `condition` fixes the other parameter; orbits are searched at the values of the free one.
    Among orbits of equally many impacts, those born at doublings are followed first.
    """
    e, drive = plane.restitution, plane.drives
    free = drive if condition == FIX_E else e
    starts = plane.orbits(np.resize(e, free.size), np.resize(drive, free.size), wanted, workers)
    tasks = [Task(p, q, k, z) for k, found in enumerate(starts) for p, q, z in found]
    lines: list[Line] = []
    while tasks:
        task = min(tasks, key=lambda one: (one.p, one.parent < 0, one.q))
        tasks.remove(task)
        p, q = task.p, task.q
        line: Line | None
        if task.parent < 0:
            line = plane.follow(task.z, plane.span(p, q, condition))
        elif _already_born(lines, task):
            continue
        else:
            line = plane.doubled(task.z, p // 2, q // 2, condition)
            if line is None:
                continue
            line.parent = task.parent
        lines.append(line)
        if task.level < doublings:
            tasks += [
                Task(2 * p, 2 * q, -1, event.z, len(lines) - 1, task.level + 1)
                for event in line.events
                if event.kind == DOUBLING
            ]
        if p <= wanted[0] and q <= wanted[1]:
            for k, z in plane.crossings(line, _other(condition), free):
                tasks = [one for one in tasks if not one.is_at(p, q, k, z)]
    return lines


def _already_born(lines: list[Line], task: Task) -> bool:
    """Return whether the line that begins at a doubling was followed before, from its other end."""
    p, q = task.p // 2, task.q // 2
    return any(
        event.kind == BORN and same_orbit(event.z[[*range(p), -2, -1]], task.z, p, q)
        for line in lines
        if (line.p, line.q) == (task.p, task.q)
        for event in line.events
    )


def curves_of(plane: Plane, lines: list[Line], values: Array) -> list[Line]:
    """Follow each bifurcation of the lines once, as a curve along both parameters.

    Each line is at one of the `values` of the restitution.
    """
    waiting = [
        (event.kind, line.p, line.q, event.z)
        for line in lines
        for event in line.events
        if event.kind != BORN
    ]
    curves: list[Line] = []
    while waiting:
        kind, p, q, z = waiting.pop(0)
        curve = plane.follow(z, plane.span(p, q, kind))
        curve.kind = kind
        curves.append(curve)
        for _, met in plane.crossings(curve, FIX_E, values):
            waiting = [
                one
                for one in waiting
                if one[:3] != (kind, p, q) or not same_orbit(one[3], met, p, q)
            ]
    return curves
