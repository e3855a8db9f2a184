"""Claims 18 and 19: motion that is steady after 20 s, and repeats that agree within 8 %."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep import theory
from vibrosweep.model.status import Regime
from vibrosweep.study.estimates import Estimate, share
from vibrosweep.study.samples import ANY_PHASE, Plan, Setting, measured, settings_of
from vibrosweep.study.verdict import (
    NEARLY_ALL,
    Check,
    Evidence,
    Outcome,
    Reading,
    check,
)

__all__ = ["repeatable", "steady"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Of the laboratory, Hz: amplitude and launch of Table 1 are scaled so that flights in forcing
# periods are the same
LABORATORY: Final = (8.0, 35.0)
BEGIN: Final = 20.0  # of a film, s
FILM: Final = 40.0  # s
LATER: Final = 1000.0  # s
UNCERTAINTY: Final = 0.05
VARIATION: Final = 0.08
REPEATS: Final = 4
# By which a setting may differ from one day to the next
ADJUSTMENT: Final = 0.01


def _scaled(drawn: dict[str, Array]) -> dict[str, Array]:
    """The same motion in forcing periods at the frequencies drawn."""
    f = drawn["frequency"]
    return drawn | {"amplitude": drawn["amplitude"] / f, "launch_velocity": 5.0 / f}


def steady(plan: Plan) -> Outcome:
    """Steady conditions are reached after 20 s, sec. 3.2.6."""
    return Outcome([_steady(plan, base) for base in theory.FIXED])


def _steady(plan: Plan, base: str) -> Evidence:
    frequencies = {"the model's 1 Hz": (1.0, 1.0), "the laboratory's 8 to 35 Hz": LABORATORY}
    readings = []
    for name, ends in frequencies.items():
        checks = []
        for setting in settings_of(base):
            drawn = _scaled(setting.drawn(plan, frequency=ends, phase=ANY_PHASE))
            first, later = (
                _film(plan, base, drawn, setting, begin)["rebound_height_mean"].values
                for begin in (BEGIN, LATER)
            )
            # one that comes to rest for good after the first film was not steady in it
            known = np.isfinite(first)
            same = np.abs(first[known] / later[known] - 1.0) <= UNCERTAINTY
            what = (
                "share of particles whose mean height from 20 s to 60 s is that from 1000 s to "
                "1040 s, to 5 %"
            )
            checks.append(check(what, share(same), "at least", NEARLY_ALL, setting=setting.name))
        readings.append(Reading(name, checks))
    return Evidence(base, readings)


def _film(
    plan: Plan, base: str, drawn: dict[str, Array], setting: Setting, begin: float, **keys: Any
) -> xr.Dataset:
    return measured(
        plan,
        base,
        drawn,
        setting.constants,
        particles=1,
        transient=begin,
        duration=begin + FILM,
        **keys,
    )


def repeatable(plan: Plan) -> Outcome:
    """Heights and flight times of repeats vary by less than 8 %, secs. 3.2.8 and 3.3.3."""
    return Outcome([_repeatable(plan, base) for base in theory.FIXED])


def _repeatable(plan: Plan, base: str) -> Evidence:
    exact, adjusted, locked = [], [], []
    for setting in settings_of(base):
        films = _repeats(plan, base, setting, 0.0)
        exact.append(_agreeing(films, setting))
        adjusted.append(_agreeing(_repeats(plan, base, setting, ADJUSTMENT), setting))
        locked.append(_agreeing(films, setting, _one_mode(films)))
    return Evidence(
        base,
        readings=(
            Reading("the same setting, released at any phase", exact),
            Reading("settings of e and A repeated to 1 %, released at any phase", adjusted),
        ),
        conditions=(Reading("all four repeats lock to the same mode", locked),),
    )


def _repeats(plan: Plan, base: str, setting: Setting, adjustment: float) -> list[xr.Dataset]:
    """Four films of each setting; particles are released by hand, at any phase."""
    drawn = _scaled(setting.drawn(plan, frequency=LABORATORY))
    random = np.random.default_rng([plan.first_seed, REPEATS])
    size = drawn["restitution"].size
    films = []
    for _ in range(REPEATS):
        factors = 1.0 + random.uniform(-adjustment, adjustment, (2, size))
        changed = {
            "restitution": np.minimum(drawn["restitution"] * factors[0], 1.0),
            "amplitude": drawn["amplitude"] * factors[1],
            "phase": random.uniform(*ANY_PHASE, size),
        }
        films.append(_film(plan, base, drawn | changed, setting, BEGIN, regimes=True))
    return films


def _agreeing(films: list[xr.Dataset], setting: Setting, chosen: Flags | None = None) -> Check:
    """Test of the coefficients of variation, of settings that bounce in all repeats."""
    each = [
        np.stack([film[name].values for film in films])
        for name in ("rebound_height_mean", "flight_time_mean")
    ]
    bounce = np.isfinite(each[0]).all(axis=0) & (True if chosen is None else chosen)
    within = [one.std(axis=0, ddof=1) < VARIATION * one.mean(axis=0) for one in each]
    agree: Estimate = share((within[0] & within[1])[bounce])
    what = "share of settings whose four heights and flight times vary by less than 8 %"
    return check(what, agree, "at least", NEARLY_ALL, setting=setting.name)


def _one_mode(films: list[xr.Dataset]) -> Flags:
    locked = [film["regime"].values[:, 0] == Regime.LOCKED for film in films]
    cycles = [film[f"cycle_{of}"].values[:, 0] for of in ("impacts", "periods") for film in films]
    alike = [np.ptp(cycles[i : i + REPEATS], axis=0) == 0 for i in (0, REPEATS)]
    return np.asarray(np.all(locked, axis=0) & alike[0] & alike[1])
