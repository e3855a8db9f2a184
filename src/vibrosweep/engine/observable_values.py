"""Observables of a batch.

The number of a landing is a statistic like those of the kernels, and is computed with them.  A
function that changes totals has a pass of its own, which follows every landing: other measures keep
their cycles, which are counted instead of followed.
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
    """Statistics that a scene asks for: of measures, and of observables of a number by landing."""
    measured = (IMPACT_SPEED,) if scene.measures.impact_speed else ()
    return (*measured, *(compiled(one) for one in scene.measures.observables if one.landings))


def observable_values(
    parameters: Mapping[str, Array],
    scene: Scene,
    each: Statistics | None,
    follow: Callable[[Observer], Statistics],
) -> dict[str, Array]:
    """Values of all observables of a scene by name, each with the dims of its variable.

    `each` holds the statistics of trajectories.  Where a function changes totals, all landings are
    followed once more, by `follow`, which may write over `each`.  A ParameterError tells what such
    a function raised.
    """
    found = {}
    for one in scene.measures.observables:
        if one.landings and each is not None:
            totals = each.total(statistic_of(type(compiled(one))).name).copy()
            found[one.name] = _values(one, parameters, each, totals)
    for one in scene.measures.observables:
        if not one.landings:
            trajectories, initial = parameters["frequency"].size * scene.particles, one.initial
            totals = np.full((trajectories, one.width), float(initial))
            try:
                statistics = follow(Observer(compiled(one), totals, float(initial)))
            except MemoryError:
                raise
            except Exception as error:
                raise ParameterError(
                    f"observable {one.name!r}: its function raised {type(error).__name__}: {error}"
                ) from error
            found[one.name] = _values(one, parameters, statistics, totals)
    return found


def _values(
    observable: Observable, parameters: Mapping[str, Array], each: Statistics, totals: Array
) -> Array:
    """Values of an observable from its totals: NaN where a trajectory does not stay finite."""
    size = parameters["frequency"].size
    totals = totals.reshape(each.status.size, observable.width)
    totals[each.status == Status.NON_FINITE] = np.nan
    values = observable.combined(totals.reshape(size, -1, observable.width))
    scale: Any = observable.scale(parameters["frequency"], parameters["gravity"])
    return np.asarray(values * scale.reshape((size,) + (1,) * (values.ndim - 1)))
