"""Claims 1, 2 and 15: decay without excitation, balance of energy, decay under weak excitation."""

from __future__ import annotations

from typing import Final

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from study.arrays import Array
from study.bases import HIGH_BOUNCE
from study.figures.balance import balance_against_rests, energy_decay
from study.records import energy_balance
from study.samples import (
    ANY_PHASE,
    FIRST,
    SMALLER,
    Plan,
    Setting,
    measured,
    records,
    settings_of,
)
from study.verdict import (
    Check,
    Evidence,
    Reading,
    check,
    nearly_all,
    number,
)
from vibrosweep import simulate, theory
from vibrosweep.analysis import return_map
from vibrosweep.figures.style import for_file

RESTITUTIONS: Final = (0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99)
# Landing times up to 1e5 s are rounded to 1e-11 s, and their phase enters the kick
ROUNDING: Final = 1e-9
# Offsets from an orbit decay to exp(-SETTLED), at the slowest by sqrt(e) per impact
SETTLED: Final = 30.0
ROUGHLY: Final = 0.1  # relative deviation that "about" in Eq. 26 allows
# "A much smaller than 1", m s-1
WEAK: Final = (0.01, 0.1)
# Share of the realizations that is simulated: enough, because a quarter of them never rest
PART: Final = 0.5
FIRST_HEIGHT: Final = 5.0**2 / (2.0 * 9.81)


def decay_figures(plan: Plan) -> dict[str, Figure]:
    """Figure of `decay`."""
    pictured = simulate(restitution=0.9, amplitude=0.0, duration=12.0, threads=plan.threads)
    return {"claim01_energy_decay": for_file(energy_decay, pictured)}


def decay(plan: Plan, base: str) -> Evidence:
    """Without excitation the energy decays exponentially and the particle comes to rest."""
    e = np.array(RESTITUTIONS)
    record = simulate(restitution=e, amplitude=0.0, duration=150.0, base=base, threads=plan.threads)
    ratios, rates, rest_errors = [], [], []
    rest_time = theory.unforced_rest_time(5.0, e, 1e-4)
    for i in range(e.size):
        speed = return_map(record, realization=i)
        energy = np.append(speed["arrival_speed"], speed["next_arrival_speed"][-1:]) ** 2
        ratios.append(np.max(np.abs(energy[1:] / energy[:-1] / e[i] ** 2 - 1.0)))
        # between impacts n and n + 1 the energy falls by e^2 in a flight of 2 v / g
        rates.append(float(speed["arrival_speed"][0] / speed["arrival_speed"][-1]))
        last = record["landing_time"].values[i, 0, int(record["impact_count"][i, 0]) - 1]
        rest_errors.append(abs(last / rest_time[i] - 1.0))
    at_rest = (record["rested"].values[:, 0] == 1).any(axis=-1)
    rests = check("share of particles that come to rest", np.mean(at_rest), "at least", 1.0)
    return Evidence(
        base,
        setting=Setting(
            "without excitation", constants={"restitution": RESTITUTIONS, "amplitude": 0.0}
        ),
        readings=(
            Reading(
                "exponential in the number of impacts",
                (
                    check(
                        "energy after an impact over e^2 times that before, largest deviation "
                        "from 1",
                        np.max(ratios),
                        "at most",
                        ROUNDING,
                    ),
                    rests,
                ),
            ),
            Reading(
                "exponential in time",
                (
                    check(
                        "rate of decay per second at the last flight over that at the first, "
                        "largest",
                        np.max(rates),
                        "at most",
                        1.01,
                    ),
                    rests,
                ),
            ),
        ),
        numbers=(
            number("time until rest at e = 0.9", float(rest_time[RESTITUTIONS.index(0.9)]), "s"),
            number("the closed form of that time, largest relative error", np.max(rest_errors)),
        ),
    )


def balance_figures(plan: Plan) -> dict[str, Figure]:
    """Figure of `balance`."""
    sample = FIRST.drawn(Plan(seeds=1, realizations=60))
    record = simulate(
        restitution=sample["restitution"],
        amplitude=sample["amplitude"],
        launch_time=np.arange(10) / 10,
        duration=60.0,
        threads=plan.threads,
    )
    return {
        "claim02_energy_balance": for_file(
            balance_against_rests, energy_balance(record, since=30.0)
        )
    }


