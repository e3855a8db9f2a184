"""Claim 7: the flat band of Fig. 3."""

from __future__ import annotations

from typing import Final

import numpy as np
import xarray as xr

from vibrosweep.analysis.heights import heights_against_restitution
from vibrosweep.analysis.sensitivity import sobol_indices
from vibrosweep.engine.observation import Observation
from vibrosweep.engine.workers import Workers
from vibrosweep.figures.restitution import height_against_restitution
from vibrosweep.figures.sensitivity import sobol_bars
from vibrosweep.model.measures import Measures
from vibrosweep.model.parameters import STAGGERED
from vibrosweep.study.batches import IMPACT_BUDGET, SAMPLE_RANGES, swept
from vibrosweep.study.verdict import Check, Number, Outcome, Picture

__all__ = ["plateau", "sensitivity"]

SAMPLES: Final = 200
SEED: Final = 3
FLAT: Final = 0.1
# All seven parameters, this package's ranges of e and A and a tenth or so around Table 1
RANGES: Final = {
    **SAMPLE_RANGES,
    "frequency": (0.9, 1.1),
    "phase": (-np.pi, np.pi),
    "gravity": (9.7, 9.9),
    "launch_velocity": (4.5, 5.5),
    "contact_time": (5e-5, 2e-4),
}


def plateau(threads: int) -> Outcome:
    """The maximum rebound height hardly depends on the restitution, Fig. 3."""
    e = np.random.default_rng(SEED).uniform(*SAMPLE_RANGES["restitution"], SAMPLES)
    with Workers(threads) as workers:
        launched = swept(workers, restitution=e)
        steady = swept(workers, restitution=e, duration=1000.0, transient=900.0)
        indices = sensitivity(workers)
    early, late = (heights_against_restitution(sweep) for sweep in (launched, steady))
    on = float(np.mean(late["mode"].values > 0))
    height = indices.sel(output="rebound_height_max")
    return Outcome(
        as_stated=(
            Check(
                "change of the maximum height over the range of e, from the launch on",
                abs(float(early["relative_change"])),
                "at most",
                FLAT,
            ),
        ),
        conditional=(
            Check(
                "change of the maximum height over the range of e, steady motion",
                abs(float(late["relative_change"])),
                "at most",
                FLAT,
            ),
            Check("share of realizations on a plateau g k^2 / 8 f^2 to 1e-6", on, "at least", 0.95),
        ),
        numbers=(
            Number(
                "rank correlation of height and e, from the launch on",
                float(early["rank_correlation"]),
            ),
            Number(
                "lowest median height of nine groups of e, from the launch on",
                float(early["height_max_median"].min()),
                "m",
            ),
            Number(
                "highest median height of nine groups of e, from the launch on",
                float(early["height_max_median"].max()),
                "m",
            ),
            Number("plateau of mode 1, g / 8 f^2", float(9.81 / 8.0), "m"),
            Number(
                "total Sobol' index of e for the maximum height, all parameters random",
                float(height["total_order"].sel(parameter="restitution")),
            ),
            Number("the same of A", float(height["total_order"].sel(parameter="amplitude"))),
        ),
        pictures=(
            Picture(
                "claim07_from_launch",
                "Maximum rebound height in the first 12 s.",
                height_against_restitution(launched),
            ),
            Picture(
                "claim07_steady",
                "Maximum rebound height from 900 s to 1000 s.",
                height_against_restitution(steady),
            ),
            Picture(
                "claim07_sobol_indices",
                "Sobol' indices of four measures of five staggered particles in 12 s, with 95 % "
                "intervals: alone (dark) and with all interactions (light).",
                sobol_bars(indices),
            ),
        ),
    )


def sensitivity(workers: Workers) -> xr.Dataset:
    """Sobol' indices of heights, flight time and separation over all parameters."""
    measures = Measures(separation=True, impact_budget=IMPACT_BUDGET)
    observation = Observation(5, STAGGERED, 12.0, "rest", measures)
    return sobol_indices(RANGES, observation, workers, base=1024, seed=SEED)
