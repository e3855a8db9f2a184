"""Flights of the particles of a record, and the motion of the base under them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.analysis.base_motion import BaseMotion, moves, recoils
from vibrosweep.analysis.requirements import require
from vibrosweep.arrays import Array
from vibrosweep.model.restitution_laws import CONSTANT, law_in, restitution_at
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
    from vibrosweep.analysis.recoil import recoiling  # loads numba, which other bases do not need

    return recoiling(one, motion, analysis)


def course(one: xr.Dataset, base: BaseMotion, until: float) -> Course:
    """Flights of one realization of a record that begin before `until`, in s.

    A flight whose landing is not recorded lasts until the end.  Over a moving base the flight after
    the last landing of a particle that was given up is left out: its end is not known.
    """
    start = _begun(one, "launch_time", "liftoff_time")
    velocity = _begun(one, "launch_velocity", "rebound_velocity")
    end = np.pad(one["landing_time"].values, ((0, 0), (0, 1)), constant_values=np.nan)
    if moves(one):
        followed = one["status"].values[:, np.newaxis] == Status.COMPLETED
        unrecorded = np.where(followed, until, start)
    else:
        unrecorded = start + 2.0 * velocity / float(one["gravity"])
    end = np.minimum(np.where(np.isnan(end), unrecorded, end), until)
    # no flight: the particle rests permanently, or lands at once
    flies = (start < until) & ((end > start) if moves(one) else (velocity > 0.0))
    return Course(start, end, velocity, base.height(start), flies)


def _begun(one: xr.Dataset, at_launch: str, after_landing: str) -> Array:
    """Values at the start of each flight, of which the first begins with the launch."""
    later = one[after_landing].values
    first = np.broadcast_to(one[at_launch].values, later.shape[:1])
    return np.concatenate([first[:, np.newaxis], later], axis=1)


def arrival_speeds(one: xr.Dataset, analysis: str) -> Array:
    """Speed of arrival of every landing of one realization, m s-1 downwards; (particle, impact).

    Over the high-bounce base a flight lands as fast as it began.  Over a moving base a particle may
    still be rising when the base catches up with it: its speed of arrival is then below 0.  Raises
    a DataError that names the `analysis` if the record lacks a variable.
    """
    require(one, analysis, "landing_time", "rebound_velocity", "launch_velocity")
    begun = _begun(one, "launch_velocity", "rebound_velocity")[:, :-1]
    if not moves(one):
        return begun
    require(one, analysis, "liftoff_time", "launch_time", "gravity")
    left = _begun(one, "launch_time", "liftoff_time")[:, :-1]
    return np.asarray(float(one["gravity"]) * (one["landing_time"].values - left) - begun)


def restitutions(one: xr.Dataset, speed: Array) -> Array:
    """Restitution of impacts of one realization at relative speeds in m s-1."""
    law, e = law_in(one.attrs), float(one["restitution"])
    of_law = () if law == CONSTANT else (law, float(one["restitution_speed"]))
    return restitution_at(speed, e, *of_law)
