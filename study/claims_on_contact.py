"""Claims 10, 11 and 21: separations stay positive, heights differ, grooves guide balls."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from study.arrays import Flags
from study.bases import HIGH_BOUNCE, SPRUNG
from study.claims_on_order import in_own_slots
from study.estimates import Estimate, share
from study.figures.curves import heights_and_crossings
from study.figures.pairs import decay_in_a_slot
from study.records import crossings
from study.samples import (
    FEW,
    FIRST,
    SMALLER,
    TAU_C,
    WINDOWS,
    Plan,
    Setting,
    laws,
    measured,
    mount,
    settings_of,
)
from study.slots import (
    POPULATIONS,
    decay_in_slot,
    own_slots,
    own_slots_setting,
    populations,
    smallest_separation,
)
from study.verdict import (
    ANY_BASE,
    Check,
    Evidence,
    Number,
    Outcome,
    Reading,
    check,
    number,
    without_exception,
)
from vibrosweep import simulate, theory
from vibrosweep.analysis import separation_distribution
from vibrosweep.figures import separation_distributions
from vibrosweep.figures.style import for_file

DURATIONS: Final = (12.0, 120.0, 1200.0)
MEASURES: Final = {
    "all landings": "dt_min",
    "equal impact numbers, as printed": "dt_min_same_index",
}
# Tables 2 and 3 of the study: mm
GROOVES: Final = 24
PLATFORM_RADIUS: Final = 90.0
DIAMETERS: Final = (8.0, 10.0)
GROOVE_DEPTH: Final = 2.0
FREQUENCIES: Final = (8.0, 35.0)  # of the laboratory, Hz


def separation_stays_positive_figures(plan: Plan) -> dict[str, Figure]:
    """Figures of `separation_stays_positive`."""
    one = Plan(plan.threads, seeds=1)
    drawn = FIRST.drawn(one)
    sweeps = [
        measured(one, HIGH_BOUNCE, drawn, particles=20, duration=t, separation=True)
        for t in DURATIONS
    ]
    return {
        "claim10_distribution": for_file(
            separation_distributions,
            [separation_distribution(s) for s in sweeps],
            [f"{t:g} s" for t in DURATIONS],
            TAU_C,
        ),
        "claim10_slot": for_file(decay_in_a_slot, decay_in_slot(plan, HIGH_BOUNCE, 1.2, 0.01)),
    }


def separation_stays_positive(plan: Plan, base: str) -> Evidence:
    """The smallest separation stays positive for all stable conditions, and above tau_c."""
    checks: dict[str, list[Check]] = {}
    for setting in settings_of(base):
        for name, one in _of_setting(plan, base, setting):
            checks.setdefault(name, []).append(one)
    own = np.min([smallest_separation(own_slots(n, base, plan)) for n in populations(base)])
    there = own_slots_setting(base)
    kept = check("smallest separation of landings", own, "at least", TAU_C, "s", there)
    return Evidence(
        base,
        readings=[Reading(name, each) for name, each in checks.items()],
        conditions=(in_own_slots(base, (kept,), 100),),
        numbers=() if base == SPRUNG else _closing(plan, base),
    )


def _of_setting(plan: Plan, base: str, setting: Setting) -> Iterator[tuple[str, Check]]:
    """Tests of every reading under one setting."""
    drawn = setting.drawn(plan, scale=SMALLER[base])
    scene = {"particles": FEW if base == SPRUNG else 20}
    stable = _stable(plan, base, drawn, scene)
    contact = setting.constants.get("contact_time", TAU_C)
    for window, (begin, end) in WINDOWS.items():
        found = measured(plan, base, drawn, transient=begin, duration=end, separation=True, **scene)
        for landings, measure in MEASURES.items():
            for kind, chosen in stable.items():
                dt = found[measure].values[chosen]
                for words, bound in (("0", 0.0), ("τ_c", contact)):
                    what = f"stable realizations with dt_min not above {words}"
                    one = without_exception(what, dt > bound, setting)
                    yield f"{landings}; {window}; stable: {kind}", one


def _stable(
    plan: Plan, base: str, drawn: dict[str, Any], scene: dict[str, Any]
) -> dict[str, Flags]:
    """Stable realizations, for each meaning of stable; particles bounce on in all of them."""
    if base == SPRUNG:
        found = measured(plan, base, drawn, duration=42.0, **scene)
        return {"every particle bounces on": found["at_rest_count"].values == 0}
    found = measured(plan, base, drawn, duration=2000.0, regimes=True, **scene)
    locked = found["locked_count"].values
    recurrent = locked + found["resting_count"].values
    return {
        "periodic": recurrent == scene["particles"],
        "locked": locked == scene["particles"],
    }


def _closing(plan: Plan, base: str) -> tuple[Number, ...]:
    decay = decay_in_slot(plan, base, 1.2, 0.01)
    closing = number(
        "time in which a slot closes from half a period to τ_c, Table 1",
        float(decay["closing_time"]),
        "s",
    )
    free = [
        number(
            f"collision-free realizations of N = {n} in 12 s, share; {one.name}",
            share(_apart(plan, base, one, n)["collision_free"].values == 1),
            setting=one,
        )
        for one in laws(base, FIRST)
        for n in (2, *POPULATIONS)
    ]
    return (
        number("decay per impact in a slot at Table 1, fitted", float(decay["modulus_fitted"])),
        number("the same from the multipliers", float(decay["modulus_predicted"])),
        closing,
        *free,
    )


def _apart(plan: Plan, base: str, setting: Setting, particles: int) -> xr.Dataset:
    drawn = setting.drawn(plan)
    return measured(plan, base, drawn, particles=particles, duration=12.0, separation=True)


def heights_differ_figures(plan: Plan) -> dict[str, Figure]:
    """Figure of `heights_differ`."""
    few = simulate(launch_time=[0.1, 0.55], duration=4.0, threads=plan.threads)
    return {"claim11_crossings": for_file(heights_and_crossings, few, crossings(few))}


def heights_differ(plan: Plan, base: str) -> Evidence:
    """No two particles are at one height, y_i(t) != y_j(t) at all times, Eq. 18."""
    record = simulate(
        launch_time=np.arange(20) / 20,
        duration=12.0,
        base=base,
        threads=plan.threads,
        **mount(base),
    )
    found = crossings(record)
    crossing = float(found["pairs_crossing"]) / float(found["pairs"])
    # balls whose centres are at one height on one vertical line touch
    touching = Estimate(crossing, crossing, 1.0)
    return Evidence(
        base,
        readings=(
            Reading(
                "points on one vertical line",
                (check("share of pairs at one height at some time", crossing, "at most", 0.0),),
            ),
            Reading(
                "spheres of 8 to 10 mm on one vertical line",
                (check("share of pairs that touch, at least", touching, "at most", 0.0),),
            ),
        ),
        numbers=(
            number("crossings of 20 particles in 12 s", found.sizes["crossing"]),
            number("pairs of flights in the air together", found["flight_overlaps"]),
        ),
    )


def grooves(plan: Plan) -> Outcome:
    """The grooves of Table 2 guide every ball on its own path, for fifty balls too."""
    least = DIAMETERS[1] / (2.0 * math.sin(math.pi / GROOVES))
    slow, fast = (1e3 * float(theory.locked_height(1, f)) for f in FREQUENCIES)
    shallow = float(np.sqrt(9.81e3 / (8.0 * GROOVE_DEPTH)))
    rim = PLATFORM_RADIUS - 0.5 * DIAMETERS[1]
    guided = "height of mode 1, above which a ball has left its groove"
    fifty, twenty = (
        check(f"fewest balls in the fullest groove, of {n}", math.ceil(n / GROOVES), "at most", 1.0)
        for n in (50, 20)
    )
    apart = check(
        "distance of neighbouring grooves at the rim",
        2.0 * rim * math.sin(math.pi / GROOVES),
        "at least",
        DIAMETERS[1],
        "mm",
    )
    in_flight, low = (
        check(f"{guided}, at {f:g} Hz", height, "at most", GROOVE_DEPTH, "mm")
        for f, height in zip(FREQUENCIES, (slow, fast), strict=True)
    )
    return Outcome(
        [
            Evidence(
                ANY_BASE,
                readings=(
                    Reading("50 balls in 24 grooves", (fifty,)),
                    Reading("grooves of 2 mm guide in flight too, at 8 to 35 Hz", (in_flight,)),
                ),
                conditions=(
                    Reading(
                        f"N at most {GROOVES}, and flights below 2 mm (mode 1 above "
                        f"{shallow:.0f} Hz)",
                        (twenty, apart, low),
                    ),
                ),
                numbers=(
                    number("radius at which 24 balls of 10 mm fit side by side", least, "mm"),
                    number("radius of the platform", PLATFORM_RADIUS, "mm"),
                ),
                setting=Setting(
                    "the laboratory",
                    {"frequency": FREQUENCIES, "diameter_mm": DIAMETERS},
                    {"grooves": GROOVES, "groove_depth_mm": GROOVE_DEPTH},
                ),
            )
        ]
    )
