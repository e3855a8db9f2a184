"""Measure realizations; those that cannot be computed get a status instead of an error."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import Workers
from vibrosweep.model.measures import Variable
from vibrosweep.model.parameters import representable
from vibrosweep.model.times import Time
from vibrosweep.scene.scene import Scene


def measure_all(
    parameters: Mapping[str, Array], scene: Scene, workers: Workers
) -> dict[str, NDArray[Any]]:
    """Measure a batch; realizations that cannot be computed do not fail the others.

    Their floats are NaN, their counts and flags undetermined, and their status gives the reason.

    Parameters and result are those of `vibrosweep.engine.measure.measure`.
    """
    usable = representable(parameters, _times(scene))
    if usable.all():
        return measure(parameters, scene, workers)
    sizes = {"realization": usable.size, "particle": scene.particles}
    sizes |= {along: len(values) for along, values in scene.measures.own_dims.items()}
    found = {v.name: _refused(v, sizes) for v in scene.measures.variables}
    if usable.any():
        kept = {name: values[usable] for name, values in parameters.items()}
        for name, values in measure(kept, scene, workers).items():
            found[name][usable] = values
    return found


def _times(scene: Scene) -> tuple[Time, ...]:
    launch = () if isinstance(scene.launch, str) else scene.launch
    return (scene.duration, scene.measures.transient, *launch)


def _refused(variable: Variable, sizes: Mapping[str, int]) -> NDArray[Any]:
    """Values of a variable for realizations that were not computed."""
    return np.full([sizes[d] for d in variable.dims], variable.blank, variable.dtype)
