"""Small sweeps in memory, for the claims: parameters in, one dataset out."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from vibrosweep.engine.landings import all_parameters
from vibrosweep.engine.measure import measure
from vibrosweep.engine.observation import Observation
from vibrosweep.engine.workers import Workers
from vibrosweep.model.measures import VARIABLES, Measures
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.runs.result import coordinate_attributes

__all__ = ["IMPACT_BUDGET", "SAMPLE_RANGES", "SAMPLE_SEED", "random_sample", "swept"]

IMPACT_BUDGET: Final = 1_000_000
# A choice of this package: the study states no ranges for its random realizations
SAMPLE_RANGES: Final = {"restitution": (0.80, 0.98), "amplitude": (0.2, 3.5)}
SAMPLE_SEED: Final = 1


def random_sample(realizations: int = 200) -> dict[str, Any]:
    """Random restitutions and amplitudes in this package's ranges, always the same ones."""
    random = np.random.default_rng(SAMPLE_SEED)
    return {name: random.uniform(*ends, realizations) for name, ends in SAMPLE_RANGES.items()}


def swept(
    workers: Workers,
    *,
    particles: int = 20,
    launch: str | tuple[float, ...] = "staggered",
    duration: float = 12.0,
    **given: ArrayLike,
) -> xr.Dataset:
    """Measure a batch of realizations.

    Parameters
    ----------
    workers
        Threads to use.
    particles, launch, duration
        As in a sweep file.
    given
        Physical parameters by their names: numbers, or arrays of shape (realization,); and keys of
        [measure].

    Returns
    -------
    xarray.Dataset
        As `vibrosweep.run` writes it, without provenance.
    """
    parameters = {
        name: np.atleast_1d(np.asarray(v, np.float64))
        for name, v in given.items()
        if name in PARAMETERS
    }
    asked: dict[str, Any] = {n: v for n, v in given.items() if n not in PARAMETERS}
    complete = all_parameters(parameters)
    measures = Measures(**{"impact_budget": IMPACT_BUDGET, **asked})
    observation = Observation(particles, launch, duration, "rest", measures)
    measured = measure(complete, observation, workers)
    coordinates = {
        name: (("realization",), values, coordinate_attributes(PARAMETERS[name]))
        for name, values in complete.items()
    }
    return xr.Dataset(
        {
            name: (VARIABLES[name].dims, v, VARIABLES[name].attributes)
            for name, v in measured.items()
        },
        coords={**coordinates, "duration": duration, "transient": measures.transient},
        attrs={"particles": particles, "rebound": "rest"},
    )
