"""Claims 6 and 8: the linearised update, and the period-2 orbit."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from study.bases import FIXED, HIGH_BOUNCE
from study.claims_on_windows import HORIZON, RESTITUTIONS, cycles, returns
from study.estimates import share
from study.figures.multipliers import decay_per_impact
from study.samples import ANY_PHASE, Plan, Setting, measured
from study.verdict import (
    SOME,
    Evidence,
    Outcome,
    Picture,
    Reading,
    check,
    number,
)
from vibrosweep import Regime, simulate, theory
from vibrosweep.analysis import slot_decay
from vibrosweep.figures import return_map

ABOVE: Final = 1.01  # just above the window, relative to its upper end
SHORT: Final = 0.2  # s
LAUNCH_SPEEDS: Final = (0.5, 12.0)  # m s-1


def linearised_update(plan: Plan) -> Outcome:
    """The linearised update of sec. 2.1.2 decides stability."""
    at = np.linspace(0.6, 2.95, 9)
    measured_decay = np.array([_fitted_decay(plan, HIGH_BOUNCE, a) for a in at])
    fitted = xr.Dataset({"modulus_fitted": ("amplitude", measured_decay)}, coords={"amplitude": at})
    return Outcome(
        [_linearised(plan, base) for base in FIXED],
        [
            Picture(
                "claim06_decay_per_impact",
                "Factor by which a small offset from the locked orbit of mode 1 changes per impact "
                "(e = 0.9, the study's equations): measured, from the full multipliers, and from "
                "the update without the timing term.",
                decay_per_impact(0.9, fitted),
            )
        ],
    )


def _linearised(plan: Plan, base: str) -> Evidence:
    e, part = (v.ravel() for v in np.meshgrid(RESTITUTIONS, np.linspace(0.05, 0.95, 19)))
    low, high = theory.amplitude_min(1, e, base=base), theory.amplitude_max(1, e, base=base)
    both_e = np.tile(e, 2)
    amplitude = np.concatenate([low + part * (high - low), (1.05 + part) * high])
    stable = returns(plan, base, np.ones_like(both_e), both_e, amplitude, 1e-6)
    moduli = {
        "without the change of the impact time: the multiplier is e": both_e,
        "with the change of the impact time": np.abs(
            theory.multipliers(1, both_e, amplitude, base=base)
        ).max(axis=-1),
    }
    return Evidence(
        base,
        readings=[
            Reading(
                name,
                (
                    check(
                        "share of unstable orbits that the update calls unstable",
                        np.mean(modulus[~stable] >= 1.0),
                        "at least",
                        1.0,
                    ),
                    check(
                        "share of stable orbits that it calls stable",
                        np.mean(modulus[stable] < 1.0),
                        "at least",
                        1.0,
                    ),
                ),
            )
            for name, modulus in moduli.items()
        ],
        numbers=(
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
    phase = float(theory.locked_phase(1, 0.9, amplitude))
    record = simulate(
        amplitude=amplitude,
        launch_velocity=4.905,
        launch_time=[phase, phase + 1e-4],
        duration=450.0,
        base=base,
        threads=plan.threads,
    )
    return float(slot_decay(record)["modulus_fitted"][0])


def period_two(plan: Plan) -> Outcome:
    """At Table 1 the return map shows a stable period-2 orbit on two branches of slope e."""
    pictured = simulate(launch_time=np.arange(20) / 20, duration=300.0, threads=plan.threads)
    return Outcome(
        [_period_two(plan, base) for base in FIXED],
        [
            Picture(
                "claim08_return_map",
                "Return map of twenty launches at Table 1, the study's equations. Late points, "
                "darker, are those of the locked orbit (on the diagonal) and of the orbit that "
                "rests once in each period.",
                return_map(pictured),
            )
        ],
    )


def _period_two(plan: Plan, base: str) -> Evidence:
    regime, impacts, periods, rests = _ended(plan, base, 1.2)
    free = (regime == Regime.LOCKED) & (rests == 0)
    orbit = np.isin(regime, (Regime.LOCKED, Regime.RESTING))
    edge = float(theory.amplitude_max(1, 0.9, base=base))
    _, above_impacts, _, above_rests = above = _ended(plan, base, ABOVE * edge, near=True)
    doubled = (above[0] == Regime.LOCKED) & (above_impacts == 2) & (above_rests == 0)
    what = "share of launches that end"
    return Evidence(
        base,
        readings=[
            Reading(name, (check(f"{what} there", share(flags), "at least", SOME),))
            for name, flags in (
                ("two impacts per cycle, no rest", free & (impacts == 2)),
                ("two impacts per cycle, rests allowed", orbit & (impacts == 2)),
                (
                    "two forcing periods, two impacts or more",
                    orbit & (periods == 2) & (impacts > 1),
                ),
            )
        ],
        numbers=(
            number("A_max of mode 1", edge, "m s-1"),
            number("at 1.01 A_max, near mode 1: share that end on two impacts", share(doubled)),
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
                "points within A/10 of the lines e v ± A, after flights above 0.2 s, share",
                _on_lines(plan, base),
            ),
            number("the same for a sine at random phase", 1.0 - 2.0 / np.pi * np.arcsin(0.9)),
        ),
    )


def _ended(plan: Plan, base: str, amplitude: float, near: bool = False) -> list[NDArray[Any]]:
    """Cycles in which launches at e = 0.9 end; any launches, or those near the orbit of mode 1."""
    speeds = (4.90, 4.91) if near else LAUNCH_SPEEDS
    middle = 2.0 * np.pi * float(theory.locked_phase(1, 0.9, amplitude))
    phases = (middle - 0.01, middle + 0.01) if near else ANY_PHASE
    ranges = {"launch_velocity": speeds, "phase": phases}
    launches = Setting("launches", ranges, {"restitution": 0.9, "amplitude": amplitude}, part=1.0)
    drawn = launches.drawn(plan)
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
