"""Flights of the particles of a record, and the motion of the base under them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.analysis.base_motion import BaseMotion, moves, recoils
from vibrosweep.analysis.requirements import require
from vibrosweep.arrays import Array
from vibrosweep.errors import DataError
from vibrosweep.model.measures import Status
from vibrosweep.model.restitution_laws import CONSTANT, law_in, restitution_at
from vibrosweep.scene.scene import stored

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["base_motion", "course"]

# Largest distance from the base at which a flight may end, relative to the lengths that it sums
FLIGHT: Final = 1e-6
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
    _require_all_landings(one, analysis)
    motion = _alone(one, analysis)
    if not recoils(one):
        _require_flights(one, motion, analysis)
        return motion
    from vibrosweep.analysis.recoil import recoiling  # loads numba, which other bases do not need

    return recoiling(one, motion, analysis)


def _alone(one: xr.Dataset, analysis: str) -> BaseMotion:
    """Motion of the base without particles."""
    if not moves(one):
        return BaseMotion(0.0, 1.0, 0.0)
    require(one, analysis, *NEEDS)
    e, amplitude, frequency, phase = (float(one[name]) for name in NEEDS)
    return BaseMotion(amplitude / (1.0 + e), frequency, phase, waveform=stored(one.attrs))


def _require_all_landings(one: xr.Dataset, analysis: str) -> None:
    """Raise a DataError unless a record holds every landing that it counts."""
    if "impact_count" not in one.variables or "landing_time" not in one.variables:
        return
    count = one["impact_count"].values
    held = np.count_nonzero(np.isfinite(one["landing_time"].values), axis=1)
    if np.any((count >= 0) & (held != count)):
        raise DataError(
            f"{analysis} needs every landing of a particle, and the record lacks some: select "
            f"realizations and particles only"
        )


def _require_flights(one: xr.Dataset, base: BaseMotion, analysis: str) -> None:
    """Raise a DataError unless each flight of a record ends on the base where it is then.

    The flights show whether the attributes of the base are those of the record.
    """
    needed = ("landing_time", "liftoff_time", "rebound_velocity", "launch_time", "launch_velocity")
    if not all(name in one.variables for name in (*needed, "gravity")):
        return
    start = _begun(one, "launch_time", "liftoff_time")[:, :-1]
    velocity = _begun(one, "launch_velocity", "rebound_velocity")[:, :-1]
    end, gravity = one["landing_time"].values, float(one["gravity"])
    since = end - start
    miss = base.height(start) + since * (velocity - 0.5 * gravity * since) - base.height(end)
    size = np.abs(since * velocity) + gravity * since * since + base.reach
    if np.any(np.abs(miss) > FLIGHT * size):
        raise DataError(
            f"{analysis}: flights of the record do not end on the base that its attributes "
            f"describe; records of different bases cannot be combined, nor landings left out"
        )


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
    if "status" in one.variables:  # nothing is known of a realization behind a mask
        flies = flies & (one["status"].values != Status.REFUSED)[:, np.newaxis]
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
    _require_all_landings(one, analysis)
    if not recoils(one):
        _require_flights(one, _alone(one, analysis), analysis)
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
