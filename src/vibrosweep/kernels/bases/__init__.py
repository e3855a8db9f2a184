"""Generic functions that every base implements.

A kernel is compiled for one base and one law, selected by the type of the base.  Constants are a
named tuple of the base and the numbers that determine the impacts of one realization.  Each base
has its constants and implementations in files here; other kernels do not name any base.

All numbers are dimensionless: phases in turns, times and flights in forcing periods, speeds as the
duration of the flight that they begin on a base at rest.  Speeds are relative to the base unless
stated otherwise.

Functions of whole batches (`fitted`, `lowest`, `lifts`) are called from Python only.

A base implements the surface that a particle meets: `fly` finds the first instant at which its
clearance leaves the interval from 0 upwards, `speed` and `leave` state the velocity of the surface
there, `jacobian` the derivatives of both.  Everything else (statistics, cycles, separations,
exponents, orbits, bounds) follows from landings, whatever the surface.

The search for a landing may take several passes.  A kernel that advances many lanes calls
`approach` for one pass of each lane; other kernels call `fly` for a whole flight.
"""

from __future__ import annotations

from functools import singledispatch
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels._jit import Floats, generic, jit
from vibrosweep.kernels.arithmetic import HALF_ULP
from vibrosweep.model.parameters import Dimensionless

__all__ = ["constants", "fly", "lift_off", "rebound", "speed"]

Base = Any  # a named tuple of laws, shape and noise: numba compiles for its type
Constants = Any  # the named tuple of one base


class Instant(NamedTuple):
    """An instant, counted in forcing periods."""

    whole: float  # periods of the forcing
    phase: float  # in turns, in [-1/2, 1/2]


class Jacobian(NamedTuple):
    """Derivatives of phase and speed after an impact by those before its flight."""

    # phase_phase, phase_speed: of the phase, by phase and by speed
    phase_phase: float
    phase_speed: float
    # speed_phase, speed_speed: of the speed
    speed_phase: float
    speed_speed: float
    size: float  # sum of the moduli of the terms of which these are sums


class Flight(NamedTuple):
    """A flight: phase and speed of its lift-off, duration, phase and speed of its landing."""

    x: float
    u: float
    time: float
    landing: float
    v: float


class LiftOff(NamedTuple):
    """A lift-off, at once or after a rest."""

    # whole, phase: of the instant; an infinite count if the particle rests for good
    whole: float
    phase: float
    speed: float  # 0 where it rests for good
    leaves: bool  # True if the particle leaves at once


class Counted(NamedTuple):
    """A flight as statistics count it: duration, and height as a product of two factors."""

    time: float
    height: float
    factor: float


@generic
def constants(base: Base, problem: Dimensionless, i: int) -> Constants:
    """Numbers that decide the impacts of realization i."""


@generic
def put(fixed: Constants, s: Floats, j: int) -> None:
    """Put the constants into lane j of the scratch memory, from row `memory.ROW.CONSTANTS` on."""


@generic
def take(base: Base, s: Floats, j: int) -> Constants:
    """Return the constants of lane j from the scratch memory.

    In a lane at rest for good the phase is NaN, so that every comparison with an end is False.
    """


@generic
def fly(fixed: Constants, x: float, u: float) -> tuple[float, float]:
    """Time of flight and speed of arrival after leaving the base at phase x with speed u.

    The time is NaN where no landing can be found.
    """


@generic
def prepare(base: Base, s: Floats, lanes: int) -> None:
    """Compute, for the first lanes, what `approach` needs beyond the numbers of `end_pass`."""


@generic
def approach(fixed: Constants, s: Floats, j: int) -> tuple[float, float, bool]:
    """Make one pass of the search for the landing of lane j.

    Returns time of flight, speed of arrival and whether the landing was found; if not, the time is
    the one to try next.
    """


@generic
def may_land(fixed: Constants, s: Floats, j: int, budget: float) -> bool:
    """Return whether lane j has had fewer impacts than the budget; True if checked elsewhere."""


@generic
def end_pass(fixed: Constants, s: Floats, j: int, time: float, landed: bool, seen: bool) -> bool:
    """Store the numbers that the next pass of lane j needs; return whether to count a flight now.

    `seen` is whether the landing, if there is one, is in the window.
    """


@generic
def abandons(base: Base, s: Floats, j: int, passes: int) -> bool:
    """Return whether the search of lane j is abandoned; called once every so many passes."""


@generic
def pending(base: Base, s: Floats, j: int) -> bool:
    """Return whether the present flight of lane j will be counted when it ends."""


@generic
def common_age(base: Base) -> float:
    """Impacts of every lane in a pass; 0 where `end_pass` counts them lane by lane."""


@generic
def counted(fixed: Constants, flight: Flight, u_off: float) -> Counted:
    """Duration and height of the flight that is counted at a landing.

    In the high-bounce limit, where the duration is known at lift-off, this is the next flight, with
    speed u_off; otherwise the flight that ends.  The height is that of the apex above the level of
    `lowest`, in units of the height of a flight of one period.
    """


@generic
def counted_now(fixed: Constants, s: Floats, j: int, time: float, u_off: float) -> Counted:
    """Return the same as `counted` for the flight of lane j, before the lane changes."""


@singledispatch
def fitted(base: Base, problem: Dimensionless) -> Base:
    """Return the base without code that these realizations do not need; results are the same."""
    return base


