"""Forced parabolic motion of a base on a mount, from one corner of its velocity to the next.

The acceleration Yf'' of the bare base is 4 alpha or -4 alpha; under a load the base oscillates
about a level that is (mass - 1) Yf'' / w^2 lower.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from vibrosweep.kernels._jit import fma, implements, jit
from vibrosweep.kernels.bases.chained import CORNER, TOP, stretch_at
from vibrosweep.kernels.bases.drives import (
    Motion,
    Phase,
    Place,
    Reach,
    forced,
    forcing,
    forcing_oscillations,
    onto,
    place,
    reach_of,
    side_at,
    side_of,
    until_corner,
)
from vibrosweep.kernels.waveforms import Parabolic, Shape


class Parabola(NamedTuple):
    """One stretch of the parabolic motion, from one corner of the velocity to the next."""

    alpha: float
    side: float  # 1 where the base is accelerated upwards, around phase 0; -1 in the other half
    sag: float  # under the load, due to the acceleration of the drive


@implements(side_at, Parabolic)
def side_at_parabolic(shape: Shape, x: float) -> float:
    return stretch_at(x)[0]


@implements(side_of, Parabola)
def side_of_parabola(drive: Parabola) -> float:
    return drive.side


@jit
def _from_middle(drive: Parabola, x: float) -> float:
    """Phase relative to the middle of the present stretch."""
    return x if drive.side > 0.0 else x - math.copysign(0.5, x)


@implements(until_corner, Parabola)
def until_corner_parabola(drive: Parabola, x: float) -> float:
    left = CORNER - _from_middle(drive, x)
    return left if left > 0.0 else 0.0


@implements(forced, Parabolic)
def forced_parabolic(
    shape: Shape, alpha: float, w: float, zeta: float, mass: float, side: float
) -> Parabola:
    return Parabola(alpha, side, 4.0 * alpha * side * (mass - 1.0) / (w * w))


@implements(place, Parabola)
def place_parabola(drive: Parabola, at: Phase) -> Place:
    y, pull = _from_middle(drive, at.x), 4.0 * drive.alpha * drive.side
    height = drive.alpha * drive.side * fma(2.0 * y, y, -TOP)
    return Place(height - drive.sag, pull * y, pull, 0.0)


@implements(reach_of, Parabola)
def reach_of_parabola(drive: Parabola) -> Reach:
    return Reach(drive.alpha * TOP + abs(drive.sag), 4.0 * drive.alpha, 0.0, 0.0)


@implements(onto, Parabola)
def onto_parabola(drive: Parabola, at: Phase, s: float, free: Motion) -> Motion:
    pull = 4.0 * drive.alpha * drive.side
    rise, gain = fma(0.5 * pull * s, s, free.rise), fma(pull, s, free.gain)
    return Motion(rise, gain, free.d, free.b, free.pull + pull, free.jerk)


implements(forcing, Parabola)(forcing_oscillations)
