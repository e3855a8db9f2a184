"""Claims 18 and 19: motion is steady after 20 s, and repeats agree within 8 %."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np
import xarray as xr

from study.samples import ANY_PHASE, Plan, Setting, measured, settings_of
from study.verdict import Check, Evidence, Reading, nearly_all
from vibrosweep import theory

# Frequencies of the laboratory, Hz; amplitude and launch speed of Table 1 are scaled so that
# flights last as many forcing periods
LABORATORY: Final = (8.0, 35.0)
UNSCALED: Final[dict[str, Any]] = {"frequency": LABORATORY, "amplitude": (1.2, 1.2)}
BEGIN: Final = 20.0  # of a film, s
FILM: Final = 40.0  # s
LATER: Final = 1000.0  # s
UNCERTAINTY: Final = 0.05
VARIATION: Final = 0.08
REPEATS: Final = 4
CLOSE: Final = 0.02  # of a period
# Relative difference of a setting from one day to the next
ADJUSTMENT: Final = 0.01


def _scaled(drawn: dict[str, Any]) -> dict[str, Any]:
    """Scale parameters so that the motion in forcing periods is the same at all frequencies."""
    f = drawn["frequency"]
    return drawn | {"amplitude": drawn["amplitude"] / f, "launch_velocity": 5.0 / f}


def steady(plan: Plan, base: str) -> Evidence:
    """Steady conditions are reached after 20 s, sec. 3.2.6."""
    forcings = {
        "the model's 1 Hz": {"frequency": (1.0, 1.0)},
        "the laboratory's 8 to 35 Hz, A and launch speed scaled by 1/f": {"frequency": LABORATORY},
        "the laboratory's 8 to 35 Hz, A and launch speed of Table 1": UNSCALED,
    }
    readings = []
    for name, ranges in forcings.items():
        checks = []
        for setting in settings_of(base):
            there = setting.over(**ranges, phase=ANY_PHASE)
            drawn = there.drawn(plan)
            drawn = drawn if ranges is UNSCALED else _scaled(drawn)
            first, later = (
                _film(plan, base, drawn, begin)["rebound_height_mean"].values
                for begin in (BEGIN, LATER)
            )
            # a particle that comes to rest for good after the first film was not steady in it
            known = np.isfinite(first)
            same = np.abs(first[known] / later[known] - 1.0) <= UNCERTAINTY
            what = (
                "share of particles whose mean height from 20 s to 60 s is that from 1000 s to "
                "1040 s, to 5 %"
            )
            checks.append(nearly_all(what, same, there))
        readings.append(Reading(name, checks))
    return Evidence(base, readings)


def _film(plan: Plan, base: str, drawn: dict[str, Any], begin: float) -> xr.Dataset:
    return measured(plan, base, drawn, particles=1, transient=begin, duration=begin + FILM)


def repeatable(plan: Plan, base: str) -> Evidence:
    """Heights and flight times of repeats vary by less than 8 %, secs. 3.2.8 and 3.3.3."""
    exact: list[Check] = []
    adjusted: list[Check] = []
    unscaled: list[Check] = []
    near: list[Check] = []
    for setting in settings_of(base):
        there = setting.over(frequency=LABORATORY)
        drawn = _scaled(there.drawn(plan))
        for checks, adjustment in ((exact, 0.0), (adjusted, ADJUSTMENT)):
            checks.append(_agreeing(_repeats(plan, base, drawn, adjustment), there))
        table_1 = setting.over(**UNSCALED)
        films = _repeats(plan, base, table_1.drawn(plan), 0.0)
        unscaled.append(_agreeing(films, table_1))
        near.append(_agreeing(*_near_mode_1(plan, base, setting)))
    return Evidence(
        base,
        readings=(
            Reading("the same setting, released at any phase", exact),
            Reading("settings of e and A repeated to 1 %, released at any phase", adjusted),
            Reading("the same setting, A and launch speed of Table 1 at 8 to 35 Hz", unscaled),
        ),
        conditions=(Reading("all four released close to the orbit of mode 1", near),),
    )


def _repeats(plan: Plan, base: str, drawn: dict[str, Any], adjustment: float) -> list[xr.Dataset]:
    """Four films of each setting; particles are released by hand, at any phase."""
    random = _hand(plan)
    size = drawn["restitution"].size
    films = []
    for _ in range(REPEATS):
        factors = 1.0 + random.uniform(-adjustment, adjustment, (2, size))
        changed = {
            "restitution": np.minimum(drawn["restitution"] * factors[0], 1.0),
            "amplitude": drawn["amplitude"] * factors[1],
            "phase": random.uniform(*ANY_PHASE, size),
        }
        films.append(_film(plan, base, drawn | changed, BEGIN))
    return films


def _near_mode_1(plan: Plan, base: str, setting: Setting) -> tuple[list[xr.Dataset], Setting]:
    """Four films of amplitudes in the middle of the window, from releases near the orbit."""
    there = setting.over(frequency=LABORATORY, amplitude=(0.25, 0.75))
    drawn = there.drawn(plan)
    e, f = drawn["restitution"], drawn["frequency"]
    low, high = (end(1, e, f, base=base) for end in (theory.amplitude_min, theory.amplitude_max))
    amplitude = low + drawn["amplitude"] * (high - low)
    phase = theory.locked_phase(1, e, amplitude, f)
    orbit = {"amplitude": amplitude, "launch_velocity": theory.locked_velocity(1, f)}
    random = _hand(plan)
    films = []
    for _ in range(REPEATS):
        released = phase + random.uniform(-CLOSE, CLOSE, e.size)
        films.append(_film(plan, base, drawn | orbit | {"phase": 2.0 * np.pi * released}, BEGIN))
    name = "amplitude from 1/4 to 3/4 of the window of mode 1"
    return films, replace(there.with_constants(amplitude=name), name=setting.name)


def _hand(plan: Plan) -> np.random.Generator:
    """Random numbers for releases and adjustments by hand."""
    return np.random.default_rng([plan.first_seed, REPEATS])


def _agreeing(films: list[xr.Dataset], setting: Setting) -> Check:
    """Test of the coefficients of variation, for settings with bounces in all repeats."""
    each = [
        np.stack([film[name].values for film in films])
        for name in ("rebound_height_mean", "flight_time_mean")
    ]
    bounce = np.isfinite(each[0]).all(axis=0)
    within = [one.std(axis=0, ddof=1) < VARIATION * one.mean(axis=0) for one in each]
    what = "share of settings whose four heights and flight times vary by less than 8 %"
    return nearly_all(what, (within[0] & within[1])[bounce], setting)
