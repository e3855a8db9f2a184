"""Motion of a base of finite mass under the particles of a record."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from vibrosweep.analysis.base_motion import BaseMotion
from vibrosweep.analysis.requirements import require
from vibrosweep.arrays import Array
from vibrosweep.engine.coupled import BaseTrack, base_track, count_coupled
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import DataError
from vibrosweep.model.measures import Status
from vibrosweep.model.parameters import (
    MOUNT,
    OF_RESTITUTION,
    PARAMETERS,
    SPRUNG,
    STAGGERED,
    Periods,
)
from vibrosweep.model.restitution_laws import law_in
from vibrosweep.scene.scene import Scene, stored

NEEDS: Final = (*PARAMETERS, *MOUNT, "launch_time", "impact_count", "status", "duration")
SAMPLES: Final = 64  # of the height, in a forcing period
MOST_SAMPLES: Final = 100_000


@dataclass(frozen=True)
class Recoiling(BaseMotion):
    """Motion of a base of finite mass; before the first launch it is that of `BaseMotion`."""

    track: BaseTrack  # motion disturbed by the particles
    # begin, end: first launch, and end of the observation, s
    begin: float
    end: float

    def velocity(self, time: ArrayLike) -> Array:
        """Velocity, m s-1, at times in s of any shape; at an impact, the velocity after it."""
        return self._at(time, 1)

    def height(self, time: ArrayLike) -> Array:
        """Height above the mean level of the undisturbed base, m, at times in s of any shape."""
        return self._at(time, 0)

    @cached_property
    def reach(self) -> float:
        """Largest sampled distance from height 0, m."""
        count = int(min(SAMPLES * self.frequency * (self.end - self.begin), MOST_SAMPLES)) + 2
        return float(np.max(np.abs(self.height(np.linspace(self.begin, self.end, count)))))

    def _at(self, time: ArrayLike, which: int) -> Array:
        times = np.asarray(time, dtype=np.float64)
        instants, places = np.unique(times[np.isfinite(times)], return_inverse=True)
        found = super().velocity(times) if which else super().height(times)
        followed = self.track.at(instants)[which][places]
        # before the first launch the base is undisturbed
        found[np.isfinite(times)] = np.where(
            np.isnan(followed), found[np.isfinite(times)], followed
        )
        return found


def recoiling(one: xr.Dataset, alone: BaseMotion, analysis: str) -> Recoiling:
    """Motion of the base of one realization of a record, from its undisturbed motion `alone`.

    Messages name the `analysis` that the user asked for.  Raises a DataError if the record lacks a
    variable or a particle.
    """
    require(one, analysis, *NEEDS)
    begin, end = float(one["launch_time"].min()), float(one["duration"])
    track, shape = _track(one, analysis), alone.waveform
    return Recoiling(alone.speed, alone.frequency, alone.phase, track, begin, end, waveform=shape)


def _track(one: xr.Dataset, analysis: str) -> BaseTrack:
    """Compute the trajectories of a record again, this time keeping the motion of the base."""
    names = (*PARAMETERS, *(name for name in OF_RESTITUTION if name in one.variables), *MOUNT)
    parameters = {name: np.array([float(one[name])]) for name in names}
    times = np.broadcast_to(one["launch_time"].values, one["impact_count"].shape)
    listed = one.attrs.get("launch") != STAGGERED
    periods = one.attrs.get("duration_periods")
    landings, followed = one["impact_count"].values, np.all(one["status"] == Status.COMPLETED)
    scene = Scene(
        landings.size,
        tuple(times.tolist()) if listed else STAGGERED,
        float(one["duration"]) if periods is None else Periods(float(periods)),
        str(one.attrs["rebound"]),
        base=SPRUNG,
        restitution_law=law_in(one.attrs),
        waveform=stored(one.attrs),
    ).recorded(None if followed else max(int(landings.max()), 1))
    with Workers(1) as workers:
        if not np.array_equal(count_coupled(parameters, scene, workers).landings, landings):
            raise DataError(
                f"{analysis}: the landings of the record cannot be repeated, which the motion of "
                f"the base requires: use a record of all particles, computed by this version"
            )
        return base_track(parameters, scene, workers)
