"""The impact of each cycle after which the flight is shortest."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, Integers, jit, uncounted
from vibrosweep.kernels.bases import Base, constants
from vibrosweep.kernels.impact import impact
from vibrosweep.kernels.settle import SAME_ORBIT
from vibrosweep.kernels.unwritten import empty
from vibrosweep.model.parameters import Dimensionless


class Shortest(NamedTuple):
    """The impact before the shortest flight of each cycle; every array has shape (cycle,)."""

    landed: Floats  # phase of the landing, turns
    left: Floats  # phase of the lift-off, turns: another one after a rest
    speed: Floats  # at lift-off, relative to the base, in units of g / (2 f)


def empty_shortest(cycles: int) -> Shortest:
    """Allocate the impacts of a batch of cycles."""
    return empty(Shortest, cycles)


@jit
def _plain(x: float) -> float:
    """Phase with -1/2 turned into 1/2, which is the same."""
    return x + 1.0 if x < SAME_ORBIT - 0.5 else x


@uncounted
def shortest_flights(
    first: int,
    last: int,
    base: Base,
    problem: Dimensionless,
    phase: Floats,
    speed: Floats,
    impacts: Integers,
    out: Shortest,
) -> None:
    """Find the shortest flight of cycles first ... last - 1; of equal ones, the one first in phase.

    Phase and speed relative to the base are those of a lift-off on the cycle, `impacts` its length;
    all arrays, those of the problem too, have shape (cycle,).
    """
    for i in range(first, last):
        out.landed[i] = out.left[i] = out.speed[i] = np.nan
        fixed = constants(base, problem, i)
        hit = impact(fixed, 0.0, phase[i], speed[i])
        for _ in range(impacts[i] - 1):
            hit = impact(fixed, 0.0, hit.x_off, hit.u)
        x, u = phase[i], speed[i]
        landed = x if hit.leaves else hit.x
        shortest = np.inf
        for _ in range(impacts[i]):
            hit = impact(fixed, 0.0, x, u)
            longer = hit.flight.time - shortest
            if longer < -SAME_ORBIT or (longer <= SAME_ORBIT and x < out.left[i] - SAME_ORBIT):
                shortest = hit.flight.time
                out.landed[i], out.left[i], out.speed[i] = _plain(landed), _plain(x), u
            landed, x, u = hit.x, hit.x_off, hit.u
