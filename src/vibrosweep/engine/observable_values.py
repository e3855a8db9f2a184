"""Observables of a batch.

The number of a landing is a statistic like those of the kernels, and is computed with them.  A
function that changes totals has a pass of its own, which follows every landing: other measures keep
their cycles, which are counted instead of followed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.observer import Observer, compiled
from vibrosweep.kernels.statistics import Kinds, Statistics, statistic_of
from vibrosweep.model.observables import Observable
from vibrosweep.model.status import Status
from vibrosweep.scene.scene import Scene


def kinds_of(scene: Scene) -> Kinds:
    """Statistics of the observables that give a number of each landing."""
    return tuple(compiled(one) for one in scene.measures.observables if one.landings)


def observer_of(observable: Observable, trajectories: int) -> Observer:
    """Function and totals of an observable that changes totals at each landing."""
    initial = float(observable.initial)
    totals = np.full((trajectories, observable.width), initial)
    return Observer(compiled(observable), totals, initial)


def observable_error(observable: Observable, error: Exception) -> ParameterError:
    """Return the error that tells what an observable's function raised."""
    return ParameterError(
        f"observable {observable.name!r}: its function raised {type(error).__name__}: {error}"
    )


def observable_values(
    observable: Observable,
    parameters: Mapping[str, Array],
    each: Statistics,
    totals: Array | None = None,
) -> Array:
    """Values of an observable: NaN where a trajectory does not stay finite.

    They have the dims of the observable's variable.  The statistics are those of trajectories, and
    `totals` those of a function that changes them.
    """
    if totals is None:
        totals = each.total(statistic_of(type(compiled(observable))).name).copy()
    size = parameters["frequency"].size
    totals = totals.reshape(each.status.size, observable.width)
    totals[each.status == Status.NON_FINITE] = np.nan
    values = observable.combined(totals.reshape(size, -1, observable.width))
    scale: Any = observable.scale(parameters["frequency"], parameters["gravity"])
    return np.asarray(values * scale.reshape((size,) + (1,) * (values.ndim - 1)))
