"""Claims 3, 4 and 9: separations that are preserved, attraction to staggering, ordered motion."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr

from vibrosweep import simulate
from vibrosweep.analysis.basins import basins
from vibrosweep.analysis.capacity import capacity
from vibrosweep.analysis.meetings import first_shared_base
from vibrosweep.analysis.order import order_of_landings
from vibrosweep.analysis.preservation import separation_changes
from vibrosweep.analysis.scene import Scene
from vibrosweep.engine.workers import Workers
from vibrosweep.model import theory
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.study.batches import random_sample, swept
from vibrosweep.study.figures.pairs import fates, separations_in_time
from vibrosweep.study.slots import POPULATIONS, own_slots, smallest_separation
from vibrosweep.study.verdict import Check, Number, Outcome, Picture

__all__ = ["bounded_and_ordered", "preserved", "staggering"]

TAU_C: Final = PARAMETERS["contact_time"].default
# Launches nearly at once, s
NEAR: Final = 1e-6
# Impacts in which an offset of 1 ms falls below 1e-9 s at e = 0.98, by sqrt(e) each
SETTLED: Final = 1400


def preserved(threads: int) -> Outcome:
    """Separation is preserved from impact to impact, Eqs. 23 and 24."""
    record = simulate(
        **random_sample(), launch_time=np.arange(20) / 20, duration=12.0, threads=threads
    )
    changes = separation_changes(record)
    steps = changes["steps"].values
    share = float((changes["preserved_fraction"] * steps).sum() / steps.sum())
    settled = [
        separation_changes(own_slots(n, threads, SETTLED + 20), landed_before=SETTLED)
        for n in (5, 10, 20)
    ]
    largest = max(float(found["change_max"][0]) for found in settled)
    table_1 = simulate(launch_time=[0.1, 0.125, 0.15], duration=40.0, threads=threads)
    return Outcome(
        as_stated=(
            Check("share of separations that change by at most tau_c", share, "at least", 1.0),
        ),
        conditional=(
            Check("change of a separation there, largest", largest, "at most", 1e-8, "s"),
        ),
        numbers=(
            Number("separations compared", float(steps.sum())),
            Number("median change of a separation", float(changes["change_median"].median()), "s"),
            Number("largest change of a separation", float(changes["change_max"].max()), "s"),
        ),
        pictures=(
            Picture(
                "claim03_separations",
                "Separations of three particles launched 25 ms apart at Table 1, impact by "
                "impact; dashed, their separations at launch.",
                separations_in_time(table_1),
            ),
        ),
    )


def staggering(threads: int) -> Outcome:
    """Staggered motion attracts and synchronous impacts are unstable."""
    sample = random_sample()
    end: dict[str, Any] = {
        "duration": 600.0,
        "transient": 590.0,
        "separation": True,
        "regimes": True,
    }
    with Workers(threads) as workers:
        near = swept(
            workers, **sample, **end, lyapunov=True, particles=2, launch=(0.125, 0.125 + NEAR)
        )
        many = swept(workers, **sample, **end, particles=20)
    return Outcome(
        as_stated=(
            Check(
                "share of nearly synchronous pairs that draw apart",
                float(np.mean(near["dt_min"].values > NEAR)),
                "at least",
                0.95,
            ),
            Check(
                "share of staggered populations that stay more than tau_c apart",
                float(np.mean(many["dt_min"].values > TAU_C)),
                "at least",
                0.95,
            ),
        ),
        numbers=(
            Number(
                "pairs that coincide in the end, share",
                float(np.mean(near["dt_min"].values == 0.0)),
            ),
            Number(
                "pairs with a positive Lyapunov exponent in the end, share",
                float(np.mean(near["aperiodic_count"].values > 0)),
            ),
            Number(
                "modulus of the multipliers at Table 1",
                float(np.abs(theory.multipliers(1, 0.9, 1.2)).max()),
            ),
        ),
        pictures=(
            Picture(
                "claim04_synchronous_pairs",
                "Separation of pairs launched 1 µs apart, in the last 10 s of 600 s, against the "
                "amplitude: below the dashed line they have approached each other.",
                fates(near, NEAR),
            ),
        ),
    )


def bounded_and_ordered(threads: int) -> Outcome:
    """Bounded, ordered motion for N from 5 to 100 without overlap."""
    table_1 = [
        simulate(launch_time=np.arange(n) / n, duration=12.0, threads=threads) for n in POPULATIONS
    ]
    own = [own_slots(n, threads) for n in POPULATIONS]
    reached = basins(
        Scene(duration=4000.0), np.arange(40) / 40, np.linspace(0.5, 12.0, 24), threads=threads
    )
    slots = capacity(reached)
    return Outcome(
        as_stated=_order(table_1),
        conditional=_order(own),
        numbers=(
            Number(
                "earliest time at which two particles are on the base together, Table 1",
                float(np.fmin.reduce([_meeting(record) for record in table_1])),
                "s",
            ),
            Number(
                "slots over all attractors of 960 launches at Table 1", float(slots["capacity"])
            ),
            Number("slots of those without rests", float(slots["capacity_without_rests"])),
            Number(
                "smallest separation of landings in own slots",
                min(map(smallest_separation, own)),
                "s",
            ),
        ),
    )


def _order(records: list[xr.Dataset]) -> tuple[Check, ...]:
    orders = [order_of_landings(record) for record in records]
    shared = [np.isfinite(_meeting(record)) for record in records]
    return (
        Check(
            "longest flight over its bound max(u0, a/(1 - e)), largest",
            max(_longest(record) for record in records),
            "at most",
            1.0 + 1e-12,
        ),
        Check(
            "share of landings that change the sequence, largest",
            max(float(o["sequence_change_fraction"][0]) for o in orders),
            "at most",
            0.0,
        ),
        Check(
            "share of populations in which no two particles share the base",
            float(1.0 - np.mean(shared)),
            "at least",
            1.0,
        ),
    )


def _meeting(record: xr.Dataset) -> float:
    return float(first_shared_base(record)["first_shared_time"][0])


def _longest(record: xr.Dataset) -> float:
    unit = 2.0 * float(record["frequency"]) / float(record["gravity"])
    launch = unit * float(record["launch_velocity"])
    bound = theory.flight_time_bound(
        launch, unit * float(record["amplitude"]), float(record["restitution"])
    )
    longest = max(launch, unit * float(np.nanmax(record["rebound_velocity"].values)))
    return longest / float(bound)
