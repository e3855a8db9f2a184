"""Claims 7 and 14: the flat band of Fig. 3, and what a larger amplitude gives."""

from __future__ import annotations

from itertools import product
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from study import light_particle
from study.arrays import Array
from study.bases import HIGH_BOUNCE, SPRUNG
from study.estimates import Estimate, magnitude, mean, share
from study.samples import (
    ANY_PHASE,
    FEW,
    FIRST,
    RANGES,
    SMALLER,
    TAU_C,
    Plan,
    Setting,
    by_seed,
    measured,
    settings_of,
)
from study.verdict import (
    NEARLY_ALL,
    Check,
    Evidence,
    Reading,
    check,
    number,
)
from vibrosweep import sobol, theory
from vibrosweep.figures import height_against_restitution, sobol_bars
from vibrosweep.figures.style import for_file

FLAT: Final = 0.1
GROUPS: Final = 5
# All seven parameters: this package's ranges of e and A, and ranges of the others around Table 1
AROUND_TABLE_1: Final[dict[str, Any]] = {
    **RANGES,
    "frequency": (0.9, 1.1),
    "phase": (-np.pi, np.pi),
    "gravity": (9.7, 9.9),
    "launch_velocity": (4.5, 5.5),
    "contact_time": (5e-5, 2e-4),
}
WINDOWS: Final = {
    "from the launch on": (0.0, 12.0),
    "the first 200 s left out": (200.0, 212.0),
}
MANY: Final = "the highest of twenty (of five on the base of finite mass)"
ANYWHERE: Final = "one particle launched at any phase"
LAUNCHES: Final = {"one particle launched at t = 0": 1, ANYWHERE: 1, MANY: 20}
PHASES: Final[dict[str, Any]] = {
    name: {"phase": ANY_PHASE} if name == ANYWHERE else {} for name in LAUNCHES
}
FORCINGS: Final[dict[str, dict[str, Any]]] = {
    "A of Table 1": {"amplitude": (1.2, 1.2)},
    "A random too": {},
}
GROWING: Final = {"height": "rebound_height_mean", "separation": "dt_min"}
FACTOR: Final = 1.2  # of the amplitude
GAIN: Final = 0.01  # a relative increase that counts


def plateau_figures(plan: Plan) -> dict[str, Figure]:
    """Figures of `plateau`."""
    one = Plan(plan.threads, seeds=1)
    drawn = FIRST.over(amplitude=(1.2, 1.2)).drawn(one)
    early, late = (
        measured(one, HIGH_BOUNCE, drawn, particles=20, transient=begin, duration=end)
        for begin, end in ((0.0, 12.0), (900.0, 1000.0))
    )
    indices = sobol(**AROUND_TABLE_1, particles=5, separation=True, seed=3, threads=plan.threads)
    return {
        "claim07_from_launch": for_file(height_against_restitution, early),
        "claim07_steady": for_file(height_against_restitution, late),
        "claim07_sobol_indices": for_file(sobol_bars, indices),
    }


def plateau(plan: Plan, base: str) -> Evidence:
    """The maximum rebound height hardly depends on the restitution, Fig. 3."""
    readings = []
    for launch, window, forcing in product(LAUNCHES, WINDOWS, FORCINGS):
        checks = [
            check(
                "change of the median maximum height from the lowest to the highest fifth of e",
                magnitude(mean(_changes(plan, base, there, launch, window))),
                "at most",
                FLAT,
                setting=there,
            )
            for setting in settings_of(base)
            for there in [setting.over(**FORCINGS[forcing], **PHASES[launch])]
        ]
        readings.append(Reading(f"{launch}; {window}; {forcing}", checks))
    e = np.linspace(*RANGES["restitution"], 37)
    height = _mode_height(base, e, 1.2)
    locked = light_particle.landing_phase if base == SPRUNG else theory.locked_phase
    followed = measured(
        plan,
        base,
        {
            "restitution": e,
            "amplitude": 1.2,
            "launch_velocity": float(theory.locked_velocity(1)),
            "phase": 2.0 * np.pi * locked(1, e, 1.2),
        },
        particles=1,
        transient=2000.0,
        duration=2012.0,
    )["rebound_height_max"].values
    return Evidence(
        base,
        readings=readings,
        conditions=(
            Reading(
                "locked on mode 1 at the amplitude of Table 1",
                (
                    check(
                        "change of the height from e = 0.80 to 0.98",
                        np.ptp(height) / height.min(),
                        "at most",
                        FLAT,
                    ),
                    check(
                        "relative deviation of simulated heights from the closed form",
                        np.max(np.abs(followed / height - 1.0)),
                        "at most",
                        1e-6,
                    ),
                ),
            ),
        ),
        numbers=(
            number("height of mode 1 at e = 0.80", height[0], "m"),
            number("height of mode 1 at e = 0.98", height[-1], "m"),
        ),
    )


