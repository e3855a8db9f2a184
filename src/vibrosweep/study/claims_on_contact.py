"""Claims 10 and 11: separations that stay positive, and heights that never coincide."""

from __future__ import annotations

from typing import Final

import numpy as np
import xarray as xr

from vibrosweep import simulate
from vibrosweep.analysis.crossings import crossings
from vibrosweep.analysis.decay import slot_decay
from vibrosweep.analysis.separations import compare_separations, separation_distribution
from vibrosweep.engine.workers import Workers
from vibrosweep.figures.separations import decay_in_a_slot, distributions
from vibrosweep.model import theory
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.study.batches import random_sample, swept
from vibrosweep.study.figures.crossings import heights_and_crossings
from vibrosweep.study.slots import POPULATIONS, own_slots, smallest_separation
from vibrosweep.study.verdict import Check, Number, Outcome, Picture

__all__ = ["heights_differ", "separation_stays_positive"]

TAU_C: Final = PARAMETERS["contact_time"].default
DURATIONS: Final = (12.0, 120.0, 1200.0)


def separation_stays_positive(threads: int) -> Outcome:
    """The smallest separation stays positive for all stable conditions, and above tau_c."""
    sample = random_sample()
    with Workers(threads) as workers:
        settled = swept(workers, **sample, duration=2000.0, regimes=True)
        stable = (settled["unsettled_count"] + settled["aperiodic_count"]).values == 0
        sweeps = [swept(workers, **sample, duration=t, separation=True) for t in DURATIONS]
        fewer = [
            swept(workers, **sample, duration=12.0, separation=True, particles=n)
            for n in (2, *POPULATIONS)
        ]
    dt = sweeps[0]["dt_min"].values[stable]
    own = [own_slots(n, threads) for n in POPULATIONS]
    pair = _pair_in_one_slot(threads)
    decay = slot_decay(pair).isel(realization=0)
    against_n = compare_separations(fewer)
    return Outcome(
        as_stated=(
            Check(
                "share of stable realizations with dt_min > 0",
                float(np.mean(dt > 0.0)),
                "at least",
                1.0,
            ),
            Check(
                "share of stable realizations with dt_min > tau_c",
                float(np.mean(dt > TAU_C)),
                "at least",
                1.0,
            ),
        ),
        conditional=(
            Check(
                "smallest separation in own slots, N = 5 to 100",
                min(smallest_separation(record) for record in own),
                "at least",
                TAU_C,
                "s",
            ),
        ),
        numbers=(
            Number("stable realizations", float(stable.sum())),
            *(
                Number(
                    f"collision-free realizations in {t:g} s, share",
                    float(separation_distribution(s)["collision_free_fraction"]),
                )
                for t, s in zip(DURATIONS, sweeps, strict=True)
            ),
            *(
                Number(f"collision-free realizations of N = {int(n)} in 12 s, share", float(share))
                for n, share in zip(
                    against_n["particles"], against_n["collision_free_fraction"], strict=True
                )
            ),
            Number("decay per impact in a slot at Table 1, fitted", float(decay["modulus_fitted"])),
            Number("the same from the multipliers", float(decay["modulus_predicted"])),
            Number(
                "time in which a slot closes from half a period to tau_c",
                float(decay["closing_time"]),
                "s",
            ),
        ),
        pictures=(
            Picture(
                "claim10_distribution",
                "Empirical distribution of dt_min over the 200 realizations, for three times of "
                "observation; the step at the left edge are those with dt_min = 0.",
                distributions(
                    [separation_distribution(s) for s in sweeps],
                    [f"{t:g} s" for t in DURATIONS],
                    TAU_C,
                ),
            ),
            Picture(
                "claim10_slot",
                "Separation of two particles in one slot at Table 1 at each impact, and the decay "
                "that the multipliers predict.",
                decay_in_a_slot(slot_decay(pair)),
            ),
        ),
    )


def _pair_in_one_slot(threads: int) -> xr.Dataset:
    phase = float(theory.locked_phase(1, 0.9, 1.2))
    return simulate(
        launch_velocity=4.905, launch_time=[phase, phase + 0.01], duration=450.0, threads=threads
    )


def heights_differ(threads: int) -> Outcome:
    """y_i(t) != y_j(t) at all times, Eq. 18."""
    record = simulate(launch_time=np.arange(20) / 20, duration=12.0, threads=threads)
    found = crossings(record)
    slots = own_slots(5, threads)
    ordered = crossings(slots)
    few = simulate(launch_time=[0.1, 0.55], duration=4.0, threads=threads)
    return Outcome(
        as_stated=(
            Check(
                "share of pairs of particles at one height at some time",
                _crossing_share(found),
                "at most",
                0.0,
            ),
        ),
        conditional=(
            Check(
                "share of pairs of particles at one height at some time",
                _crossing_share(ordered),
                "at most",
                0.0,
            ),
        ),
        numbers=(
            Number("crossings of 20 particles in 12 s", float(found.sizes["crossing"])),
            Number("pairs of particles", float(found["pairs"])),
            Number("pairs of flights in the air together", float(found["flight_overlaps"])),
            Number("crossings of 5 particles in own slots", float(ordered.sizes["crossing"])),
        ),
        pictures=(
            Picture(
                "claim11_crossings",
                "Heights of two particles at Table 1; circles mark where they are at one height.",
                heights_and_crossings(few, crossings(few)),
            ),
        ),
    )


def _crossing_share(found: xr.Dataset) -> float:
    return float(found["pairs_crossing"]) / float(found["pairs"])
