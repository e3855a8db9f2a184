"""The references of the bases, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from vibrosweep.proof.reference import high_bounce, moving
from vibrosweep.proof.reference.laws import Laws
from vibrosweep.proof.reference.motion import Motion, PeriodMap, Problem
from vibrosweep.proof.reference.waves import wave_of


class Reference(NamedTuple):
    """Reference of a base: its motion, its map and its errors in doubles."""

    motion: Callable[[Problem], Motion]  # of a particle, from a problem
    # Impacts in forcing periods, from physical parameters and the laws of an impact
    period_map: Callable[[Mapping[str, float], Laws], PeriodMap]
    # Velocity of a sine at least as fast, high and steep as the base's motion, m s-1, from physical
    # parameters
    velocity: Callable[[Mapping[str, float], Laws], float]
    # Largest error in turns of a lift-off after a rest in doubles, from physical parameters
    liftoff_error: Callable[[Mapping[str, float], Laws], float]


def _over_moving_base(problem: Problem) -> Motion:
    """Motion over the moving base; a base of amplitude 0 is fixed, so that ties are decided."""
    still = problem.parameters["amplitude"] == 0.0 and problem.deviates is None
    return high_bounce.Motion(problem) if still else moving.Motion(problem)


def _velocity(parameters: Mapping[str, float], laws: Laws) -> float:
    size = wave_of(laws.waveform).bounds.size
    return size * parameters["amplitude"] / (1.0 + parameters["restitution"])


REFERENCE_OF: Final[Mapping[str, Reference]] = {
    "high-bounce": Reference(
        motion=high_bounce.Motion,
        period_map=high_bounce.PeriodMap.from_parameters,
        velocity=lambda parameters, laws: 0.0,
        liftoff_error=high_bounce.liftoff_error,
    ),
    "moving": Reference(
        motion=_over_moving_base,
        period_map=moving.MovingMap.from_parameters,
        velocity=_velocity,
        liftoff_error=moving.liftoff_error,
    ),
}
