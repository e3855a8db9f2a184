"""Claims 1 and 2: decay without excitation, and the balance of energy."""

from __future__ import annotations

from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep import simulate
from vibrosweep.analysis.energy import energy_balance
from vibrosweep.analysis.returns import return_map
from vibrosweep.model import theory
from vibrosweep.study.batches import random_sample
from vibrosweep.study.figures.balance import balance_against_rests, energy_decay
from vibrosweep.study.verdict import Check, Number, Outcome, Picture

__all__ = ["balance", "decay"]

RESTITUTIONS: Final = (0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99)
# Landing times up to 1e5 s are rounded to 1e-11 s, and their phase enters the kick
ROUNDING: Final = 1e-9
# An orbit settles by the factor sqrt(e) per impact: by this many factors exp(1) in all
SETTLED: Final = 30.0


def decay(threads: int) -> Outcome:
    """Without excitation the energy decays exponentially and the particle comes to rest."""
    e = np.array(RESTITUTIONS)
    record = simulate(restitution=e, amplitude=0.0, duration=150.0, threads=threads)
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
    per_impact = (
        Check(
            "energy after an impact over e^2 times that before, largest deviation from 1",
            float(max(ratios)),
            "at most",
            1e-12,
        ),
        Check(
            "share of particles that come to rest for good",
            float(np.mean(at_rest)),
            "at least",
            1.0,
        ),
        Check(
            "time at rest against (2 v0 / g)(1 - e^n) / (1 - e), largest relative deviation",
            float(max(rest_errors)),
            "at most",
            1e-9,
        ),
    )
    in_time = Check(
        "decay per second at the last flight over that at the first (1 if exponential in time), "
        "largest",
        float(max(rates)),
        "at most",
        1.01,
    )
    table_1 = simulate(restitution=0.9, amplitude=0.0, duration=12.0, threads=threads)
    return Outcome(
        as_stated=(*per_impact, in_time),
        conditional=per_impact,
        numbers=(
            Number("impacts until rest at e = 0.9", float(table_1["impact_count"][0, 0])),
            Number(
                "time at rest at e = 0.9", float(theory.unforced_rest_time(5.0, 0.9, 1e-4)), "s"
            ),
        ),
        pictures=(
            Picture(
                "claim01_energy_decay",
                "Energy of a particle at e = 0.9 without excitation: a straight line against the "
                "number of impacts (left), not against time (right).",
                energy_decay(table_1),
            ),
        ),
    )


def balance(threads: int) -> Outcome:
    """Balance of energy, Eq. 26."""
    sample = random_sample(60)
    launch = np.arange(10) / 10
    record = simulate(**sample, launch_time=launch, duration=60.0, threads=threads)
    whole = energy_balance(record, since=30.0)
    relative = _relative(whole, "balance")
    # without the effect of the first and last speed, which a longer window makes small
    inner = _relative(whole, "rest_effect")
    known = np.isfinite(relative)
    cycles = _cycles(threads)
    rests = whole["rests"].values[known] > 0
    return Outcome(
        as_stated=(
            Check(
                "share of particles in balance to 1 %, apart from the ends of the window",
                float(np.mean(np.abs(inner[known]) <= 0.01)),
                "at least",
                1.0,
            ),
        ),
        conditional=(
            Check(
                "imbalance over one cycle relative to the loss, largest",
                float(np.max(np.abs(cycles))),
                "at most",
                ROUNDING,
            ),
        ),
        numbers=(
            Number("particles with a rest in the window, share", float(np.mean(rests))),
            Number(
                "median imbalance relative to the loss, particles with rests",
                float(np.median(np.abs(relative[known][rests]))),
            ),
            Number("cycles without rest that were tested", float(cycles.size)),
            Number(
                "balance less its two parts, largest",
                float(
                    np.nanmax(np.abs(whole["balance"] - whole["end_effect"] - whole["rest_effect"]))
                ),
                "m s-1",
            ),
        ),
        pictures=(
            Picture(
                "claim02_energy_balance",
                "Imbalance of each particle against the share of its landings that end in a rest: "
                "without rests it is the small effect of the ends of the window.",
                balance_against_rests(whole),
            ),
        ),
    )


def _relative(found: xr.Dataset, name: str) -> NDArray[np.float64]:
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray((found[name] / found["mean_loss"]).values)


def _cycles(threads: int) -> NDArray[np.float64]:
    """Relative imbalance over one cycle of each orbit without rests."""
    k, e = (v.ravel() for v in np.meshgrid(np.arange(1.0, 5.0), np.array(RESTITUTIONS)))
    ends = theory.amplitude_min(k, e), theory.amplitude_max(k, e)
    middle = 0.5 * (ends[0] + ends[1])
    found = []
    for mode, restitution, amplitude in zip(k, e, middle, strict=True):
        phase = float(theory.locked_phase(mode, restitution, amplitude))
        record = simulate(
            restitution=restitution,
            amplitude=amplitude,
            launch_velocity=float(theory.locked_velocity(mode)),
            launch_time=phase + 1e-3,
            duration=float(2.0 * SETTLED * mode / -np.log(restitution)),
            threads=threads,
        )
        found.append(_relative(energy_balance(record, impacts=1), "balance")[0, 0])
    doubled = simulate(
        amplitude=3.05, launch_velocity=4.905, launch_time=0.4737, duration=2000.0, threads=threads
    )
    found.append(_relative(energy_balance(doubled, impacts=2), "balance")[0, 0])
    return np.array(found)
