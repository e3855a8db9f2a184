"""Phase and speed of every landing of a record."""

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
    """Return the variables of `vibrosweep.model.measures.IMPACTS` for every landing of a record.

    `found` is the record, a rectangle or ragged, that
    `vibrosweep.engine.landings.record_landings` computed from these parameters.  In the high-bounce
    limit a particle lands with the speed of its lift-off; otherwise gravity adds to it during the
    flight.
    """
    landing, count = found["landing_time"], found["impact_count"]
    places = count if landing.ndim == 1 else np.full(count.shape, landing.shape[-1])
    of_realization, places = places.sum(axis=1), places.ravel()
    begin = (np.cumsum(places) - places)[places > 0]
    realization = np.nonzero(places.reshape(count.shape))[0]  # of each particle that lands
    frequency, time = parameters["frequency"], landing.ravel()

    def previous(name: str, launch: Array) -> Array:
        """Return values of the previous landing; for the first one, of the launch."""
        values = np.full_like(time, np.nan)
        values[1:] = found[name].ravel()[:-1]
        values[begin] = launch
        return values

    turns = np.repeat(frequency, of_realization)
    turns *= time
    turns += np.repeat(parameters["phase"] / (2.0 * np.pi), of_realization)
    turns -= np.rint(turns)
    speed = previous("rebound_velocity", parameters["launch_velocity"][realization])
    if scene.base == HIGH_BOUNCE:
        speed[np.isnan(time)] = np.nan
    else:
        launch = [launch_times(scene.launch, scene.particles, f) for f in frequency]
        gained = previous("liftoff_time", np.array(launch)[places.reshape(count.shape) > 0])
        np.subtract(time, gained, out=gained)
        gained *= np.repeat(parameters["gravity"], of_realization)
        speed = np.subtract(gained, speed, out=gained)
    return {
        "impact_phase": turns.reshape(landing.shape),
        "arrival_speed": speed.reshape(landing.shape),
    }
