"""Every landing of a small batch of realizations, as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.engine.trajectories import base_in, statistics
from vibrosweep.engine.workers import TRAJECTORIES_PER_TASK, Workers
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.advance import LOOK_AFTER
from vibrosweep.kernels.impact import Batch
from vibrosweep.kernels.record import Record, Units, empty_record, record
from vibrosweep.model.parameters import MOUNT, PARAMETERS, SPRUNG, dimensionless, launches
from vibrosweep.scene.scene import Scene
from vibrosweep.system import physical_memory

BYTES_PER_LANDING: Final = 25  # three doubles and a flag
# Bytes per trajectory apart from its landings, measured: launch, statistics, copies.
BYTES_PER_TRAJECTORY: Final = 120
BYTES_PER_REALIZATION: Final = 160


def launch_times(launch: str | tuple[float, ...], particles: int, frequency: float) -> Array:
    """Launch times in s, shape (particle,)."""
    if isinstance(launch, str):
        return np.arange(particles) / (particles * frequency)
    return np.asarray(launch, dtype=np.float64)


def record_landings(
    parameters: Mapping[str, Array], scene: Scene, workers: Workers
) -> dict[str, NDArray[Any]]:
    """Every landing until the end of the observation, as `vibrosweep.model.measures.RECORD`.

    Parameters are of shape (realization,); the transient of the observation is -inf.  Raises a
    ParameterError where the record would not fit into half of this machine's memory.
    """
    landings, status = _counted(parameters, scene, workers)
    capacity = int(landings.max())
    if scene.base == SPRUNG:
        from vibrosweep.engine.coupled import record_coupled  # slow to import

        out = record_coupled(parameters, scene, workers, capacity)
    else:
        out = _recorded(parameters, scene, workers, capacity)
    shape = (parameters["frequency"].size, scene.particles)
    found: dict[str, NDArray[Any]] = {
        name: values.reshape(*shape, capacity) for name, values in out._asdict().items()
    }
    found["impact_count"] = landings.reshape(shape)
    found["status"] = status.reshape(shape)
    return found


def _recorded(
    parameters: Mapping[str, Array], scene: Scene, workers: Workers, capacity: int
) -> Record:
    """Record particles that are independent of each other."""
    problem = dimensionless(parameters, scene.duration, scene.measures.transient)
    launch = launches(scene.launch, scene.particles, parameters["frequency"])
    trajectories = parameters["frequency"].size * scene.particles
    out = empty_record(trajectories, capacity)
    batch = Batch(base_in(scene, problem), problem, launch)
    units = Units(parameters["frequency"], parameters["gravity"] / (2.0 * parameters["frequency"]))

    def task(first: int, last: int) -> None:
        record(first, last, batch, units, out)

    workers.each(task, trajectories, max(1, TRAJECTORIES_PER_TASK // 128), out)
    return out


def record_bytes(
    parameters: Mapping[str, Array], scene: Scene, workers: Workers
) -> tuple[int, int]:
    """Bytes of a record of landings, and of memory while it is made.

    Arguments and errors are those of `record_landings`.
    """
    landings, _ = _counted(parameters, scene, workers)
    realizations, capacity = parameters["frequency"].size, int(landings.max())
    return (
        BYTES_PER_LANDING * landings.size * capacity,
        _needed(realizations, scene.particles, capacity),
    )


def require_room(realizations: int, particles: int, landings: int = 0) -> None:
    """Raise a ParameterError if a record needs more than half of this machine's memory."""
    needed, available = _needed(realizations, particles, landings), physical_memory()
    if needed > available / 2:
        raise ParameterError(
            f"the record of {realizations * particles} trajectories with {landings} or more "
            f"landings needs {needed / 2**30:.3g} GiB, more than half of this machine's "
            f"{available / 2**30:.3g} GiB: shorten the duration, take fewer realizations or "
            f"particles, or run a sweep, which keeps statistics only"
        )


def _needed(realizations: int, particles: int, landings: int) -> int:
    """Bytes of memory for a record with this many landings of each trajectory."""
    each = BYTES_PER_TRAJECTORY + BYTES_PER_LANDING * landings
    return realizations * (BYTES_PER_REALIZATION + particles * each)


def _counted(
    parameters: Mapping[str, Array], scene: Scene, workers: Workers
) -> tuple[NDArray[np.int64], NDArray[np.int8]]:
    """Landings of each particle, and its status; raise if a record does not fit into memory."""
    realizations, particles = parameters["frequency"].size, scene.particles
    require_room(realizations, particles)
    most = physical_memory() // (2 * BYTES_PER_LANDING * realizations * particles)
    # a trajectory with more than `most` is followed no further: the record is refused anyway
    budget = min(scene.measures.impact_budget, most + LOOK_AFTER)
    # counted as they will be kept: one by one
    enough = replace(scene.with_measures(impact_budget=budget), skip=False)
    if scene.base == SPRUNG:
        from vibrosweep.engine.coupled import count_coupled

        coupled = count_coupled(parameters, enough, workers)
        landings, status = coupled.landings, coupled.status
    else:
        problem = dimensionless(parameters, scene.duration, scene.measures.transient)
        launch = launches(scene.launch, particles, parameters["frequency"])
        each = statistics(problem, launch, enough, workers)
        landings, status = each.landings.copy(), each.status.copy()
    require_room(realizations, particles, int(landings.max()))
    return landings, status


def all_parameters(given: Mapping[str, Array]) -> dict[str, Array]:
    """Fill in default parameters and broadcast all to a common shape (realization,).

    Of `MOUNT` there is what is given.
    """
    size = max((values.size for values in given.values()), default=1)
    return {  # copies: numba would compile the kernels again for read-only arrays
        name: np.array(np.broadcast_to(given.get(name, p.default), (size,)), float)
        for name, p in {**PARAMETERS, **{n: MOUNT[n] for n in MOUNT if n in given}}.items()
    }