@singledispatch
def lowest(base: Base, problem: Dimensionless) -> Floats | None:
    """Return how far the zero of heights is below the mean level; None if it is that level."""
    raise NotImplementedError


@singledispatch
def lifts(base: Base, problem: Dimensionless) -> NDArray[np.bool_]:
    """Return whether a resting particle is ever lifted, shape (realization,)."""
    raise NotImplementedError


@generic
def leave(fixed: Constants, x: float, u: float) -> float:
    """Speed relative to the base of a particle that leaves phase x with the absolute speed u."""


@generic
def speed(fixed: Constants, x: float, u: float) -> float:
    """Absolute speed of a particle that leaves phase x with speed u."""


@generic
def random(fixed: Constants, particle: float, number: float, n: float, x: float) -> Constants:
    """Constants of one impact, at (n, x), with its random numbers.

    The impacts of a particle are numbered from 0.
    """


@generic
def later_lift_off(fixed: Constants, n: float, x: float, origin: float) -> tuple[float, float]:
    """Return when a particle at rest since (n, x) lifts off, if `lift_off` does not determine it.

    Whole periods count from `origin`; they are NaN if no lift-off is found.
    """


@generic
def rebound(fixed: Constants, x: float, v: float) -> float:
    """Speed with which a particle that arrives at phase x with speed v would leave at once."""


@generic
def lift_off(fixed: Constants, n: float, x: float, w: float) -> LiftOff:
    """Lift-off of a particle that lands at (n, x), with `rebound` w."""


@generic
def after_rest(fixed: Constants) -> tuple[float, float]:
    """Phase and speed with which a particle leaves after a rest, where `lifts_alike`."""


@generic
def lifts_alike(base: Base) -> bool:
    """Return whether every rest ends in the same phase and speed, those of `after_rest`."""


@generic
def contact_time(fixed: Constants) -> float:
    """Shortest stay, in periods, for which a particle occupies the base after a landing."""


@generic
def jacobian(fixed: Constants, flight: Flight) -> Jacobian:
    """Derivative of phase and speed after an impact by those before its flight.

    The particle leaves at once.
    """


@generic
def reverses(fixed: Constants, x: float, v: float) -> float:
    """Return -1 if the Jacobian reverses orientation, else 1."""


@generic
def contraction(fixed: Constants, v: float) -> float:
    """Modulus of the determinant of the Jacobian of an impact with speed v of arrival.

    Factors whose product over a cycle is 1 may be omitted.  If it is 0 at one speed, it is 0 at
    every speed.
    """


@generic
def density(fixed: Constants, u: float) -> float:
    """Weight of an area at speed u; quotients of weights are the factors `contraction` omits."""


@generic
def fixed_residual(fixed: Constants, x: float, k: float, sign: float) -> tuple[float, float, float]:
    """Residual of the equation of a fixed orbit that lands at phase x every k periods.

    `sign` is -1 for an orbit that is reflected at every impact, else 1.  Returns also the
    derivative of the residual by the phase, and the size of its terms.
    """


@generic
def fixed_attracts(fixed: Constants, x: float, k: float) -> bool:
    """Return whether the fixed orbit that lands at phase x every k periods attracts."""


@generic
def fixed_holds(fixed: Constants, x: float, k: float) -> bool:
    """Return whether a flight from phase x lands after k periods, not earlier, and bounces."""


# --- Flights between two given instants, for `vibrosweep.kernels.closed` and `bifurcations` -------


class Slopes(NamedTuple):
    """Jacobian of an impact and its determinant, times a scale that makes all of them finite.

    Over a base that moves the Jacobian is infinite where the speed of arrival is 0.
    """

    scale: float  # 1, or the speed of arrival
    # xx, xu, ux, uu: of phase and speed after the impact, by those before its flight
    xx: float
    xu: float
    ux: float
    uu: float
    determinant: float


@generic
def chord(fixed: Constants, x: float, s: float) -> tuple[float, float]:
    """Speeds relative to the base of a flight of s periods, s > 0, at its phase x and at its end.

    The particle may meet the base on the way.
    """


@generic
def slopes(fixed: Constants, arc: Flight) -> Slopes:
    """Jacobian of the impact that ends a flight, also where the speed of arrival is 0."""


@generic
def clearing(fixed: Constants, arc: Flight) -> float:
    """Least local minimum of the height above the base in a flight; infinite if there is none."""


# --- Errors, for the bounds of `vibrosweep.kernels.trust` -----------------------------------------


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
    out.  They are infinite where a state within `spread` may land at a very different time.
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
def liftoff_error_after(
    fixed: Constants, n: float, x: float, error: float, later: Instant
) -> StateError:
    """Bounds like those of `liftoff_error`, of a lift-off after a given rest.

    The rest begins at (n, x), counted from time 0, with an error of the phase; by `lift_off` it
    ends at `later`.  The bound of the phase is also infinite where the end is in doubt.
    """


@jit
def unless_doubtful(found: StateError, x: float, error: float, later: Instant) -> StateError:
    """Bounds of the errors of a lift-off; infinite if it may precede the rest, at phase x."""
    doubtful = later.whole < np.inf and abs(x - later.phase) <= error + found.phase
    return StateError(np.inf, np.inf) if doubtful else found
