"""Generic functions in which one base differs from another.

A kernel is compiled for one base and one law.  The *type* of the constants tells which: the named
tuple of the numbers that decide the impacts of one realization.  Each base is one file here, which
holds its constants and implementations; no other kernel knows which base it is compiled for.

All numbers are dimensionless: phases in turns, times and flights in forcing periods, speeds as the
duration of the flight that they begin on a base at rest.  Speeds are relative to the base unless
stated otherwise.

Only Python code calls functions of whole batches.

A flight may take several passes to be computed: a kernel that advances many lanes calls `approach`
for one pass of each, others call `fly` for the whole of one flight.
"""

from __future__ import annotations

from functools import singledispatch
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels._jit import Floats, generic
from vibrosweep.model.parameters import Dimensionless

__all__ = [
    "Base",
    "Constants",
    "Counted",
    "Flight",
    "Instant",
    "Jacobian",
    "LiftOff",
    "after_rest",
    "approach",
    "common_age",
    "constants",
    "contact_time",
    "contraction",
    "counted",
    "counted_now",
    "density",
    "fitted",
    "fixed_attracts",
    "fixed_holds",
    "fixed_residual",
    "fly",
    "gives_up",
    "jacobian",
    "keep",
    "leave",
    "lift_off",
    "lifts",
    "lifts_alike",
    "lowest",
    "may_land",
    "pending",
    "prepare",
    "put",
    "random",
    "rebound",
    "reverses",
    "speed",
    "take",
    "wake",
]

Base = Any  # an empty named tuple: its type is what numba compiles for
Constants = Any  # the named tuple of one base


class Instant(NamedTuple):
    """An instant."""

    whole: float  # periods of the forcing
    phase: float  # in turns, of [-1/2, 1/2]


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

    # whole, phase: of the instant; an infinite count where the particle rests for good
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
    """Put the constants into lane j of the scratch memory, from row `lanes.CONSTANTS` on."""


@generic
def take(base: Base, s: Floats, j: int) -> Constants:
    """Take the constants of lane j back.

    In a lane at rest for good the phase is NaN, so that every comparison with an end is False.
    """


@generic
def fly(fixed: Constants, x: float, u: float) -> tuple[float, float]:
    """Time of flight and speed of arrival after leaving the base at phase x with speed u.

    The time is NaN where no landing can be found.
    """


@generic
def prepare(base: Base, s: Floats, lanes: int) -> None:
    """Compute the numbers that `approach` needs of the first lanes, beyond those of `keep`."""


@generic
def approach(fixed: Constants, s: Floats, j: int) -> tuple[float, float, bool]:
    """One pass of the search for the landing of lane j: time of flight, speed, and whether found.

    Where it is not, the time is that at which the search goes on.
    """


@generic
def may_land(fixed: Constants, s: Floats, j: int, budget: float) -> bool:
    """Return whether lane j has had fewer impacts than the budget; True where others check it."""


@generic
def keep(fixed: Constants, s: Floats, j: int, time: float, landed: bool, seen: bool) -> bool:
    """Keep the numbers that the next pass of lane j needs; return whether a flight counts now.

    `seen` is whether the landing, if there is one, is in the window.
    """


@generic
def gives_up(base: Base, s: Floats, j: int, passes: int) -> bool:
    """Return whether the search of lane j is given up; called after every so many passes."""


@generic
def pending(base: Base, s: Floats, j: int) -> bool:
    """Return whether the flight that lane j is in is to be counted when it ends."""


@generic
def common_age(base: Base) -> float:
    """Impacts in a pass of any lane, 0 where `keep` counts them lane by lane."""


@generic
def counted(fixed: Constants, flight: Flight, u_off: float) -> Counted:
    """Duration and height of the flight that is counted at a landing.

    This is the flight that ends there or, over a base on which its duration is known by then, the
    one that begins with speed u_off.  The height is that of the apex above the level of `lowest`,
    in units of the height of a flight of one period.
    """


@generic
def counted_now(fixed: Constants, s: Floats, j: int, time: float, u_off: float) -> Counted:
    """Return the same as `counted`, of the flight of lane j, before the lane changes."""


@singledispatch
def fitted(base: Base, problem: Dimensionless) -> Base:
    """Return the base without parts that none of these realizations needs; results are the same."""
    raise NotImplementedError


@singledispatch
def lowest(base: Base, problem: Dimensionless) -> Floats | None:
    """Depth of the zero of heights below the mean level; None where it is that level."""
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
def wake(fixed: Constants, n: float, x: float, origin: float) -> tuple[float, float]:
    """Return when a particle that rests from (n, x) on is lifted, if `lift_off` left that open.

    Whole periods count from `origin`; they are NaN where no lift-off is found.
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
    """Least number of periods for which the base counts as occupied after a landing."""


@generic
def jacobian(fixed: Constants, flight: Flight) -> Jacobian:
    """Derivative of phase and speed after an impact by those before its flight.

    The particle leaves at once.
    """


@generic
def reverses(fixed: Constants, x: float, v: float) -> float:
    """-1 where the Jacobian reverses orientation, else 1."""


@generic
def contraction(fixed: Constants, v: float) -> float:
    """Modulus of the determinant of the Jacobian of an impact with speed v of arrival.

    Factors whose product over a cycle is 1 may be left out.  If it is 0, it is 0 at any speed.
    """


@generic
def density(fixed: Constants, u: float) -> float:
    """Weight of an area at speed u that supplies the factors which `contraction` leaves out."""


@generic
def fixed_residual(fixed: Constants, x: float, k: float, sign: float) -> tuple[float, float, float]:
    """Residual of the equation of a fixed orbit that lands at phase x every k periods.

    `sign` is -1 for an orbit whose particle is pushed into the base, and turned back, at every
    impact; else 1.  Also the derivative of the residual by the phase, and the size of its terms.
    """


@generic
def fixed_attracts(fixed: Constants, x: float, k: float) -> bool:
    """Return whether the fixed orbit that lands at phase x every k periods attracts."""


@generic
def fixed_holds(fixed: Constants, x: float, k: float) -> bool:
    """Return whether a flight from phase x lands after k periods, not before, without a rest."""
