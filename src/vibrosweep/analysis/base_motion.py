"""How the base of a record moves, and the flights that begin and end on it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vibrosweep.analysis.requirements import require
from vibrosweep.arrays import Array
from vibrosweep.errors import DataError
from vibrosweep.model.mount import SPRUNG
from vibrosweep.model.parameters import BASES
from vibrosweep.model.status import Status

if TYPE_CHECKING:
    import xarray as xr


NEEDS: Final = ("restitution", "amplitude", "frequency", "phase")


@dataclass(frozen=True)
class BaseMotion:
    """Motion of the base of one realization, which no particle changes."""

    speed: float  # peak velocity V0 = A / (1 + e), m s-1; 0 where the base stays at height 0
    frequency: float  # Hz
    phase: float  # rad

    def velocity(self, time: ArrayLike) -> Array:
        """Velocity V0 sin(2 pi f t + phi), m s-1, at times in s of any shape."""
        return np.asarray(self.speed * np.sin(self._angle(time)))

    def height(self, time: ArrayLike) -> Array:
        """Height -V0 / (2 pi f) cos(2 pi f t + phi), m, at times in s of any shape."""
        return np.asarray(-self.displacement * np.cos(self._angle(time)))

    @property
    def displacement(self) -> float:
        """Peak displacement, m."""
        return self.speed / (2.0 * np.pi * self.frequency)

    @property
    def reach(self) -> float:
        """Largest distance from height 0, m."""
        return self.displacement

    def _angle(self, time: ArrayLike) -> Array:
        return np.asarray(2.0 * np.pi * self.frequency * np.asarray(time) + self.phase)


class Course(NamedTuple):
    """Flights of the particles of one realization; each array of shape (particle, flight).

    The first flight of each particle is that from its launch, and each landing begins another.
    """

    # start, end: s; a flight in progress at the end of what is looked at ends there
    start: Array
    end: Array
    velocity: Array  # speed at its beginning, m s-1
    height: Array  # height at its beginning, m
    flies: NDArray[np.bool_]  # whether there is such a flight


def base_name(dataset: xr.Dataset) -> str:
    """Which of `vibrosweep.model.parameters.BASES` a dataset is about; the first by default."""
    return str(dataset.attrs.get("base", BASES[0]))


def moves(dataset: xr.Dataset) -> bool:
    """Whether the base of a dataset moves."""
    return base_name(dataset) != BASES[0]


def recoils(dataset: xr.Dataset) -> bool:
    """Whether the base of a dataset is of finite mass, so that its particles act on each other."""
    return base_name(dataset) == SPRUNG


def refuse_recoil(dataset: xr.Dataset, analysis: str) -> None:
    """Refuse, with a DataError, what holds only for particles that do not act on each other."""
    if recoils(dataset):
        raise DataError(
            f"{analysis} holds for particles that do not act on each other, and over base = "
            f'"{SPRUNG}" they do: compute the sweep with mass_ratio = 0, or with base = "moving"'
        )


def base_motion(one: xr.Dataset, analysis: str) -> BaseMotion:
    """Motion of the base of one realization of a record, with all its particles.

    Messages name the `analysis` that the user asked for.  Raises a DataError where the base moves
    and the record lacks a parameter of its motion, or particles move it and the record is not of
    all.
    """
    if not moves(one):
        return BaseMotion(0.0, 1.0, 0.0)
    require(one, analysis, *NEEDS)
    e, amplitude, frequency, phase = (float(one[name]) for name in NEEDS)
    motion = BaseMotion(amplitude / (1.0 + e), frequency, phase)
    if not recoils(one):
        return motion
    from vibrosweep.analysis.recoil import recoiling  # loads numba, which drawing does not

    return recoiling(one, motion, analysis)


def course(one: xr.Dataset, base: BaseMotion, until: float) -> Course:
    """Flights of one realization of a record that begin before `until`, in s.

    A flight whose landing is not recorded goes on to the end.  On a moving base nothing is known
    of the flight after the last landing of a particle that was given up.
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
    # False where a particle rests for good, and for one that lands at once
    flies = (start < until) & ((end > start) if moves(one) else (velocity > 0.0))
    return Course(start, end, velocity, base.height(start), flies)


def arrival_speeds(one: xr.Dataset, analysis: str) -> Array:
    """Speed of arrival of every landing of one realization, m s-1 downwards; (particle, impact).

    A flight over a base at rest lands as fast as it began.  Otherwise gravity has acted for the
    time of the flight, and a particle that a rising base catches up with may still be rising: its
    speed of arrival is then below 0.  Raises a DataError that names the `analysis` where the record
    lacks a variable.
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
