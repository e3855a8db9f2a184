"""Phase and speed with which particles of a record land."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.engine.landings import launch_times
from vibrosweep.model.parameters import HIGH_BOUNCE
from vibrosweep.scene.scene import Scene


def impacts(
    found: Mapping[str, NDArray[Any]], parameters: Mapping[str, Array], scene: Scene
) -> dict[str, Array]:
    """Variables of `vibrosweep.model.measures.IMPACTS` of every landing of a record.

    `found` is what `vibrosweep.engine.landings.record_landings` gives, a rectangle or ragged, and
    the parameters are those that it was given.  A flight over a base that stays lands as fast as
    it began; otherwise gravity has acted for the time of the flight.
    """
    landing, count = found["landing_time"], found["impact_count"]
    places = count if landing.ndim == 1 else np.full(count.shape, landing.shape[-1])
    of_realization, places = places.sum(axis=1), places.ravel()
    begin = (np.cumsum(places) - places)[places > 0]
    lands = np.nonzero(places.reshape(count.shape))[0]
    frequency, time = parameters["frequency"], landing.ravel()

    def before(name: str, launch: Array) -> Array:
        """Values of the landing before, and of the launch at the first one of each particle."""
        values = np.full_like(time, np.nan)
        values[1:] = found[name].ravel()[:-1]
        values[begin] = launch
        return values

    turns = np.repeat(frequency, of_realization)
    turns *= time
    turns += np.repeat(parameters["phase"] / (2.0 * np.pi), of_realization)
    turns -= np.rint(turns)
    speed = before("rebound_velocity", parameters["launch_velocity"][lands])
    if scene.base == HIGH_BOUNCE:
        speed[np.isnan(time)] = np.nan
    else:
        launch = [launch_times(scene.launch, scene.particles, f) for f in frequency]
        fallen = before("liftoff_time", np.array(launch)[places.reshape(count.shape) > 0])
        np.subtract(time, fallen, out=fallen)
        fallen *= np.repeat(parameters["gravity"], of_realization)
        speed = np.subtract(fallen, speed, out=fallen)
    return {
        "impact_phase": turns.reshape(landing.shape),
        "arrival_speed": speed.reshape(landing.shape),
    }
