"""Claim 24: particles repel each other in phase, compared with random landings."""

from __future__ import annotations

from typing import Final

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from study.bases import HIGH_BOUNCE, MOVING
from study.claims_on_windows import STRONG
from study.estimates import Estimate, mean
from study.samples import (
    ANY_PHASE,
    FEW,
    FIRST,
    REFLECT,
    Plan,
    Setting,
    laws,
    measured,
    records,
    settings_of,
)
from study.verdict import Evidence, Number, Reading, check, number
from vibrosweep.analysis import order_against_chance, separations_against_chance
from vibrosweep.figures import separations_over_chance
from vibrosweep.figures.style import for_file

# Window in which landings count, s
WINDOW: Final = (50.0, 150.0)
PART: Final = 0.25  # of the realizations
SURROGATES: Final = 19
MANY: Final = 20
# Least ratio of the smallest separation to that of chance which counts as repulsion
REPELLED: Final = 1.25
# Mean share of surrogates that come as close, by chance: 1, 2, ... of `SURROGATES` + 1
BY_CHANCE: Final = 0.5 + 0.5 / (SURROGATES + 1)
APART: Final = 0.6
# Least share of realizations in irregular motion without rests, for which such motion is judged
ENOUGH: Final = 0.05
PHASES_FOUND: Final = "independent landings at the phases found"
SHIFTED: Final = "surrogates shifted by whole periods"
UNIFORM: Final = "independent landings at uniform phases"
# Reading, number, variable, bound and null model; {} is the number of particles
COMPARED: Final = (
    (
        "separations of {} exceed those of chance",
        "mean z = Λ dt_min of {} irregular particles, 1 by chance",
        "dt_min_over_chance",
        REPELLED,
        PHASES_FOUND,
    ),
    (
        "they exceed those of shifted copies, N = {}",
        f"mean share of surrogates that come as close, {BY_CHANCE} by chance",
        "dt_min_surrogate_share",
        APART,
        SHIFTED,
    ),
)


def repulsion_figures(plan: Plan) -> dict[str, Figure]:
    """Figure of `repulsion`."""
    one = Plan(plan.threads, seeds=1, realizations=1600)
    curves = {
        f"{words}, N = {n}": _irregular(one, base, setting.over(**_RANGES), n)
        for words, base, setting in (
            ("law reflect", HIGH_BOUNCE, REFLECT),
            ("moving base", MOVING, FIRST),
        )
        for n in (FEW, MANY)
    }
    return {
        "claim24_separations_against_chance": for_file(
            separations_over_chance, list(curves.values()), list(curves)
        )
    }


_RANGES: Final = {"amplitude": STRONG, "phase": ANY_PHASE}


def repulsion(plan: Plan, base: str) -> Evidence:
    """Particles that approach synchronous impact repel each other, sec. 2.1."""
    readings, numbers = [], []
    settings = [setting.over(**_RANGES) for setting in settings_of(base)]
    for particles in (FEW, MANY):
        each = [(there, _irregular(plan, base, there, particles)) for there in settings]
        for name, what, variable, least, null in COMPARED:
            checks = [
                check(
                    what.format(particles),
                    _mean(found, variable),
                    "at least",
                    least,
                    setting=there.against(null),
                )
                for there, found in each
            ]
            readings.append(Reading(name.format(particles), checks))
        for there, found in each:
            numbers += _in_units_of_chance(found, base, particles, there)
    return Evidence(base, readings, numbers=(*numbers, *_of_sweeps(plan, base)))


def _irregular(plan: Plan, base: str, setting: Setting, particles: int) -> xr.Dataset:
    """Compare staggered particles under strong excitation with chance, by realization."""
    since, until = WINDOW
    each = [
        order_against_chance(record, since=since, surrogates=SURROGATES, seed=plan.first_seed)
        for record in records(
            plan,
            base,
            setting.drawn(plan, scale=PART / setting.part**0.5),
            launch_time=np.arange(particles) / particles,
            duration=until,
        )
    ]
    return xr.concat(each, "realization")


def _known(found: xr.Dataset) -> xr.Dataset:
    """Select realizations whose landings are samples of a density, without rests and clusters."""
    return found.isel(realization=np.isfinite(found["dt_min_over_chance"].values))


def _mean(found: xr.Dataset, name: str) -> Estimate:
    values = _known(found)[name].values
    enough = values.size >= ENOUGH * found.sizes["realization"]
    return mean(values) if enough else Estimate(np.nan, np.nan, np.nan, 0)


def _in_units_of_chance(
    found: xr.Dataset, base: str, particles: int, setting: Setting
) -> list[Number]:
    """Phases, order parameter and gaps, where irregular motion lasts."""
    if setting.name != (REFLECT if base == HIGH_BOUNCE else FIRST).name:
        return []
    words = {
        "phase_factor": ("coincidences, relative to uniform phases", UNIFORM),
        "order_over_chance": ("N R^2 of the order parameter, 1 by chance", UNIFORM),
        "gap_chance": ("probability of a gap as small, 1/2 by chance", UNIFORM),
    }
    return [
        number(
            f"{text}; mean, N = {particles}, {setting.name}",
            _mean(found, name),
            setting=setting.against(null),
        )
        for name, (text, null) in words.items()
    ]


def _of_sweeps(plan: Plan, base: str) -> list[Number]:
    """Mean z of the realizations without rests in 12 s, from the launch on."""
    found = []
    for setting in laws(base, FIRST):
        for particles in (FEW, MANY):
            swept = measured(
                plan,
                base,
                setting.drawn(plan),
                particles=particles,
                duration=12.0,
                separation=True,
                per_particle=True,
            )
            found.append(
                number(
                    f"mean z of staggered launches without rests in 12 s, N = {particles}, "
                    f"{setting.name}",
                    _mean(separations_against_chance(swept), "dt_min_over_chance"),
                    setting=setting.against(UNIFORM),
                )
            )
    return found
