"""Claims 25 and 29: heights settle from a transient, and energy is replenished."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr

from study.arrays import Array
from study.bases import BASES, SPRUNG
from study.estimates import magnitude, mean, share
from study.samples import (
    ANY_PHASE,
    FEW,
    FOLLOWED,
    Plan,
    by_seed,
    laws,
    measured,
    mount,
    records,
    settings_of,
    single,
)
from study.verdict import Check, Evidence, Reading, check, nearly_all, number

# Fig. 1 shows 12 s: its first and last third
EARLY: Final = (0.0, 4.0)
LATE: Final = (8.0, 12.0)
DECAYED: Final = 0.9
LEFT: Final = 0.01  # least ratio of heights of a particle that still bounces
SINCE: Final = 30.0  # s
UNTIL: Final = 150.0
PART: Final = {base: FOLLOWED if base == SPRUNG else 0.4 for base in BASES}  # of realizations
ROUGHLY: Final = 0.1


def transient_decays(plan: Plan, base: str) -> Evidence:
    """Heights decay from a large transient to a bounded oscillation, Fig. 1."""
    as_told: list[Check] = []
    anywhere: list[Check] = []
    for setting in laws(base):
        what = "greatest height from 8 s to 12 s over that in the first 4 s"
        ratio = _decay(plan, base, single(setting))[0]
        as_told += [
            check(what, ratio, "at most", DECAYED, setting=setting),
            check(what, ratio, "at least", LEFT, setting=setting),
        ]
        there = setting.over(phase=ANY_PHASE)
        ratios = _decay(plan, base, there.drawn(plan, scale=1.0 / there.part))
        what = "share of launches in which it is 0.01 to 0.9"
        anywhere.append(nearly_all(what, (ratios <= DECAYED) & (ratios >= LEFT), there))
    return Evidence(
        base,
        readings=(
            Reading("launched at t = 0, as in Fig. 1", as_told),
            Reading("launched at any phase", anywhere),
        ),
    )


def _decay(plan: Plan, base: str, columns: dict[str, Any]) -> Array:
    """Greatest height in the last third over that in the first; 0 if the last has no flights."""
    first, last = (
        measured(plan, base, columns, particles=1, transient=begin, duration=end)
        for begin, end in (EARLY, LATE)
    )
    late = np.nan_to_num(last["rebound_height_max"].values)
    return np.asarray(late / first["flight_height_max"].values)


def replenished(plan: Plan, base: str) -> Evidence:
    """The excitation replenishes what impacts dissipate, secs. 2.1.2 and 3."""
    checks, averages, numbers = [], [], []
    for setting in settings_of(base):
        ratio = setting.constants.get("mass_ratio", mount(base).get("mass_ratio", 0.0))
        each = [
            energies(record, ratio)
            for record in records(
                plan,
                base,
                setting.drawn(plan, scale=PART[base]),
                launch_time=np.arange(FEW) / FEW,
                duration=UNTIL,
            )
        ]
        injected, lost = np.concatenate(each, axis=1)
        known = np.isfinite(injected) & np.isfinite(lost)
        balanced = np.abs(injected[known] / lost[known] - 1.0) <= ROUGHLY
        what = "share of particles without rests that gain what they lose, to 10 %"
        checks.append(nearly_all(what, balanced, setting))
        sums = (by_seed(plan, np.where(known, one, 0.0)).sum(axis=1) for one in (injected, lost))
        with np.errstate(invalid="ignore", divide="ignore"):
            off = magnitude(mean(np.divide(*sums) - 1.0))
        what = "energy injected over that dissipated, all particles together, deviation from 1"
        averages.append(check(what, off, "at most", ROUGHLY, setting=setting))
        if setting.name == settings_of(base)[0].name:
            numbers = [
                number(
                    f"energy {word} per mass and impact, median, without rests",
                    float(np.median(one[known])) if known.any() else np.nan,
                    "m2 s-2",
                    setting,
                )
                for word, one in (("injected", injected), ("dissipated", lost))
            ]
            numbers.append(number("particles without rests, share", share(known), setting=setting))
    return Evidence(
        base,
        (Reading("each particle that bounces without rests", checks),),
        (Reading("in the mean over particles without rests", averages),),
        numbers,
    )


def energies(record: xr.Dataset, mass_ratio: float) -> Array:
    """Energy per mass and impact that each particle receives and that its impacts dissipate.

    Shape (2, particle) over all realizations; NaN if a particle rests in the window, or has fewer
    than two landings there.  An impact turns the speed of arrival v into v' and dissipates
    (1 - e^2) c^2 / 2(1 + mu), with c = (1 + mu)(v + v')/(1 + e), the speed of approach; on the map
    it is relative to the moving base that the kick represents.
    """
    e = np.broadcast_to(record["restitution"].values, record.sizes["realization"])
    factor = ((1.0 - e) * (1.0 + mass_ratio) / (1.0 + e) / 2.0)[:, np.newaxis, np.newaxis]
    landing, after = record["landing_time"].values, record["rebound_velocity"].values
    flown = landing[..., 1:] - record["liftoff_time"].values[..., :-1]
    before = float(record["gravity"]) * flown - after[..., :-1]
    after = after[..., 1:]
    gain = (after**2 - before**2) / 2.0
    with np.errstate(invalid="ignore"):
        inside = np.isfinite(gain) & (landing[..., 1:] >= SINCE)
        rests = ((record["rested"].values[..., 1:] == 1) & (landing[..., 1:] >= SINCE)).any(axis=-1)
    lost = factor * (before + after) ** 2
    count = np.where(rests, 0, inside.sum(axis=-1)).astype(np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        means = [
            np.where(inside, one, 0.0).sum(axis=-1) / np.where(count > 1, count, np.nan)
            for one in (gain + lost, lost)
        ]
    return np.stack([one.ravel() for one in means])
