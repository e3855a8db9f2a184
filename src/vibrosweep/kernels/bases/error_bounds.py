"""Generic functions of a base for the bounds on errors of `vibrosweep.kernels.trust`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import generic, jit
from vibrosweep.kernels.bases import Constants, Flight, Instant
from vibrosweep.kernels.rounding import HALF_ULP


class StateError(NamedTuple):
    """Largest errors of phase and speed; those of a lift-off unless stated otherwise."""

    phase: float
    speed: float


@jit
def landing_rounding(flight: Flight) -> float:
    """Bound of the rounding of the phase of a landing, a sum below 1 of two exact numbers."""
    moved: float = flight.x + (flight.time - np.rint(flight.time))
    return min(0.5 * HALF_ULP, HALF_ULP * abs(moved))  # near 0 it is smaller


@generic
def launch_error(fixed: Constants, x: float, u: float) -> float:
    """Error of the launch speed u at phase x; infinite if it decides whether the particle flies."""


@generic
def landing_added(fixed: Constants, flight: Flight, spread: StateError) -> StateError:
    """Bounds on the errors that a flight adds to the phase of its landing and the speed of arrival.

    They come from rounding, and from terms of second order in `spread`, which the Jacobian leaves
    out.  They are infinite where a state within `spread` may land at quite another time.
    """


@generic
def jacobian_error(
    fixed: Constants, flight: Flight, error: float, spread: StateError
) -> tuple[float, float, float]:
    """Bounds of how much errors change the image of a small deviation of the state.

    The image changes by at most the sum of the three numbers, each times a deviation: of the phase
    before, of the speed before, and of the phase of the landing, whose error is `error`.
    """


@generic
def rebound_error(
    fixed: Constants, flight: Flight, added: StateError, error: float, spread: StateError
) -> float:
    """Bound on the error that an impact adds to the speed after it.

    `added` is from `landing_added`; `error` is the whole error of the phase of the landing,
    `spread` that of the lift-off before.
    """


@generic
def absolute_error(fixed: Constants, x: float, u: float, spread: StateError) -> float:
    """Bound on the error of the absolute speed of a particle that leaves phase x with speed u."""


@generic
def rest_is_doubtful(fixed: Constants, x: float, w: float, spread: StateError) -> bool:
    """Return whether errors decide if a particle that lands at phase x with rebound w rests."""


@generic
def liftoff_error(fixed: Constants) -> StateError:
    """Bounds on the errors of phase and speed of the lift-off from a rest.

    The bound of the phase is infinite where it is in doubt whether a resting particle is ever
    lifted.
    """


@generic
def random_liftoff_error(
    fixed: Constants, n: float, x: float, error: float, later: Instant
) -> StateError:
    """Bounds like those of `liftoff_error`, under noise.

    The rest begins at (n, x), counted from time 0, with an error of the phase; by `lift_off` it
    ends at `later`.  The bound of the phase is also infinite where the end is in doubt.
    """
