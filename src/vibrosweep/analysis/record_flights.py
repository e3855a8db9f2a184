"""Flights of the particles of a record, and the motion of the base under them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.analysis.base_motion import BaseMotion, moves, recoils
from vibrosweep.analysis.requirements import require
from vibrosweep.arrays import Array
from vibrosweep.model.status import Status
from vibrosweep.scene.waveform import stored

if TYPE_CHECKING:
    import xarray as xr

NEEDS: Final = ("restitution", "amplitude", "frequency", "phase")


class Course(NamedTuple):
    """Flights of the particles of one realization; each array of shape (particle, flight).

    The first flight of each particle is that from its launch; each landing begins another.
    """

    # start, end: s; a flight in progress at the end of the interval ends there
    start: Array
    end: Array
    velocity: Array  # at the start, m s-1
    height: Array  # at the start, m
    flies: NDArray[np.bool_]  # False in places without a flight


def base_motion(one: xr.Dataset, analysis: str) -> BaseMotion:
    """Motion of the base of one realization of a record, which must hold all particles.

    Messages name the `analysis` that the user asked for.  Raises a DataError if the record lacks a
    parameter of the motion, or, over the base of finite mass, a particle.
    """
    if not moves(one):
        return BaseMotion(0.0, 1.0, 0.0)
    require(one, analysis, *NEEDS)
    e, amplitude, frequency, phase = (float(one[name]) for name in NEEDS)
    motion = BaseMotion(amplitude / (1.0 + e), frequency, phase, waveform=stored(one.attrs))
    if not recoils(one):
        return motion
    from vibrosweep.analysis.recoil import recoiling  # loads numba, which drawing does not

    return recoiling(one, motion, analysis)


def course(one: xr.Dataset, base: BaseMotion, until: float) -> Course:
    """Flights of one realization of a record that begin before `until`, in s.

    A flight whose landing is not recorded lasts until the end.  Over a moving base the flight after
    the last landing of a particle that was given up is left out: its end is not known.
    """
    landing = one["landing_time"].values
    particles = landing.shape[0]
    column = np.ones((particles, 1))
    launch = np.broadcast_to(one["launch_time"].values, (particles,))[:, np.newaxis]
    speed, gravity = float(one["launch_velocity"]), float(one["gravity"])
    start = np.concatenate([launch, one["liftoff_time"].values], axis=1)
    velocity = np.concatenate([speed * column, one["rebound_velocity"].values], axis=1)
    end = np.concatenate([landing, np.nan * column], axis=1)
    if moves(one):
        followed = one["status"].values[:, np.newaxis] == Status.COMPLETED
        unrecorded = np.where(followed, until, start)
    else:
        unrecorded = start + 2.0 * velocity / gravity
    end = np.minimum(np.where(np.isnan(end), unrecorded, end), until)
    # no flight: the particle rests permanently, or lands at once
    flies = (start < until) & ((end > start) if moves(one) else (velocity > 0.0))
    return Course(start, end, velocity, base.height(start), flies)


def arrival_speeds(one: xr.Dataset, analysis: str) -> Array:
    """Speed of arrival of every landing of one realization, m s-1 downwards; (particle, impact).

    Over the high-bounce base a flight lands as fast as it began.  Over a moving base a particle may
    still be rising when the base catches up with it: its speed of arrival is then below 0.  Raises
    a DataError that names the `analysis` if the record lacks a variable.
    """
    require(one, analysis, "landing_time", "rebound_velocity", "launch_velocity")
    landing = one["landing_time"].values
    speed = np.full((landing.shape[0], 1), float(one["launch_velocity"]))
    begun = np.concatenate([speed, one["rebound_velocity"].values[:, :-1]], axis=1)
    if not moves(one):
        return begun
    require(one, analysis, "liftoff_time", "launch_time", "gravity")
    launch = np.broadcast_to(one["launch_time"].values, (landing.shape[0],))[:, np.newaxis]
    left = np.concatenate([launch, one["liftoff_time"].values[:, :-1]], axis=1)
    return np.asarray(float(one["gravity"]) * (landing - left) - begun)