def _mode_height(base: str, restitution: Array, amplitude: float) -> Array:
    """Maximum rebound height of mode 1 in m."""
    if base == HIGH_BOUNCE:
        return np.full(restitution.shape, float(theory.locked_height(1)))
    if base == SPRUNG:
        return light_particle.apex(restitution, amplitude)
    return np.asarray(theory.locked_apex(1, restitution, amplitude))


def _changes(plan: Plan, base: str, setting: Setting, launch: str, window: str) -> list[float]:
    """Relative change of the median height over the range of e, for each seed."""
    particles = FEW if base == SPRUNG and launch == MANY else LAUNCHES[launch]
    drawn = setting.drawn(plan, scale=SMALLER[base])
    begin, end = WINDOWS[window]
    found = measured(plan, base, drawn, transient=begin, duration=end, particles=particles)
    heights = by_seed(plan, found["rebound_height_max"].values)
    return [
        _change(e, height)
        for e, height in zip(by_seed(plan, drawn["restitution"]), heights, strict=True)
    ]


def _change(e: Array, height: Array) -> float:
    """Change of the median from the lowest group of e to the highest; NaN if most do not bounce."""
    order = np.argsort(e)
    size = max(1, e.size // GROUPS)
    groups = height[order[:size]], height[order[-size:]]
    if any(np.mean(np.isfinite(one)) < 0.5 for one in groups):
        return float("nan")
    lowest, highest = (float(np.nanmedian(one)) for one in groups)
    return highest / lowest - 1.0


def larger_amplitude(plan: Plan, base: str) -> Evidence:
    """A larger amplitude increases flight height and separation, sec. 2.1.1."""
    readings, conditions = [], []
    for window in WINDOWS:
        found: dict[str, list[Check]] = {name: [] for name in GROWING}
        averages: dict[str, list[Check]] = {name: [] for name in GROWING}
        for setting in settings_of(base):
            for name, (gains, on_average) in _gains(plan, base, setting, window).items():
                what = f"share of realizations in which 1.2 A gives at least 1 % more {name}"
                one = check(what, gains, "at least", NEARLY_ALL, setting=setting)
                found[name].append(one)
                what = f"gain of the mean {name} over realizations from A to 1.2 A, relative"
                averages[name].append(check(what, on_average, "at least", GAIN, setting=setting))
        readings += [Reading(f"{name}, {window}", checks) for name, checks in found.items()]
        for name, checks in averages.items():
            average = f"{name} on average over realizations, {window}"
            conditions.append(Reading(average, checks))
            if base == HIGH_BOUNCE:
                short = [one for one in checks if _contact_time(one) <= TAU_C]
                conditions.append(Reading(f"{average}, contact time at most 0.1 ms", short))
    lower, higher = (_mode_height(base, np.array([0.9]), a)[0] for a in (1.2, FACTOR * 1.2))
    gain = number("gain of height of mode 1 from A = 1.2 to 1.44 m/s, e = 0.9", higher - lower, "m")
    return Evidence(base, readings, conditions, numbers=(gain,))


def _contact_time(one: Check) -> float:
    return float(one.setting.constants.get("contact_time", TAU_C)) if one.setting else TAU_C


def _gains(
    plan: Plan, base: str, setting: Setting, window: str
) -> dict[str, tuple[Estimate, Estimate]]:
    """Compare height and separation at A and at a larger amplitude.

    Returns for each the share of realizations that gain, and the relative gain of the mean.
    """
    begin, end = WINDOWS[window]
    # on a base of finite mass the time before the window takes most of the computation
    scale = 0.5 * SMALLER[base] if base == SPRUNG and begin else 1.0
    drawn = setting.drawn(plan, scale=scale)
    lower, higher = (
        measured(
            plan,
            base,
            drawn | {"amplitude": factor * drawn["amplitude"]},
            particles=FEW,
            transient=begin,
            duration=end,
            separation=True,
        )
        for factor in (1.0, FACTOR)
    )
    gains = {}
    for name, measure in GROWING.items():
        less, more = lower[measure].values, higher[measure].values
        known = np.isfinite(less) & np.isfinite(more)
        sums = (by_seed(plan, np.where(known, one, 0.0)).sum(axis=1) for one in (less, more - less))
        total, gained = (each / max(1, np.count_nonzero(known)) * plan.seeds for each in sums)
        on_average = (
            mean(gained / total.mean()) if total.any() else Estimate(np.nan, np.nan, np.nan)
        )
        gains[name] = share(more[known] > (1.0 + GAIN) * less[known]), on_average
    return gains
