"""Records: every landing of a small batch of realizations, as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.engine.measure import batch_of, statistics, units_of
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.advance import LOOK_AFTER
from vibrosweep.kernels.memory import require_written
from vibrosweep.kernels.record import Record, Recorder, Units, empty_record, mark_unused_places
from vibrosweep.kernels.statistics import Statistics
from vibrosweep.model.parameters import (
    HIGH_BOUNCE,
    MOUNT,
    OF_RESTITUTION,
    PARAMETERS,
    SPRUNG,
    Dimensionless,
    Launches,
    dimensionless,
    launches,
)
from vibrosweep.scene.scene import Scene
from vibrosweep.system import physical_memory

__all__ = ["all_parameters", "launch_times", "record_landings"]

BYTES_PER_LANDING: Final = 25  # three doubles and a flag
# For `simulate`: with phase and speed of impact too, and the arrays from which they are computed
BYTES_IN_MEMORY: Final = BYTES_PER_LANDING + 4 * 8
# Motion of a base that recoils: four numbers for each landing and for each lift-off
BYTES_OF_MOTION: Final = 2 * 4 * 8
# Measured bytes per trajectory apart from its landings: launch, statistics, copies
BYTES_PER_TRAJECTORY: Final = 120
BYTES_PER_REALIZATION: Final = 160


class CountedLandings(NamedTuple):
    """Landings and status of each trajectory of a record, shape (trajectory,)."""

    landings: NDArray[np.int64]
    status: NDArray[np.int8]


class Form(NamedTuple):
    """Layout of the landings of a record."""

    ragged: bool = False  # one list without padding; otherwise a rectangle
    bytes_per_landing: int = BYTES_PER_LANDING  # of memory, while the record is made

    def places(self, landings: NDArray[np.int64]) -> int:
        """Return the number of places for these numbers of landings of trajectories."""
        return int(landings.sum() if self.ragged else landings.size * landings.max(initial=0))

    def needed(self, landings: NDArray[np.int64], base: str) -> int:
        """Return the bytes of memory for these numbers of landings of trajectories over a base."""
        kept = self.bytes_per_landing * self.places(landings)
        if base != SPRUNG:
            return kept
        # landings are found as a rectangle, and a ragged record is taken from it
        found = (BYTES_PER_LANDING + BYTES_OF_MOTION) * RECTANGLE.places(landings)
        return found + kept if self.ragged else max(found, kept)


RECTANGLE: Final = Form()


def launch_times(launch: str | tuple[float, ...], particles: int, frequency: float) -> Array:
    """Return the launch times in s, shape (particle,)."""
    if isinstance(launch, str):
        return np.arange(particles) / (particles * frequency)
    return np.asarray(launch, dtype=np.float64)


def record_landings(
    parameters: Mapping[str, Array],
    scene: Scene,
    workers: Workers,
    form: Form = RECTANGLE,
    counted: CountedLandings | None = None,
) -> dict[str, NDArray[Any]]:
    """Record every landing until the end, as variables of `vibrosweep.model.measures.RECORD`.

    Parameters have shape (realization,); the transient of the scene must be -inf.  The landings of
    a ragged record have shape (landing,) and are ordered by particle.  `counted` is the result of
    `count_landings` where it is known.  Raises a ParameterError if the record does not fit into
    half of this machine's memory.
    """
    scene = replace(scene, skip=False)  # landings are simulated one by one
    landings, status = counted or count_landings(parameters, scene, workers, form)
    shape, capacity = (parameters["frequency"].size, scene.particles), int(landings.max())
    capacities = landings if form.ragged else np.full(landings.size, capacity)
    out, _ = _recorded(parameters, scene, workers, capacities)
    if scene.base == SPRUNG and form.ragged:
        present = np.arange(capacity) < landings[:, np.newaxis]
        out = Record._make(values[present] for values in out)
    dims = (-1,) if form.ragged else (*shape, capacity)
    found: dict[str, NDArray[Any]] = {
        name: values.reshape(dims) for name, values in out._asdict().items()
    }
    found["impact_count"] = landings.reshape(shape)
    found["status"] = status.reshape(shape)
    return found


def _recorded(
    parameters: Mapping[str, Array], scene: Scene, workers: Workers, capacities: NDArray[np.int64]
) -> tuple[Record, Statistics]:
    """Record the first landings of each trajectory over any base, with their statistics.

    Over a sprung base every trajectory has room for as many landings as the one with the most.
    """
    if scene.base == SPRUNG:
        from vibrosweep.engine.coupled import followed  # slow to import

        statistics, _, motion = followed(parameters, scene, workers, int(capacities.max()))
        return motion.record, statistics.particles
    problem = dimensionless(parameters, scene.duration, scene.measures.transient)
    launch = launches(scene.launch, scene.particles, parameters["frequency"])
    return recorded(problem, launch, scene, workers, units_of(parameters), capacities)


def recorded(
    problem: Dimensionless,
    launch: Launches,
    scene: Scene,
    workers: Workers,
    units: Units,
    capacities: NDArray[np.int64],
) -> tuple[Record, Statistics]:
    """Record the first landings of each trajectory, as many as its capacity.

    `capacities` has shape (trajectory,); the arrays of the record have shape (sum of capacities,).
    The statistics are those of `vibrosweep.engine.measure.statistics`.
    """
    first = np.zeros(capacities.size + 1, np.int64)
    np.cumsum(capacities, out=first[1:])
    out = empty_record(int(first[-1]))
    recorder = Recorder(out, first, units, problem, scene.particles)
    batch = batch_of(problem, launch, scene)
    counted = statistics(batch, scene, workers, observer=recorder)
    mark_unused_places(out, first, counted.landings)
    require_written(out)
    return out, counted


def record_bytes(counted: CountedLandings, scene: Scene, form: Form = RECTANGLE) -> tuple[int, int]:
    """Return the bytes of a record in a file, and of memory while it is made."""
    landings, particles = counted.landings, scene.particles
    memory = _fixed_bytes(landings.size // particles, particles)
    return BYTES_PER_LANDING * form.places(landings), memory + form.needed(landings, scene.base)


def _fixed_bytes(realizations: int, particles: int) -> int:
    """Return the bytes of memory of a record apart from its landings."""
    return realizations * (BYTES_PER_REALIZATION + particles * BYTES_PER_TRAJECTORY)


def require_room(
    realizations: int, particles: int, for_landings: int = 0, landings: int = 0
) -> None:
    """Raise a ParameterError if a record needs more than half of this machine's memory.

    `for_landings` is the memory of its landings in bytes, `landings` their mean per trajectory.
    """
    needed = _fixed_bytes(realizations, particles) + for_landings
    available = physical_memory()
    if needed > available / 2:
        raise ParameterError(
            f"the record of {realizations * particles} trajectories with {landings} or more "
            f"landings needs {needed / 2**30:.3g} GiB, more than half of this machine's "
            f"{available / 2**30:.3g} GiB: shorten the duration, take fewer realizations or "
            f"particles, or run a sweep, which keeps statistics only"
        )


def count_landings(
    parameters: Mapping[str, Array], scene: Scene, workers: Workers, form: Form = RECTANGLE
) -> CountedLandings:
    """Count the landings of each particle; arguments and errors are those of `record_landings`."""
    realizations, particles = parameters["frequency"].size, scene.particles
    trajectories = realizations * particles
    require_room(realizations, particles)
    # no trajectory is simulated beyond `most` landings, with which the record is refused anyway
    most = physical_memory() // (2 * form.bytes_per_landing)
    most //= 1 if form.ragged else trajectories
    budget = min(scene.measures.impact_budget, most + LOOK_AFTER)
    enough = replace(scene.with_measures(impact_budget=budget), skip=False)
    # the kernel that will write the landings counts them, so that no other is compiled
    _, found = _recorded(parameters, enough, workers, np.zeros(trajectories, np.int64))
    landings, status = found.landings.copy(), found.status.copy()
    mean = -(-form.places(landings) // trajectories)
    require_room(realizations, particles, form.needed(landings, scene.base), mean)
    return CountedLandings(landings, status)


def all_parameters(given: Mapping[str, Array]) -> dict[str, Array]:
    """Fill in default parameters and broadcast all to a common shape (realization,).

    Parameters of `OF_RESTITUTION` and `MOUNT` have no defaults here.
    """
    size = max((values.size for values in given.values()), default=1)
    return {  # copies: numba would compile the kernels again for read-only arrays
        name: np.array(np.broadcast_to(given.get(name, p.default), (size,)), float)
        for name, p in {**PARAMETERS, **OF_RESTITUTION, **MOUNT}.items()
        if name in PARAMETERS or name in given
    }


def impacts(
    found: Mapping[str, NDArray[Any]], parameters: Mapping[str, Array], scene: Scene
) -> dict[str, Array]:
    """Return the variables of `vibrosweep.model.measures.IMPACTS` for every landing of a record.

    `found` is the record, a rectangle or ragged, that `record_landings` computed from these
    parameters.  In the high-bounce limit a particle lands with the speed of its lift-off; otherwise
    gravity adds to it during the flight.
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
