"""Equations of lines of orbits and bifurcations, and Newton's method for them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.kernels.bifurcations import (
    CONDITIONS,
    Added,
    Cycle,
    correct,
    describe,
    put_values,
)
from vibrosweep.model.parameters import Dimensionless

__all__ = ["FIX_E"]

FIX_E, FIX_DRIVE = -3, -2  # instead of a condition of all points: the parameter that is fixed
NEWTON_STEPS: Final = 10  # from points so near that 4 suffice


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
        self, base: Any, problem: Dimensionless, cycle: Cycle, condition: int, z: Array
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

    def _matrix(self, z: Array, cycle: Cycle, *conditions: int | Held) -> Array:
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
