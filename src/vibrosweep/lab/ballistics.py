"""Flights through air: the drag grows with the square of the speed.

A flight begins and ends at the same level.  `gravity` is its acceleration at rest, `drag` is 1/v^2
of the terminal speed v; it may be negative, as the estimate of a drag that is near zero may be.
All formulas are exact.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from vibrosweep.arrays import Array

LEAST_DRAG: Final = 1e-7  # s2 m-2 at a speed of 1: below, differences of nearly equal numbers
AIR: Final = 1.2  # density, kg m-3
# Drag coefficient of a smooth ball at 1e3 < Re < 2e5, and its relative standard deviation
COEFFICIENT: Final = (0.47, 0.2)


def drag_of_ball(mass: float, diameter: float) -> tuple[float, float]:
    """Return the drag (s2 m-2) of a ball of this mass (kg) and diameter (m), and its error."""
    value, spread = COEFFICIENT
    drag = value * AIR * np.pi * diameter**2 / 8.0 / (mass * 9.81)
    return drag, spread * drag


def _root(drag: float, speed: float) -> complex:
    """Return the root of the drag, which is kept away from 0; the forms are even in it."""
    least = LEAST_DRAG / max(speed, 1e-100) ** 2
    return complex(drag if abs(drag) > least else np.copysign(least, drag)) ** 0.5


def flight_of(nominal: Array, gravity: float, drag: float) -> tuple[Array, Array, Array, Array]:
    """Return the speeds at lift-off and at arrival, and the times of rise and of fall.

    The flights rise by ``nominal**2 / (2 gravity)``.
    """
    v = np.asarray(nominal, np.float64)
    root = _root(drag, float(np.max(np.abs(v), initial=0.0)))
    square = (root**2).real
    up = np.sqrt(np.expm1(square * v**2) / square)
    down = np.sqrt(-np.expm1(-square * v**2) / square)
    rise = (np.arctan(root * up) / (gravity * root)).real
    fall = (np.arctanh(root * down) / (gravity * root)).real
    return up, down, rise, fall


def nominal_of(duration: Array, gravity: float, drag: float) -> Array:
    """Return the nominal speeds of flights that last as long as stated."""
    v = 0.5 * gravity * np.asarray(duration, np.float64)
    for _ in range(8):
        _, _, rise, fall = flight_of(v, gravity, drag)
        v = v * duration / (rise + fall)
    return v


def drop_from_apex(since: Array, gravity: float, drag: float) -> Array:
    """Return how far below its apex a ball is at times since then, negative before."""
    since = np.asarray(since, np.float64)
    root = _root(drag, gravity * float(np.max(np.abs(since), initial=0.0)))
    x = gravity * root * since
    before = -np.log(np.cos(np.where(since < 0.0, x, 0.0)))
    after = np.log(np.cosh(np.where(since < 0.0, 0.0, x)))
    return np.asarray(((before + after) / (gravity * root**2)).real)
