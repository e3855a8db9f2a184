"""Trajectories that are one trajectory, watched for different times, followed once.

A lane follows the one that is watched for the shortest time; where that ends, it goes back to the
last impact at which it was looked at and goes on as the next one.  All see the impacts, the looks
and the roundings that they would have seen alone.
"""

from __future__ import annotations

from typing import NamedTuple

from vibrosweep.kernels._jit import Floats, Integers, jit
from vibrosweep.kernels.lanes import (
    AFTER_MOVING,
    DONE,
    ENDED,
    FIRST_MOVING,
    LANE,
    N_ANCHOR,
    N_BEGIN,
    SAVED,
    SPENT,
    STRIDE,
    U_ANCHOR,
    X_ANCHOR,
    X_BEGIN,
    X_END,
    N,
    U,
    X,
)
from vibrosweep.scene import Dimensionless

__all__ = ["Shared", "become", "save"]


class Shared(NamedTuple):
    """Which trajectories of a batch are one.

    Attributes
    ----------
    first
        Shape (orbit,): of those that are one trajectory, the one watched for the shortest time.
    after
        Shape (trajectory,): the one watched for the next longer time, or -1.
    periods
        Shape (trajectory,): whole periods from the launch's to the end's.
    """

    first: Integers
    after: Integers
    periods: Floats


@jit
def save(s: Floats, lanes: int) -> None:
    """Keep the state of all lanes that have not ended, to come back to it.

    A state that has returned to its anchor is kept for good: from there each of the trajectories
    passes over its own number of cycles.
    """
    for j in range(lanes):
        returned = (s[SAVED + X + j] == s[SAVED + X_ANCHOR + j]) & (
            s[SAVED + U + j] == s[SAVED + U_ANCHOR + j]
        )
        returned &= s[SAVED + N + j] > s[SAVED + N_ANCHOR + j]  # not the anchor itself
        kept = returned | (s[DONE + j] == ENDED) | (s[DONE + j] == SPENT)
        for row in range(FIRST_MOVING, AFTER_MOVING):
            place = row * STRIDE + j
            s[SAVED + place] = s[SAVED + place] if kept else s[place]


@jit
def become(
    s: Floats, j: int, after: int, problem: Dimensionless, particles: int, shared: Shared
) -> None:
    """Go back with lane j to the state that was kept, as the trajectory watched for longer."""
    later = shared.periods[int(s[LANE + j])] - shared.periods[after]
    s[SAVED + N + j] += later
    s[SAVED + N_ANCHOR + j] += later
    for row in range(FIRST_MOVING, AFTER_MOVING):
        s[row * STRIDE + j] = s[SAVED + row * STRIDE + j]
    i = after // particles
    s[X_END + j] = problem.end_phase[i]
    s[N_BEGIN + j] = problem.begin_count[i] - problem.end_count[i]
    s[X_BEGIN + j] = problem.begin_phase[i]
    s[LANE + j] = after
