"""Claims 5 and 16: windows of stable operation, and irregular motion above them."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray

from study import light_particle
from study.arrays import Array, Flags
from study.bases import FIXED, HIGH_BOUNCE, MOVING, SPRUNG
from study.estimates import share
from study.figures.curves import times_to_rest
from study.samples import (
    ANY_PHASE,
    FIRST,
    LAWS,
    SMALLER,
    Plan,
    Setting,
    irregular,
    measured,
    settings_of,
)
from study.verdict import (
    NEARLY_ALL,
    SOME,
    Check,
    Evidence,
    Reading,
    check,
    nearly_all,
    number,
)
from vibrosweep import Regime, theory
from vibrosweep import windows as find_windows
from vibrosweep.figures import parameter_plane
from vibrosweep.figures.style import for_file

# Orbits at e = 0.98 settle to the last bit, by sqrt(e) per impact, in half this time, s
HORIZON: Final = 8000.0
# The same for four periods per impact at the ends of windows, where they settle more slowly
SETTLED: Final = 40000.0
RESTITUTIONS: Final = np.linspace(0.5, 0.98, 12)
MODES: Final = (1, 2, 3, 4)
# Modes and restitutions on the base of finite mass whose windows no resonance with the mount cuts
LOW_MODES: Final = (1, 2)
DISSIPATIVE: Final = np.linspace(0.5, 0.9, 9)
CLOSE: Final = dict.fromkeys(FIXED, "launched close to the locked orbit") | {
    SPRUNG: "launched close to the locked orbit, away from resonances of the mount (e up to 0.9)"
}
STRONG: Final = (4.0, 12.0)  # "A much larger than 1", m s-1
FOLLOWED_FOR: Final = 1e6  # longest time in which a rest is awaited, s


def windows_figures(plan: Plan) -> dict[str, Figure]:
    """Figure of `windows`."""
    plane_e, plane_a = np.meshgrid(np.linspace(0.5, 0.98, 49), np.linspace(0.1, 4.0, 40))
    plane = measured(
        plan,
        HIGH_BOUNCE,
        {"restitution": plane_e.ravel(), "amplitude": plane_a.ravel()},
        particles=20,
        duration=HORIZON,
        regimes=True,
    )
    locked = plane["locked_count"] / plane.attrs["particles"]
    plane["locked_share"] = locked.assign_attrs(long_name="share of launches that lock", units="1")
    return {"claim05_locked_share": for_file(parameter_plane, plane, variable="locked_share")}


def windows(plan: Plan, base: str) -> Evidence:
    """Stable operation in A_min < A < A_max, Eq. 27."""
    stable = {"periodic": (Regime.LOCKED, Regime.RESTING), "locked": (Regime.LOCKED,)}
    found: dict[str, list[Check]] = {name: [] for name in stable}
    for setting in settings_of(base):
        inside, outside = (_launched(plan, base, setting, where) for where in ("in", "out"))
        for name, regimes in stable.items():
            within, beyond = (np.isin(each, regimes) for each in (inside, outside))
            what = f"the window of mode 1 that end {name}"
            found[name] += [
                nearly_all(f"share of launches inside {what}", within, setting),
                check(
                    f"share of launches outside {what}",
                    share(beyond),
                    "at most",
                    1.0 - NEARLY_ALL,
                    setting=setting,
                ),
            ]
    return Evidence(
        base,
        readings=[Reading(f"stable means {name}", checks) for name, checks in found.items()],
        conditions=(Reading(CLOSE[base], _close(plan, base)),),
        numbers=[
            number(f"A_{name} of mode 1 at e = 0.9", end[0], "m s-1")
            for name, end in zip(
                ("min", "max"), _ends(base, np.array([1.0]), np.array([0.9])), strict=True
            )
        ],
    )


def _ends(base: str, k: Array, e: Array) -> tuple[Array, Array]:
    """Ends of the windows of mode k, m/s."""
    if base == SPRUNG:
        return light_particle.ends(k, e)
    return theory.amplitude_min(k, e, base=base), theory.amplitude_max(k, e, base=base)


def _launched(plan: Plan, base: str, setting: Setting, where: str) -> NDArray[Any]:
    """Regimes of launches at any phase, at amplitudes in the window of mode 1 or outside it."""
    there = setting.over(amplitude=(0.0, 1.0), phase=ANY_PHASE)
    drawn = there.drawn(plan, scale=SMALLER[base])
    e, part = drawn["restitution"], drawn["amplitude"]
    # for a base that recoils take the window of a heavy one, whose ends are within some per cent
    solid = MOVING if base == SPRUNG else base
    low, high = (end(1, e, base=solid) for end in (theory.amplitude_min, theory.amplitude_max))
    below, beyond = 2.0 * part * low, (0.5 + part) * high
    amplitude = low + part * (high - low)
    if where == "out":
        amplitude = np.where(part < 0.5, below, beyond)
    drawn = drawn | {"amplitude": amplitude}
    if base == SPRUNG:
        return light_particle.regimes(plan, drawn)
    found = measured(plan, base, drawn, particles=1, duration=HORIZON, regimes=True)
    return np.asarray(found["regime"].values[:, 0])


def _close(plan: Plan, base: str) -> list[Check]:
    modes, restitutions = (LOW_MODES, DISSIPATIVE) if base == SPRUNG else (MODES, RESTITUTIONS)
    k, e = (v.ravel() for v in np.meshgrid(np.array(modes, np.float64), restitutions))
    low, high = _ends(base, k, e)
    width = high - low
    held = [returns(plan, base, k, e, a) for a in (low + 0.02 * width, high - 0.02 * width)]
    left = [returns(plan, base, k, e, a) for a in (0.98 * low, high + 0.02 * width)]
    what = f"share of launches 1 ms off a locked orbit that return, modes 1 to {modes[-1]}, 2 %"
    checks = [
        check(f"{what} inside the ends", np.mean(held), "at least", 1.0),
        check(f"{what} outside the ends", np.mean(left), "at most", 0.0),
    ]
    if base != SPRUNG:
        deviation = _window_deviation(plan, base)
        what = "ends found by bisection against the closed form, largest relative deviation"
        checks.append(check(what, deviation, "at most", 1e-8))
    return checks


def _window_deviation(plan: Plan, base: str) -> float:
    """Largest relative deviation of computed ends of windows from the closed form."""
    e = np.array([0.3, 0.5, 0.7, 0.9, 0.98])
    largest = 0.0
    for frequency in (1.0, 17.0):
        low = 0.9 * theory.amplitude_min(1, e[-1], frequency, base=base)
        top = 1.05 * theory.amplitude_max(MODES[-1], e[0], frequency, base=base)
        found = find_windows(
            frequency=frequency,
            base=base,
            restitution=e,
            amplitude=np.linspace(low, top, 40),
            conditions=[f"locked({k})" for k in MODES],
            threads=plan.threads,
        ).isel(direction=0)
        for i, k in enumerate(MODES):
            one = found.isel(condition=i)
            widest = one.isel(window=np.maximum(one["widest"], 0))
            ends = {
                "A_min": theory.amplitude_min(k, e, frequency, base=base),
                "A_max": theory.amplitude_max(k, e, frequency, base=base),
            }
            for name, end in ends.items():
                ratio = widest[name].values / end
                # a window that is not found stays NaN, and fails its test
                largest = float(np.maximum(largest, np.max(np.abs(ratio - 1.0))))
    return largest


def returns(
    plan: Plan, base: str, k: Array, e: Array, amplitude: Array, offset: float = 1e-3
) -> Flags:
    """Return whether launches `offset` periods off the locked orbits of mode k reach them.

    Where the orbit does not exist the launch is at the phase of the strongest kick.
    """
    if base == SPRUNG:
        return light_particle.returns(plan, k, e, amplitude, offset)
    phase = theory.locked_phase(k, e, amplitude)
    found = measured(
        plan,
        base,
        {
            "restitution": e,
            "amplitude": amplitude,
            "launch_velocity": theory.locked_velocity(k),
            "phase": 2.0 * np.pi * (np.where(np.isnan(phase), 0.25, phase) + offset),
        },
        launch=[0.0],
        particles=1,
        duration=SETTLED,
        regimes=True,
    )
    regime, impacts, periods, _ = cycles(found)
    return np.asarray((regime == Regime.LOCKED) & (impacts == 1) & (periods == k))


def cycles(found: xr.Dataset) -> list[NDArray[Any]]:
    """Regime, impacts, periods and rests of the cycle of every particle, flattened."""
    names = ("regime", "cycle_impacts", "cycle_periods", "cycle_rests")
    return [found[name].values.ravel() for name in names]


def strong_excitation_figures(plan: Plan) -> dict[str, Figure]:
    """Figure of `strong_excitation`."""
    taus = np.geomspace(1e-6, 1e-3, 4)
    each = {law: np.array([_time_to_rest(plan, law, tau) for tau in taus]) for law in LAWS}
    return {"claim16_time_to_rest": for_file(times_to_rest, taus, each, FOLLOWED_FOR)}


def _time_to_rest(plan: Plan, law: str, contact_time: float) -> float:
    """Mean time until the first rest in s, from the time at risk of all; NaN if none rests."""
    there = FIRST.over(amplitude=STRONG, phase=ANY_PHASE).with_constants(
        rebound=law, contact_time=float(contact_time)
    )
    one = Plan(plan.threads, seeds=1)
    found = measured(
        one,
        HIGH_BOUNCE,
        there.drawn(one),
        particles=1,
        duration=FOLLOWED_FOR,
        regimes=True,
    )
    # the first lift-off from rest, or the time by which an orbit without rests was entered
    until = found["recurrent_from"].values
    at_risk = np.where(np.isfinite(until), until, FOLLOWED_FOR).sum()
    rested = np.count_nonzero(found["regime"].values == Regime.RESTING)
    return float(at_risk / rested) if rested else float("nan")


def strong_excitation(plan: Plan, base: str) -> Evidence:
    """Excessive excitation may make the motion irregular."""
    some = []
    for setting in settings_of(base):
        there = setting.over(amplitude=STRONG, phase=ANY_PHASE)
        found = measured(
            plan,
            base,
            there.drawn(plan, scale=4.0),
            particles=1,
            duration=1000.0,
            regimes=True,
            lyapunov=True,
            per_particle=True,
        )
        what = "share of launches that end irregular (a positive Lyapunov exponent)"
        some.append(check(what, share(*irregular(found)), "at least", SOME, setting=there))
    return Evidence(base, (Reading("irregular at times: in at least 1 %", some),))
