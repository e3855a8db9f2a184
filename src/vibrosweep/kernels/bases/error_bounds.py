"""Generic functions of a base for the bounds of errors of `vibrosweep.kernels.trust`."""

from __future__ import annotations

from vibrosweep.kernels._jit import generic
from vibrosweep.kernels.bases import Constants, Flight

__all__ = [
    "Spread",
    "absolute_error",
    "jacobian_error",
    "landing_added",
    "launch_error",
    "liftoff_error",
    "random_liftoff_error",
    "rebound_error",
    "rest_is_doubtful",
]

Spread = tuple[float, float]  # largest errors of phase and speed of a lift-off


@generic
def launch_error(fixed: Constants, x: float, u: float) -> float:
    """Error of the speed u of a launch at phase x; infinite where it decides on a flight."""


@generic
def landing_added(fixed: Constants, flight: Flight, spread: Spread) -> tuple[float, float]:
    """Bounds of the errors that a flight adds to the phase of its landing and the speed of arrival.

    By rounding, and by what the Jacobian leaves out of `spread`.  Infinite where a state within it
    may land at another time.
    """


@generic
def jacobian_error(
    fixed: Constants, flight: Flight, error: float, spread: Spread
) -> tuple[float, float, float]:
    """Bounds of the changes by errors of the image of a small change of the state, to be summed.

    Per change of the phase before, the speed before, and the phase of the landing, whose error is
    `error`.
    """


@generic
def rebound_error(
    fixed: Constants, flight: Flight, added: tuple[float, float], error: float, spread: Spread
) -> float:
    """Bound of the error that an impact adds to the speed after it.

    `added` is from `landing_added`; `error` is all of that of the landing's phase, `spread` that of
    the lift-off before.
    """


@generic
def absolute_error(fixed: Constants, x: float, u: float, spread: Spread) -> float:
    """Bound of the error of the absolute speed of a particle that leaves phase x with speed u."""


@generic
def rest_is_doubtful(fixed: Constants, x: float, w: float, spread: Spread) -> bool:
    """Return whether errors decide if a particle rests that lands at phase x, its rebound w."""


@generic
def liftoff_error(fixed: Constants) -> tuple[float, float]:
    """Bounds of the errors of phase and speed of the lift-off from a rest.

    The first is infinite where it is in doubt whether a resting particle is ever lifted.
    """


@generic
def random_liftoff_error(
    fixed: Constants, n: float, x: float, error: float, later: tuple[float, float]
) -> tuple[float, float]:
    """Bounds as `liftoff_error` gives, where something is random.

    The rest begins at (n, x), counted from time 0, whose phase has an error, and ends `later`, as
    `lift_off` says.  The first is infinite too where it is in doubt when it ends.
    """
