"""What a sweep asks for, as the engine takes it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from vibrosweep.engine.observation import Observation
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.model.variables import LYAPUNOV, PER_PARTICLE, REGIMES, SWEEP, TRUST, Variable
from vibrosweep.spec.sweep import SweepSpec

__all__ = [
    "measured_variables",
    "observation_of",
    "parameters_of",
    "record_observation",
]

Array = NDArray[np.float64]


def observation_of(spec: SweepSpec) -> Observation:
    """What is launched, watched and measured in each realization of a sweep."""
    names = Observation.__dataclass_fields__.keys() - {"skip"}
    return Observation(**{name: getattr(spec, name) for name in names})


def record_observation(
    particles: int,
    launch: str | tuple[float, ...],
    duration: float,
    rebound: str,
    impact_budget: int,
) -> Observation:
    """Observe a scene with no measures but those that are always there, over every landing."""
    return Observation(
        particles=particles,
        launch=launch,
        duration=duration,
        rebound=rebound,
        transient=-math.inf,
        separation=False,
        per_particle=False,
        regimes=False,
        trust=False,
        tolerance=math.inf,
        impact_budget=impact_budget,
    )


def parameters_of(spec: SweepSpec, sampled: Mapping[str, Array], size: int) -> dict[str, Array]:
    """Every parameter of realizations of a sweep, each of shape (realization,)."""
    return {
        name: sampled[name] if name in sampled else np.full(size, spec.fixed[name])
        for name in PARAMETERS
    }


def measured_variables(asked: SweepSpec | Observation) -> Iterator[Variable]:
    """Give the variables that are measured."""
    if isinstance(asked, SweepSpec):
        asked = observation_of(asked)
    for registry in (SWEEP, PER_PARTICLE, REGIMES, TRUST, LYAPUNOV):
        for variable in registry.values():
            key = variable.key.removeprefix("measure.")
            if not key or getattr(asked, key):
                yield variable
