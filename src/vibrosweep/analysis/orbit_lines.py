"""Lines of orbits along one parameter, and curves of bifurcations along two."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from vibrosweep.analysis.closed_orbits import SEEDS, find_all
from vibrosweep.analysis.continuation import (
    AT_CORNER,
    AT_YIELDING,
    BEGUN,
    DOUBLED,
    LEFT,
    LOST,
    RETURNED,
    SPENT,
    TOUCHED,
    Line,
    follow,
    same_orbit,
)
from vibrosweep.analysis.line_equations import FIX_E, Equations
from vibrosweep.analysis.line_nodes import Mark, Nodes
from vibrosweep.arrays import Array
from vibrosweep.engine.workers import Workers
from vibrosweep.kernels.bifurcations import (
    BORN,
    CORNER,
    DOUBLING,
    GRAZE,
    LANDING,
    REST,
    SADDLE_NODE,
    YIELD,
    Cycle,
)
from vibrosweep.kernels.closed import ADMISSIBLE, Wanted
from vibrosweep.kernels.impact import base_of
from vibrosweep.model.forcing import AMPLITUDE, refuse_extreme
from vibrosweep.model.parameters import HIGH_BOUNCE, dimensionless, taken
from vibrosweep.model.restitution_laws import PLASTIC
from vibrosweep.model.shapes import PARABOLIC_NAME
from vibrosweep.scene.scene import Scene

__all__ = ["Plane"]

CORNER_PHASE: Final = 0.25  # the parabolic waveform has corners at plus and minus this phase
EVENTS: Final = (
    (SADDLE_NODE, "saddle_node"),
    (DOUBLING, "period_doubling"),
    (GRAZE, "grazing"),
    (REST, "rest"),
    (BORN, "born_at_doubling"),
    (CORNER, "corner"),
    (YIELD, "yielding"),
    (LANDING, "grazing_at_landing"),
)
ENDS: Final = (
    (LEFT, "border"),
    (RETURNED, "closed"),
    (DOUBLED, "born_at_doubling"),
    (TOUCHED, "touches_base"),
    (LOST, "lost"),
    (SPENT, "points_spent"),
    (BEGUN, "begins_at_doubling"),
    (AT_CORNER, "corner"),
    (AT_YIELDING, "yielding"),
)


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

    def _nodes(self, z: Array, p: int, q: int, condition: int) -> Nodes:
        """Return the nodes of lines through `z` along which `condition` holds."""
        cycle = Cycle(p, q, self.relative, self.corner, self.kink)
        equations = Equations(self.base, self.problem, cycle, condition, z)
        free = self.drives if condition == FIX_E else self.restitution
        column = p + (condition == FIX_E)
        ends = [0] * free.size
        ends[0], ends[-1] = 1, -1
        marks = [Mark(column, float(free[k]), end, k) for k, end in enumerate(ends)]
        if condition >= 0:
            borders = ((self.drives[0], 1), (self.drives[-1], -1))
            marks += [Mark(p + 1, float(value), end) for value, end in borders]
        return Nodes(equations, marks)

    def follow(self, z: Array, p: int, q: int, condition: int) -> Line:
        """Follow a line from a point in both directions; `condition` holds along it."""
        nodes = self._nodes(z, p, q, condition)
        return follow(nodes, z, nodes.equations.direction(z), self.points)

    def doubled(self, z: Array, p: int, q: int, condition: int) -> Line:
        """Follow the orbit of 2 p impacts that is born where one of p impacts doubles."""
        split = self._nodes(z, p, q, condition).equations.splitting(z)
        start = np.concatenate([z[:p], z[:p] + q, z[p:]])
        nodes = self._nodes(start, 2 * p, 2 * q, condition)
        return follow(nodes, start, split, self.points, born=True)


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
    size = max(e.size, drive.size)  # one of the two is fixed
    starts = plane.orbits(np.resize(e, size), np.resize(drive, size), wanted, workers)
    tasks = [Task(p, q, k, z) for k, found in enumerate(starts) for p, q, z in found]
    lines: list[Line] = []
    while tasks:
        task = min(tasks, key=lambda one: (one.p, one.parent < 0, one.q))
        tasks.remove(task)
        p, q = task.p, task.q
        if task.parent < 0:
            line = plane.follow(task.z, p, q, condition)
        elif _already_born(lines, task):
            continue
        else:
            line = plane.doubled(task.z, p // 2, q // 2, condition)
            line.parent = task.parent
        lines.append(line)
        if task.level < doublings:
            tasks += [
                Task(2 * p, 2 * q, -1, event.z, len(lines) - 1, task.level + 1)
                for event in line.events
                if event.kind == DOUBLING
            ]
        # at a fold a search may find one orbit twice
        first = [(task.k, task.z)] if task.parent < 0 else []
        for k, z in first + line.marks:
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


def curves_of(plane: Plane, lines: list[Line]) -> list[Line]:
    """Follow each bifurcation of the lines once, as a curve along both parameters.

    Each line is at one of the restitutions of the plane.
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
        curve = plane.follow(z, p, q, kind)
        curves.append(curve)
        for _, met in curve.marks:
            waiting = [
                one
                for one in waiting
                if one[:3] != (kind, p, q) or not same_orbit(one[3], met, p, q)
            ]
    return curves
