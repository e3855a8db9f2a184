"""One impact, for every kernel: flight, landing, rebound, and lift-off, possibly after a rest.

Phases stay in [-1/2, 1/2]; whole periods are counted separately, as integers in float64.  The
reduction of a flight s to s - rint(s) is exact, so that accuracy does not decrease with time.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from vibrosweep.kernels import bases
from vibrosweep.kernels._jit import jit
from vibrosweep.kernels.arithmetic import ROUNDING
from vibrosweep.kernels.bases import Base, Constants, Flight, Instant, Jacobian
from vibrosweep.kernels.bases.high_bounce import HighBounce
from vibrosweep.kernels.noise import Noise
from vibrosweep.kernels.restitution import REBOUND_OF, restitution_of
from vibrosweep.kernels.waveforms import shape_of
from vibrosweep.model.parameters import HIGH_BOUNCE, MOVING, Dimensionless, Launches
from vibrosweep.model.restitution_laws import CONSTANT
from vibrosweep.model.shapes import PARABOLIC_NAME, SINE, Waveform

__all__ = ["Batch", "base_of", "land", "launch", "launch_speed"]


def _high_bounce(waveform: Waveform) -> type:
    return HighBounce


def _moving(waveform: Waveform) -> type:
    # slow to import: many declarations, those of all waveforms
    from vibrosweep.kernels.bases import harmonics, moving, parabolic  # noqa: F401

    if waveform == SINE:
        return moving.Moving
    return moving.MovingParabolic if waveform.name == PARABOLIC_NAME else moving.MovingHarmonics


# Named tuple of each base, for a waveform
KIND_OF: Final = {HIGH_BOUNCE: _high_bounce, MOVING: _moving}


class Batch(NamedTuple):
    """Realizations, their launches, and the base."""

    base: Base  # from `base_of`; its type decides what is compiled
    problem: Dimensionless
    launches: Launches  # trajectory t of a batch is particle t % N of realization t // N


class Start(NamedTuple):
    """A trajectory to be simulated."""

    lane: int  # its index in the batch
    particle: int
    at: Instant  # of its launch


class Impact(NamedTuple):
    """A landing and the lift-off that follows."""

    # n, x: whole periods and phase of the landing
    n: float
    x: float
    v: float  # speed of arrival
    flight: Flight  # the flight that ends with it
    # n_off, x_off, u: whole periods and phase of the lift-off, and its speed; an infinite count and
    # a speed of 0 where the particle rests for good
    n_off: float
    x_off: float
    u: float
    leaves: bool  # True if it leaves at once
    fixed: Constants  # with the random numbers of the impact


def base_of(
    base: str,
    rebound: str,
    waveform: Waveform = SINE,
    restitution: str = CONSTANT,
    noise: Noise | None = None,
) -> Base:
    """Return the base with its laws of rebound and restitution, given by their names.

    The names are those in BASES and LAWS of `vibrosweep.model.parameters`, and in RESTITUTION_LAWS
    of `vibrosweep.model.restitution_laws`.  The noise is from `vibrosweep.kernels.noise.noise_of`.
    Particles over the base are independent of each other; a `vibrosweep.scene.scene.Scene` refuses
    laws and waveforms that the base does not implement.
    """
    laws = {"law": REBOUND_OF[rebound], "restitution": restitution_of(restitution)}
    return KIND_OF[base](waveform)(waveform=shape_of(waveform), noise=noise, **laws)


@jit
def launch(launches: Launches, i: int, p: int, phase: float) -> Instant:
    """Instant of the launch of particle p of realization i; `phase` is the forcing's at t = 0."""
    row = i if launches.whole.shape[0] > 1 else 0
    start = launches.phase[row, p] + phase
    carry = np.rint(start)
    return Instant(launches.whole[row, p] + carry, start - carry)


@jit
def launch_speed(fixed: Constants, problem: Dimensionless, i: int, x: float) -> float:
    """Speed relative to the base with which particles of realization i are launched at phase x."""
    return bases.leave(fixed, x, problem.launch_flight[i])


@jit
def land(x: float, s: float) -> tuple[float, float]:
    """Phase of the landing after a flight of s periods from phase x, and whole periods passed."""
    whole = np.rint(s)
    moved = x + (s - whole)
    carry = np.rint(moved)
    return moved - carry, whole + carry


@jit
def impact(
    fixed: Constants,
    n: float,
    x: float,
    u: float,
    particle: float = 0.0,
    number: float = 0.0,
    origin: float = 0.0,
) -> Impact:
    """Landing and lift-off after leaving the base at (n, x) with speed u.

    Its random numbers depend on the particle, the number of its impacts until then, and the whole
    periods from which n counts.
    """
    time, v = bases.fly(fixed, x, u)
    x_land, passed = land(x, time)
    n += passed
    flight = Flight(x, u, time, x_land, v)
    drawn = bases.random(fixed, particle, number, n + origin, x_land)
    n_off, x_off, u, leaves = bases.lift_off(drawn, n, x_land, bases.rebound(drawn, x_land, v))
    if not leaves:
        n_off, x_off = bases.later_lift_off(fixed, n_off, x_off, origin)
    return Impact(n, x_land, v, flight, n_off, x_off, u, leaves, drawn)


# --- Small changes of the state -------------------------------------------------------------------


@jit
def carry(dx: float, du: float, jacobian: Jacobian) -> tuple[float, float]:
    """Image of a small change (dx, du) of the state."""
    xx, xu, ux, uu, _ = jacobian
    return xx * dx + xu * du, ux * dx + uu * du


@jit
def stretch(c: float, s: float, jacobian: Jacobian) -> tuple[float, float, float, float, float]:
    """Carry the orthonormal frame (c, s), (-s, c) through an impact and make it orthonormal again.

    Returns
    -------
    c, s
        The new frame.
    along, across
        Diagonal of the triangular factor (Gram-Schmidt): how much the first axis is stretched,
        and how much is left of the second across it.  Their product is the determinant, up to sign.
    slack
        Bound on the rounding error of the logarithm of that product.
    """
    ax, ay = carry(c, s, jacobian)
    bx, by = carry(-s, c, jacobian)
    along = math.sqrt(ax * ax + ay * ay)
    if along == 0.0:  # only at zero restitution: the first axis collapses
        return c, s, 0.0, 0.0, 0.0
    c, s = ax / along, ay / along
    across = abs(c * by - s * bx)
    slack = ROUNDING * jacobian.size
    return c, s, along, across, slack / along + slack / across
