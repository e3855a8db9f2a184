"""Claims 6, 8 and 26: the linearised update, the period-2 orbit, and fixed points."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray

from study.bases import HIGH_BOUNCE
from study.claims_on_windows import HORIZON, RESTITUTIONS, cycles, returns
from study.estimates import share
from study.figures.curves import decay_per_impact
from study.samples import ANY_PHASE, TABLE_1, Plan, Setting, laws, measured
from study.slots import decay_in_slot
from study.verdict import (
    SOME,
    Check,
    Evidence,
    Reading,
    check,
    nearly_all,
    number,
    without_exception,
)
from vibrosweep import Regime, simulate, theory
from vibrosweep.figures import return_map
from vibrosweep.figures.style import for_file

ABOVE: Final = 1.01  # just above the window, relative to its upper end
SHORT: Final = 0.2  # s
LAUNCH_SPEEDS: Final = (0.5, 12.0)  # m s-1


def linearised_update_figures(plan: Plan) -> dict[str, Figure]:
    """Figure of `linearised_update`."""
    at = np.linspace(0.6, 2.95, 9)
    measured_decay = np.array([_fitted_decay(plan, HIGH_BOUNCE, a) for a in at])
    fitted = xr.Dataset({"modulus_fitted": ("amplitude", measured_decay)}, coords={"amplitude": at})
    return {"claim06_decay_per_impact": for_file(decay_per_impact, 0.9, fitted)}


def linearised_update(plan: Plan, base: str) -> Evidence:
    """The linearised update of sec. 2.1.2 decides stability."""
    e, part = (v.ravel() for v in np.meshgrid(RESTITUTIONS, np.linspace(0.05, 0.95, 19)))
    low, high = theory.amplitude_min(1, e, base=base), theory.amplitude_max(1, e, base=base)
    both_e = np.tile(e, 2)
    amplitude = np.concatenate([low + part * (high - low), (1.05 + part) * high])
    stable = returns(plan, base, np.ones_like(both_e), both_e, amplitude, 1e-6)
    full = np.abs(theory.multipliers(1, both_e, amplitude, base=base)).max(axis=-1)
    return Evidence(
        base,
        readings=(
            Reading(
                "as printed: the multiplier is e",
                (
                    check(
                        "share of unstable orbits that the update calls unstable",
                        np.mean(both_e[~stable] >= 1.0),
                        "at least",
                        1.0,
                    ),
                    check(
                        "share of stable orbits that it calls stable",
                        np.mean(both_e[stable] < 1.0),
                        "at least",
                        1.0,
                    ),
                ),
            ),
        ),
        setting=Setting(
            "grid",
            {"restitution": (RESTITUTIONS[0], RESTITUTIONS[-1])},
            {"amplitude": "A_min to 2 A_max"},
        ),
        numbers=(
            number(
                "orbits that the multipliers of the whole map, which the study does not derive, "
                "judge rightly, share",
                np.mean((full < 1.0) == stable),
            ),
            number("locked orbits tested", stable.size),
            number("of these unstable, share", np.mean(~stable)),
            number("decay per impact at Table 1, measured", _fitted_decay(plan, base, 1.2)),
            number(
                "the same, with the change of the impact time",
                np.abs(theory.multipliers(1, 0.9, 1.2, base=base)).max(),
            ),
            number("the same, without it", 0.9),
        ),
    )


def _fitted_decay(plan: Plan, base: str, amplitude: float) -> float:
    """Decay per impact of the separation of two particles near the locked orbit of mode 1."""
    return float(decay_in_slot(plan, base, amplitude, 1e-4)["modulus_fitted"])


def period_two_figures(plan: Plan) -> dict[str, Figure]:
    """Figure of `period_two`."""
    pictured = simulate(launch_time=np.arange(20) / 20, duration=300.0, threads=plan.threads)
    return {"claim08_return_map": for_file(return_map, pictured)}


def period_two(plan: Plan, base: str) -> Evidence:
    """At Table 1 the return map shows a stable period-2 orbit on two branches of slope e."""
    edge = float(theory.amplitude_max(1, 0.9, base=base))
    found: dict[str, list[Check]] = {}
    doubled: list[Check] = []
    for law in laws(base):
        there = law.over(launch_velocity=LAUNCH_SPEEDS, phase=ANY_PHASE)
        regime, impacts, periods, rests = _ended(plan, base, there)
        free = (regime == Regime.LOCKED) & (rests == 0)
        orbit = np.isin(regime, (Regime.LOCKED, Regime.RESTING))
        for name, flags in (
            ("two impacts per cycle, no rest", free & (impacts == 2)),
            ("two impacts per cycle, rests allowed", orbit & (impacts == 2)),
            ("two forcing periods, two impacts or more", orbit & (periods == 2) & (impacts > 1)),
        ):
            what = "share of launches that end there"
            one = check(what, share(flags), "at least", SOME, setting=there)
            found.setdefault(name, []).append(one)
        above = _near(law, ABOVE * edge)
        regime, impacts, _, rests = _ended(plan, base, above)
        what = "share of launches near mode 1 that end on two impacts per cycle without rest"
        on_two = (regime == Regime.LOCKED) & (impacts == 2) & (rests == 0)
        doubled.append(nearly_all(what, on_two, above))
    at_table_1 = TABLE_1.over(launch_velocity=LAUNCH_SPEEDS, phase=ANY_PHASE)
    regime, impacts, periods, rests = _ended(plan, base, at_table_1)
    free = (regime == Regime.LOCKED) & (rests == 0)
    return Evidence(
        base,
        readings=[Reading(f"at Table 1, {name}", checks) for name, checks in found.items()],
        conditions=(
            Reading(
                f"just above A_max of mode 1, at {ABOVE * edge:.3f} m/s, launched near its orbit",
                doubled,
            ),
        ),
        setting=at_table_1,
        numbers=(
            number("A_max of mode 1", edge, "m s-1"),
            number("launches at Table 1, any phase, 0.5 to 12 m/s", regime.size),
            *(
                number(
                    f"locked with one impact in {q} {'period' if q == 1 else 'periods'}, share",
                    share(free & (impacts == 1) & (periods == q)),
                )
                for q in (1, 2)
            ),
            number("on an orbit that rests, share", share(regime == Regime.RESTING)),
            number("at rest for good, share", share(regime == Regime.AT_REST)),
            number(
                "share of points within A/10 of the lines e v ± A, after flights longer than 0.2 s",
                _on_lines(plan, base),
            ),
            number("the same for a sine at random phase", 1.0 - 2.0 / np.pi * np.arcsin(0.9)),
        ),
    )


def no_fixed_point(plan: Plan, base: str) -> Evidence:
    """No stable fixed point of the return map is observed, Fig. 4."""
    checks = []
    for law in laws(base):
        there = law.over(launch_velocity=LAUNCH_SPEEDS, phase=ANY_PHASE)
        regime, impacts, _, rests = _ended(plan, base, there)
        fixed = (regime == Regime.LOCKED) & (impacts == 1) & (rests == 0)
        what = "launches that end on a fixed point: locked, each impact at the same speed"
        checks.append(without_exception(what, ~fixed, there))
    modulus = float(np.abs(theory.multipliers(1, 0.9, 1.2, base=base)).max())
    return Evidence(
        base,
        readings=(Reading("at Table 1", checks),),
        numbers=(number("decay per impact towards mode 1, from its multipliers", modulus),),
    )


def _near(setting: Setting, amplitude: float) -> Setting:
    """Launches near the orbit of mode 1 at another amplitude."""
    middle = 2.0 * np.pi * float(theory.locked_phase(1, 0.9, amplitude))
    there = setting.with_constants(amplitude=amplitude)
    return there.over(launch_velocity=(4.90, 4.91), phase=(middle - 0.01, middle + 0.01))


def _ended(plan: Plan, base: str, launches: Setting) -> list[NDArray[Any]]:
    """Cycles in which launches end."""
    drawn = launches.drawn(plan, scale=1.0 / launches.part)
    return cycles(measured(plan, base, drawn, particles=1, duration=HORIZON, regimes=True))


def _on_lines(plan: Plan, base: str) -> float:
    """Share of points of the return map near its extreme lines, at Table 1 in the first 12 s."""
    record = simulate(
        launch_time=np.arange(100) / 100, duration=12.0, base=base, threads=plan.threads
    )
    times = record["landing_time"].values[0, :, 1:]
    flights = times - record["liftoff_time"].values[0, :, :-1]
    # Micro-bounces of particles that come to rest would be many points near the origin
    kick = np.sin(2.0 * np.pi * times[flights > SHORT])
    return float(np.mean(np.abs(kick) >= 0.9))
