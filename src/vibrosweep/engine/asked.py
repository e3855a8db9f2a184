"""What a sweep asks for, as the engine takes it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from vibrosweep.engine.observation import Observation
from vibrosweep.model.measures import Measures
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.spec.sweep import SweepSpec

__all__ = [
    "observation_of",
    "parameters_of",
    "record_observation",
]

Array = NDArray[np.float64]


def observation_of(spec: SweepSpec) -> Observation:
    """What is launched, watched and measured in each realization of a sweep."""
    return Observation(spec.particles, spec.launch, spec.duration, spec.rebound, spec.measures)


def record_observation(
    particles: int,
    launch: str | tuple[float, ...],
    duration: float,
    rebound: str,
    impact_budget: int,
) -> Observation:
    """Observe a scene with no measures but those that are always there, over every landing."""
    every = Measures(transient=-math.inf, tolerance=math.inf, impact_budget=impact_budget)
    return Observation(particles, launch, duration, rebound, every)


def parameters_of(spec: SweepSpec, sampled: Mapping[str, Array], size: int) -> dict[str, Array]:
    """Every parameter of realizations of a sweep, each of shape (realization,)."""
    return {
        name: sampled[name] if name in sampled else np.full(size, spec.fixed[name])
        for name in PARAMETERS
    }
