"""What a sweep asks for, as the engine takes it."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.engine.observation import Observation
from vibrosweep.model.forcing import (
    FORCINGS,
    completed,
    differing,
    forcing_of,
    inputs_of,
    only_parameters,
)
from vibrosweep.model.measures import Measures
from vibrosweep.model.parameters import HIGH_BOUNCE
from vibrosweep.model.times import Periods, Time, in_seconds
from vibrosweep.spec.sweep import SweepSpec


def observation_of(spec: SweepSpec) -> Observation:
    """What is launched, watched and measured in each realization of a sweep."""
    return Observation(
        spec.particles, spec.launch, spec.duration, spec.rebound, spec.measures, base=spec.base
    )


def record_observation(
    particles: int,
    launch: str | tuple[float, ...],
    duration: Time,
    rebound: str,
    impact_budget: int,
    base: str = HIGH_BOUNCE,
) -> Observation:
    """Observe a scene with no measures but those that are always there, over every landing."""
    every = Measures(transient=-math.inf, tolerance=math.inf, impact_budget=impact_budget)
    return Observation(particles, launch, duration, rebound, every, base=base)


def given_forcing(spec: SweepSpec, sampled: Collection[str]) -> str:
    """Name of the forcing that a sweep gives; that of a table takes the place of the default."""
    return forcing_of([name for name in sampled if name in FORCINGS] or spec.given)


def quantities_of(spec: SweepSpec, sampled: Mapping[str, Array], size: int) -> dict[str, Array]:
    """What a result says of its realizations, each of shape (realization,).

    What is given, all of `vibrosweep.model.parameters.PARAMETERS`, of a sprung base also of
    `vibrosweep.model.parameters.MOUNT`, the acceleration of the base, and the duration and the
    transient in s.  `sampled` holds the sampled ones of `INPUTS`.
    """
    others = [name for name in (*sampled, *spec.given) if name not in FORCINGS]
    given = {
        name: sampled[name] if name in sampled else np.full(size, spec.fixed[name])
        for name in inputs_of([given_forcing(spec, sampled), *others], spec.base)
    }
    found = completed(given)
    for name, time in _times(spec).items():
        found[name] = in_seconds(time, found["frequency"])
    return found


def varying(spec: SweepSpec, sampled: Collection[str]) -> tuple[str, ...]:
    """Names of what differs between realizations: what is sampled, and what follows from it."""
    times = [name for name, time in _times(spec).items() if isinstance(time, Periods)]
    found = differing(sampled, given_forcing(spec, sampled))
    return (*found, *times) if "frequency" in sampled else found


def varied_quantities(spec: SweepSpec, sampled: Mapping[str, Array], size: int) -> dict[str, Array]:
    """Those of `quantities_of` that `varying` names."""
    found = quantities_of(spec, sampled, size)
    return {name: found[name] for name in varying(spec, sampled)}


def parameters_of(spec: SweepSpec, sampled: Mapping[str, Array], size: int) -> dict[str, Array]:
    """What the engine takes of realizations of a sweep, each of shape (realization,)."""
    return only_parameters(quantities_of(spec, sampled, size))


def _times(spec: SweepSpec) -> dict[str, Time]:
    return {"duration": spec.duration, "transient": spec.measures.transient}
