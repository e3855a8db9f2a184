"""Flights through air, and inputs known independently of the recordings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError
from vibrosweep.mistakes import Value, argument

__all__ = ["BallInputs", "Bounces", "Input"]

# -----------------------------------------------------------------------------
# Flights through air: the drag grows with the square of the speed.
#
# A flight begins and ends at the same level.  `gravity` is the acceleration at speed 0, `drag` is
# 1/v^2 for the terminal speed v; an estimate of a drag near zero may be negative.  All formulas are
# exact.

LEAST_DRAG: Final = 1e-7  # s2 m-2 at 1 m/s; a smaller drag causes cancellation
AIR: Final = 1.2  # density, kg m-3
# Drag coefficient of a smooth ball at 1e3 < Re < 2e5, and its relative standard deviation
COEFFICIENT: Final = (0.47, 0.2)


def drag_of_ball(mass: float, diameter: float) -> tuple[float, float]:
    """Return the drag (s2 m-2) of a ball of given mass (kg) and diameter (m), and its error."""
    value, spread = COEFFICIENT
    drag = value * AIR * np.pi * diameter**2 / 8.0 / (mass * 9.81)
    return drag, spread * drag


def _root(drag: float, speed: float) -> complex:
    """Return the square root of the drag, bounded away from 0; the formulas are even in it."""
    least = LEAST_DRAG / max(speed, 1e-100) ** 2
    return complex(drag if abs(drag) > least else np.copysign(least, drag)) ** 0.5


def flight_of(nominal: Array, gravity: float, drag: float) -> tuple[Array, Array, Array, Array]:
    """Return the speeds at lift-off and at impact, and the times of rise and of fall.

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
    """Return the nominal speeds of flights of given durations (s)."""
    v = 0.5 * gravity * np.asarray(duration, np.float64)
    for _ in range(8):
        _, _, rise, fall = flight_of(v, gravity, drag)
        v = v * duration / (rise + fall)
    return v


def drop_from_apex(since: Array, gravity: float, drag: float) -> Array:
    """Return the distance below the apex at times relative to it (negative before)."""
    since = np.asarray(since, np.float64)
    root = _root(drag, gravity * float(np.max(np.abs(since), initial=0.0)))
    x = gravity * root * since
    before = -np.log(np.cos(np.where(since < 0.0, x, 0.0)))
    after = np.log(np.cosh(np.where(since < 0.0, 0.0, x)))
    return np.asarray(((before + after) / (gravity * root**2)).real)


def bend(since: Array, gravity: float, drag: float) -> Array:
    """Displacement (m) by drag, of first order, at times (s) relative to the apex of a flight."""
    return np.asarray(drag * gravity**3 * since**3 * np.abs(since) / 12.0)


def derivatives(function: Callable[[Array], Array], at: Array, steps: Array) -> Array:
    """Return central differences by each variable, shape (value, variable)."""
    return np.stack(
        [(function(at + h) - function(at - h)) / (2.0 * h.sum()) for h in np.diag(steps)], axis=1
    )


# -----------------------------------------------------------------------------
# Inputs known independently of the recordings, and the bounces that a recording yields.


class Input(NamedTuple):
    """A quantity with its standard error."""

    value: float
    error: float = 0.0
    ends: tuple[float, float] | None = None  # of a range with a log-uniform prior


# Default ranges: contact times of 0.2 to 5 ms, terminal speeds of 10 to 100 m/s
CONTACT: Final = (2e-4, 5e-3)
DRAG: Final = (1e-4, 1e-2)
GRAVITY: Final = Input(9.81)
# Contact time scales as (impact speed)^-p: p = 0 for a linear spring, 0.2 for a Hertzian contact
POWER: Final = Input(0.1, 0.1)
# Effects of accelerations during a contact: 0 for a linear spring with a dashpot, 1 for a Hertzian
# contact; about -0.5 for a dashpot that never pulls
SHARE: Final = Input(0.3, 0.6)


def from_range(low: float, high: float) -> Input:
    """Return mean and standard deviation of a log-uniform distribution between two numbers."""
    if not low < high:
        return Input(low)
    mean = (high - low) / np.log(high / low)
    error = float(np.sqrt(mean * (high + low) / 2.0 - mean**2))
    return Input(mean, error, (low, high))


# Ranges of the inputs: contact time in s, mass in kg, lengths in m, gravity in m s-2
ALLOWED: Final = {
    "contact": (1e-9, 0.1),
    "mass": (1e-6, 1e3),
    "diameter": (1e-5, 10.0),
    "drop_height": (1e-5, 1e3),
    "gravity": (1e-3, 1e3),
}


def given(name: str, value: float | tuple[float, float]) -> Input:
    """Check a number or a range of positive numbers, and return it as an input."""
    least, most = ALLOWED[name]
    try:
        low, high = map(float, value if isinstance(value, tuple | list) else (value, value))
    except (TypeError, ValueError):
        low = high = np.nan
    if not least <= low <= high <= most:
        rule = f": must be a number from {least:g} to {most:g}, or two, the lower first"
        raise ParameterError(argument(name), Value(value), rule)
    return from_range(low, high)


@dataclass(frozen=True)
class BallInputs:
    """Inputs of a measurement: contact time in s, drag in s2 m-2, gravity in m s-2."""

    contact: Input = field(default_factory=lambda: from_range(*CONTACT))
    drag: Input | None = None  # if None: zero for impact times, the default range for films
    gravity: Input = GRAVITY
    drop_height: Input | None = None
    scale_from_gravity: bool = False


def ball_inputs(
    contact: float | tuple[float, float] | None,
    mass: float | None,
    diameter: float | None,
    gravity: float | tuple[float, float],
    drop_height: float | tuple[float, float] | None,
) -> BallInputs:
    """Check the inputs given by the user."""
    if (mass is None) != (diameter is None):
        missing = "mass" if mass is None else "diameter"
        raise ParameterError(
            f"{missing}: is missing; the drag of a ball follows from its mass (kg) and diameter (m)"
        )
    drag = None
    if mass is not None and diameter is not None:
        ball = given("mass", mass).value, given("diameter", diameter).value
        drag = Input(*drag_of_ball(*ball))
    return BallInputs(
        BallInputs().contact if contact is None else given("contact", contact),
        drag,
        given("gravity", gravity),
        None if drop_height is None else given("drop_height", drop_height),
    )


class Bounces(NamedTuple):
    """The bounces of a drop, with the covariance of their errors.

    Values that depend on inputs are evaluated at the means of the inputs.
    """

    name: str
    restitution: Array  # (bounce,)
    speed: Array  # impact speed, m s-1; in arbitrary units if `speed_known` is false
    time: Array  # s, as in the recording
    # Covariance of the restitutions, then of the inputs that the recording itself determines
    fixed: Array  # (row, row)
    timing: Array  # (row, row) for a timing error of 1 s (standard deviation)
    inputs: dict[str, Array]  # change of each row if the true input is larger by one unit
    found: dict[str, float]  # measured less mean value of each input that the recording determines
    speed_known: bool
    gravity: Input | None  # apparent, in units of the file per s2
    remarks: tuple[str, ...]
    group: str = ""  # name of a group of drops that are pooled
    # For impact times: derivatives by the clicks (row, click); the interval before each bounce,
    # infinite for a first fall, and the median interval; the time resolution; a function that
    # linearizes the same bounces about shifted clicks and other values of the inputs
    clicks: Array | None = None
    before: Array | None = None
    middle: float = 1.0
    rounding: float = 0.0
    about: Callable[[Array | float, Mapping[str, float]], Bounces] | None = None
