"""Observables of a batch: each in a pass of its own, which follows every landing.

Other measures therefore keep their bits, and their cycles that are counted instead of followed.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.engine.trajectories import statistics
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.observing import Observer, compiled
from vibrosweep.model.observables import Observable
from vibrosweep.model.parameters import Dimensionless, Launches
from vibrosweep.model.status import Status
from vibrosweep.scene.scene import Scene


def observed(
    observable: Observable,
    parameters: Mapping[str, Array],
    batch: tuple[Dimensionless, Launches],
    observation: Scene,
    workers: Workers,
) -> Array:
    """Values of an observable: NaN where a trajectory does not stay finite.

    They have the dims of the observable's variable.  `batch` holds the parameters, those of
    `vibrosweep.engine.measure.measure`, in dimensionless form, and their launches.  Raises a
    ParameterError where the function raises anything.
    """
    problem, launch = batch
    size, particles = problem.kick.size, observation.particles
    totals = np.full((size * particles, observable.width), float(observable.initial))
    observer = Observer(compiled(observable), totals)
    try:
        found = statistics(problem, launch, observation, workers, observer=observer)
    except MemoryError:
        raise
    except Exception as error:
        raise ParameterError(
            f"observable {observable.name!r}: its function raised {type(error).__name__}: {error}"
        ) from error
    totals[found.status == Status.NON_FINITE] = np.nan
    values = observable.combined(totals.reshape(size, particles, observable.width))
    scale = observable.scale(parameters["frequency"], parameters["gravity"])
    return np.asarray(values * scale.reshape((size,) + (1,) * (values.ndim - 1)))
