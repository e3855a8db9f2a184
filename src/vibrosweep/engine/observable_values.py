"""Observables of a batch.

An observable that gives a number for each landing is a statistic like those of the kernels, and is
computed with them.  One that changes totals is computed separately, because every landing must be
followed for it: other measures can then still be counted from cycles.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.observer import Observer, compiled
from vibrosweep.kernels.statistics import IMPACT_SPEED, Kinds, Statistics, statistic_of
from vibrosweep.model.observables import Observable
from vibrosweep.model.status import Status
from vibrosweep.scene.scene import Scene


def kinds_of(scene: Scene) -> Kinds:
    """Return the optional statistics of a scene: speed of impact, and numbers of each landing."""
    measured = (IMPACT_SPEED,) if scene.measures.impact_speed else ()
    return (*measured, *(compiled(o) for o in scene.measures.observables if o.landings))


def observable_values(
    parameters: Mapping[str, Array],
    scene: Scene,
    found: Statistics | None,
    follow: Callable[[Observer], Statistics],
) -> dict[str, Array]:
    """Return the values of all observables of a scene by name, with the dims of their variables.

    `found` holds the statistics of trajectories.  For a function that changes totals, `follow`
    follows all landings once more; it may overwrite `found`.  Raises a ParameterError with the
    error of such a function.
    """
    values = {}
    for observable in scene.measures.observables:
        if observable.landings and found is not None:
            totals = found.total(statistic_of(type(compiled(observable))).name).copy()
            values[observable.name] = _values(observable, parameters, found, totals)
    trajectories = parameters["frequency"].size * scene.particles
    for observable in scene.measures.observables:
        if not observable.landings:
            initial = float(observable.initial)
            totals = np.full((trajectories, observable.width), initial)
            try:
                statistics = follow(Observer(compiled(observable), totals, initial))
            except MemoryError:
                raise
            except Exception as error:
                raise ParameterError(
                    f"observable {observable.name!r}: its function raised "
                    f"{type(error).__name__}: {error}"
                ) from error
            values[observable.name] = _values(observable, parameters, statistics, totals)
    return values


def _values(
    observable: Observable, parameters: Mapping[str, Array], found: Statistics, totals: Array
) -> Array:
    """Return the values of an observable; NaN for trajectories that do not stay finite."""
    size = parameters["frequency"].size
    totals = totals.reshape(found.status.size, observable.width)
    totals[found.status == Status.NON_FINITE] = np.nan
    values = observable.combined(totals.reshape(size, -1, observable.width))
    scale: Any = observable.scale(parameters["frequency"], parameters["gravity"])
    return np.asarray(values * scale.reshape((size,) + (1,) * (values.ndim - 1)))