def balance(plan: Plan, base: str) -> Evidence:
    """Balance of energy, Eq. 26."""
    every, without = [], []
    left: list[float] = []
    for setting in settings_of(base):
        there = setting.over(phase=ANY_PHASE)
        found = [
            energy_balance(record, since=30.0).isel(particle=0)
            for record in records(
                plan,
                base,
                there.drawn(plan, scale=PART),
                launch_time=0.0,
                duration=60.0,
            )
        ]
        off, inside = (np.concatenate(each) for each in zip(*map(_relative, found), strict=True))
        known = np.isfinite(off)
        free = known & (np.concatenate([one["rests"].values for one in found]) == 0)
        every.append(_in_balance("that bounce", off[known], there))
        without.append(_in_balance("that never rest", off[free], there))
        if base == HIGH_BOUNCE and there.law == "rest":
            left.append(float(np.max(inside[free], initial=0.0)))
    cycles, doubled = _cycles(plan, base), _doubled(plan, base)
    return Evidence(
        base,
        readings=(
            Reading("every particle that bounces", every),
            Reading("particles that never rest", without),
        ),
        conditions=(
            Reading(
                "over whole cycles of an orbit of one impact per cycle, without rests",
                (
                    check(
                        "imbalance relative to the loss, largest",
                        np.max(np.abs(cycles)),
                        "at most",
                        ROUNDING,
                    ),
                ),
            ),
        ),
        numbers=(
            *(
                number(
                    "imbalance of particles that never rest, the ends of the window subtracted: "
                    "an identity; largest, relative to the loss",
                    one,
                    setting=FIRST.over(phase=ANY_PHASE),
                )
                for one in ([max(left)] if left else [])
            ),
            number("cycles without rests that were tested", cycles.size),
            number("imbalance over a cycle of two impacts, relative to the loss", abs(doubled)),
        ),
    )


def _in_balance(whose: str, off: Array, setting: Setting) -> Check:
    what = f"share of particles {whose} in balance to 10 %"
    return nearly_all(what, off <= ROUGHLY, setting)


def _relative(found: xr.Dataset) -> tuple[Array, Array]:
    """Imbalance relative to the loss, and the same without the effect of first and last speed.

    For the map without rests the latter is identically 0, whatever the motion.
    """
    balance, loss = found["balance"].values, found["mean_loss"].values
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.abs(balance / loss), np.abs((balance - found["end_effect"].values) / loss)


def _cycles(plan: Plan, base: str) -> Array:
    """Relative imbalance over one cycle of locked orbits in the middle of their windows."""
    k, e = (v.ravel() for v in np.meshgrid(np.arange(1.0, 5.0), np.array(RESTITUTIONS)))
    low, high = (end(k, e, base=base) for end in (theory.amplitude_min, theory.amplitude_max))
    middle = 0.5 * (low + high)
    record = simulate(
        restitution=e,
        amplitude=middle,
        launch_velocity=theory.locked_velocity(k),
        phase=2.0 * np.pi * (theory.locked_phase(k, e, middle) + 1e-3),
        launch_time=0.0,
        duration=float(2.0 * SETTLED * k.max() / -np.log(e.max())),
        base=base,
        threads=plan.threads,
    )
    return _imbalance(record, 1)


def _doubled(plan: Plan, base: str) -> float:
    """Relative imbalance over a cycle of two impacts, just above the window of mode 1."""
    amplitude = 1.01 * float(theory.amplitude_max(1, 0.9, base=base))
    record = simulate(
        amplitude=amplitude,
        launch_velocity=4.905,
        launch_time=float(theory.locked_phase(1, 0.9, amplitude)) + 1e-3,
        duration=4000.0,
        base=base,
        threads=plan.threads,
    )
    return float(_imbalance(record, 2)[0])


def _imbalance(record: xr.Dataset, impacts: int) -> Array:
    found = energy_balance(record, impacts=impacts).isel(particle=0)
    return np.asarray((found["balance"] / found["mean_loss"]).values)


def weak_excitation(plan: Plan, base: str) -> Evidence:
    """If the excitation is too small, dissipation dominates and the motion decays."""
    ends, low = [], []
    for setting in settings_of(base):
        there = setting.over(amplitude=WEAK, phase=ANY_PHASE)
        late = measured(
            plan,
            base,
            there.drawn(plan, scale=SMALLER[base]),
            particles=1,
            transient=400.0,
            duration=420.0,
        )
        rest = late["at_rest_count"].values == 1
        height = late["rebound_height_max"].values
        died = rest | (height <= 0.01 * FIRST_HEIGHT)
        what = "share of particles at rest for good after 400 s"
        ends.append(nearly_all(what, rest, there))
        what = "share that rise to less than 1 % of their first height after 400 s"
        low.append(nearly_all(what, died, there))
    return Evidence(
        base,
        readings=(
            Reading("decay to rest for good", ends),
            Reading("decay to less than 1 % of the first height", low),
        ),
    )
