"""Claims 4a and 4b: synchronous impacts are unstable, staggered motion attracts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from study.bases import BASES, HIGH_BOUNCE, SPRUNG
from study.claims_on_order import SETTLED, in_own_slots
from study.claims_on_windows import STRONG
from study.estimates import share
from study.figures.pairs import fates
from study.samples import (
    ANY_PHASE,
    FEW,
    FIRST,
    MOUNT,
    REFLECT,
    SMALLER,
    TAU_C,
    WIDE_RANGE,
    Plan,
    Setting,
    irregular,
    measured,
    settings_of,
)
from study.slots import (
    LIGHT,
    SCATTER,
    landing_phase,
    own_slots,
    own_slots_setting,
    populations,
)
from study.verdict import (
    SOME,
    Check,
    Evidence,
    Number,
    Reading,
    check,
    nearly_all,
    number,
)
from vibrosweep import simulate, theory
from vibrosweep.figures.style import for_file

# Launches nearly at once, s
NEAR: Final = 1e-6
# Least separation of two staggered particles: a quarter of even spacing over one period, s at 1 Hz
APART: Final = 0.25 * 0.5
# Duration of an observation, and the window at its end that is judged, s
LONG: Final = {base: 100.0 if base == SPRUNG else 600.0 for base in BASES}
WINDOW: Final = 10.0
# Window of exponents, which need more landings than fall into `WINDOW`, s
WINDOW_OF_EXPONENTS: Final = 500.0
PAIR: Final[Mapping[str, Any]] = {"particles": 2, "launch": [0.0, NEAR]}


def synchronous_figures(plan: Plan) -> dict[str, Figure]:
    """Figure of `synchronous`."""
    pictured = _late(
        Plan(plan.threads, seeds=1),
        HIGH_BOUNCE,
        FIRST,
        {**PAIR, "regimes": True},
    )
    return {"claim04_synchronous_pairs": for_file(fates, pictured, NEAR)}


def _late(
    plan: Plan,
    base: str,
    setting: Setting,
    scene: Mapping[str, Any],
    part: float = 1.0,
    window: float = WINDOW,
) -> xr.Dataset:
    """The end of a long observation of drawn realizations launched at any phase."""
    return measured(
        plan,
        base,
        setting.over(phase=ANY_PHASE).drawn(plan, scale=part * SMALLER[base]),
        duration=LONG[base],
        transient=LONG[base] - window,
        separation=True,
        **scene,
    )


def synchronous(plan: Plan, base: str) -> Evidence:
    """Synchronous impacts are unstable."""
    what = "share of pairs launched 1 µs apart that have drawn apart, among those that still bounce"
    checks = []
    for one in settings_of(base):
        dt = _late(plan, base, one, PAIR)["dt_min"].values
        there = one.over(phase=ANY_PHASE)
        checks.append(nearly_all(what, dt[np.isfinite(dt)] > NEAR, there))
    numbers = _bunch() if base == SPRUNG else _contraction(plan, base)
    drawn = Reading("pairs drawn at random", checks)
    condition = _in_one_slot(plan) if base == SPRUNG else _in_irregular_motion(plan, base)
    return Evidence(base, (drawn,), (condition,), numbers)


def _in_irregular_motion(plan: Plan, base: str) -> Reading:
    """Pairs under strong excitation that move irregularly, where such pairs are found.

    Particles that have rested together are one: pairs with a rest since the launch are left out.
    """
    what = "share of pairs launched 1 µs apart, both with positive exponents, that drew apart"
    checks = []
    for one in settings_of(base):
        there = one.over(amplitude=STRONG, phase=ANY_PHASE)
        irregular_pair = _pairs_with_exponents(plan, base, there)["aperiodic_count"].values == 2
        whole = _late(plan, base, there, PAIR, 1.0 / there.part, LONG[base])
        irregular_pair &= whole["rest_count"].values == 0
        if np.mean(irregular_pair) < SOME:
            irregular_pair[:] = False
        apart = _late(plan, base, there, PAIR, 1.0 / there.part)["dt_min"].values > NEAR
        checks.append(nearly_all(what, apart[irregular_pair], there))
    return Reading(
        "in irregular motion without rests, A 4 to 12 m/s, if at least 1 % of the pairs move so",
        checks,
    )


def _pairs_with_exponents(plan: Plan, base: str, setting: Setting) -> xr.Dataset:
    scene = {**PAIR, "regimes": True, "lyapunov": True, "per_particle": True}
    return _late(plan, base, setting, scene, 1.0 / setting.part, WINDOW_OF_EXPONENTS)


def _in_one_slot(plan: Plan) -> Reading:
    """Two particles launched into one slot of mode 1 of a base that recoils."""
    phase = landing_phase(1)
    record = simulate(
        **LIGHT,
        base=SPRUNG,
        launch_velocity=float(theory.locked_velocity(1)),
        launch_time=[phase, phase + NEAR],
        duration=LONG[SPRUNG],
        threads=plan.threads,
    )
    first, second = record["landing_time"].values[0]
    known = np.isfinite(first) & np.isfinite(second)
    apart = abs(float(second[known][-1] - first[known][-1]))
    one = check(
        "separation after 100 s of a pair launched 1 µs apart", apart, "at least", TAU_C, "s"
    )
    return Reading("both locked to mode 1 (e = 0.9, 0.6 g)", (one,))


def _contraction(plan: Plan, base: str) -> tuple[Number, ...]:
    modulus = np.abs(theory.multipliers(1, 0.9, 1.2, base=base)).max()
    what = "pairs in irregular motion (a positive Lyapunov exponent in the last 500 s), share"
    several = [FIRST, WIDE_RANGE, *([REFLECT] if base == HIGH_BOUNCE else [])]
    shares = [
        number(
            f"{what}; {one.name}",
            share(*irregular(_pairs_with_exponents(plan, base, one))),
            setting=one.over(phase=ANY_PHASE),
        )
        for one in several
    ]
    return (
        *shares,
        number("factor by which a small separation changes per impact at Table 1", modulus),
    )


def _bunch() -> tuple[Number, ...]:
    gap = theory.sprung.reversing_separation(1, 0.9, 0.6, MOUNT["mass_ratio"])
    what = "separation that two particles in one slot keep, e = 0.9, 0.6 g, first order"
    return (number(what, float(gap), "s"),)


def staggered(plan: Plan, base: str) -> Evidence:
    """Staggered motion attracts."""
    many = FEW if base == SPRUNG else 20
    two: list[Check] = []
    population: list[Check] = []
    together: list[Check] = []
    for setting in settings_of(base):
        contact = setting.constants.get("contact_time", TAU_C)
        for particles, checks in ((2, two), (many, population)):
            late = _late(plan, base, setting, {"particles": particles}, 0.125)["dt_min"].values
            what = f"share of {particles} staggered particles that bounce on more than τ_c apart"
            checks.append(nearly_all(what, late > contact, setting.over(phase=ANY_PHASE)))
        dt = _late(plan, base, setting, PAIR)["dt_min"].values
        what = "share of pairs launched 1 µs apart that end a quarter of even spacing apart or more"
        there = setting.over(phase=ANY_PHASE)
        together.append(nearly_all(what, dt[np.isfinite(dt)] >= APART, there))
    returned = [_return(plan, base, n) for n in populations(base, 20)]
    near = check(
        "deviation from even spacing after 1400 impacts over that at launch, largest",
        np.max(returned),
        "at most",
        1e-3,
        setting=own_slots_setting(base),
    )
    return Evidence(
        base,
        readings=(
            Reading("staggered pairs stay apart", two),
            Reading(f"{many} staggered particles stay apart", population),
            Reading("pairs launched together become staggered", together),
        ),
        conditions=(in_own_slots(base, (near,), 20, "launched nearby; "),),
    )


def _return(plan: Plan, base: str, particles: int) -> float:
    """Deviation of landings in own slots from whole periods: at the end, relative to the launch."""
    record = own_slots(particles, base, plan, impacts=SETTLED).isel(realization=0)
    times = record["landing_time"].values
    last = np.array([row[np.isfinite(row)][-1] for row in times])
    turns = last - np.rint(last - last[0])
    return float(np.ptp(turns)) / (2.0 * SCATTER)
