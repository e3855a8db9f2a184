"""Claims 3, 9 and 17: separations are preserved, motion is ordered, the invariant manifold."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from study.arrays import Array
from study.bases import SPRUNG
from study.estimates import mean
from study.figures.pairs import separations_in_time
from study.records import first_shared_base, order_of_landings, separation_changes
from study.samples import (
    FEW,
    FOLLOWED,
    MOUNT,
    SMALLER,
    WINDOWS,
    Plan,
    Setting,
    by_seed,
    laws,
    measured,
    mount,
    records,
    settings_of,
    single,
)
from study.slots import (
    height_needed,
    own_slots,
    own_slots_setting,
    populations,
    smallest_separation,
)
from study.verdict import (
    NEARLY_ALL,
    Check,
    Evidence,
    Number,
    Reading,
    check,
    nearly_all,
    number,
    without_exception,
)
from vibrosweep import basins, simulate, theory
from vibrosweep.analysis import capacity
from vibrosweep.figures.style import for_file

# Impacts in which an offset of 1 ms falls below 1e-9 s at e = 0.98, by sqrt(e) each
SETTLED: Final = 1400
FASTEST: Final = 35.0  # of the laboratory, Hz
# Parameters at which staggered orbits of this many particles exist on the base of finite mass
STAGGERED: Final[dict[int, dict[str, float]]] = {
    FEW: {"restitution": 0.95, "base_acceleration": 0.7},
    20: {"restitution": 0.98, "base_acceleration": 0.8},
}


def in_own_slots(base: str, checks: Sequence[Check], largest: int, before: str = "") -> Reading:
    """Condition under which order holds, with the heights that it needs."""
    if base == SPRUNG:
        height = height_needed(2)
        words = f"two particles in separate slots (at 1 Hz, flights {height:.1f} m high)"
        return Reading(before + words, checks, height)
    twenty, hundred = height_needed(20), height_needed(100)
    words = (
        f"each particle in its own slot (at 1 Hz, flights {twenty:.0f} m high for N = 20, "
        f"{hundred / 1e3:.0f} km for 100; at 35 Hz {twenty / FASTEST**2:.1f} m and "
        f"{hundred / FASTEST**2:.0f} m)"
    )
    return Reading(before + words, checks, height_needed(largest))


def preserved_figures(plan: Plan) -> dict[str, Figure]:
    """Figure of `preserved`."""
    table_1 = simulate(launch_time=[0.1, 0.125, 0.15], duration=40.0, threads=plan.threads)
    return {"claim03_separations": for_file(separations_in_time, table_1)}


def preserved(plan: Plan, base: str) -> Evidence:
    """Separation is preserved from impact to impact, Eqs. 23 and 24."""
    readings = [
        Reading(f"{what}, {when}", checks)
        for when, window in WINDOWS.items()
        for what, checks in _kept(plan, base, *window).items()
    ]
    largest = np.max(
        [
            separation_changes(own_slots(n, base, plan, SETTLED + 20), landed_before=SETTLED)[
                "change_max"
            ][0]
            for n in populations(base, 20)
        ]
    )
    there = own_slots_setting(base)
    settled = check("change of a separation, largest", largest, "at most", 1e-8, "s", there)
    before = "settled on one locked orbit of one impact per cycle; "
    return Evidence(base, readings, (in_own_slots(base, (settled,), 20, before),))


def _kept(plan: Plan, base: str, since: float, until: float) -> dict[str, list[Check]]:
    """Test whether separations are preserved, and, more weakly, which particle lands first."""
    found: dict[str, list[Check]] = {"separations": [], "only who lands first": []}
    for setting in settings_of(base):
        each = records(
            plan,
            base,
            setting.drawn(plan, scale=FOLLOWED * SMALLER[base]),
            launch_time=np.arange(FEW) / FEW,
            duration=until,
        )
        kept, ahead = [], []
        for record in each:
            changes = separation_changes(record, since=since)["preserved_fraction"]
            turned = order_of_landings(record, since=since)["overtaking_fraction"]
            kept.append(changes.values)
            ahead.append(1.0 - turned.values)
        for what, values, words in (
            ("separations", kept, "share of separations that change by at most τ_c per impact"),
            ("only who lands first", ahead, "share of pairs in the same order at the next impact"),
        ):
            of_seeds = [_average(one) for one in by_seed(plan, np.concatenate(values))]
            one = check(words, mean(of_seeds), "at least", NEARLY_ALL, setting=setting)
            found[what].append(one)
    return found


def _average(values: Array) -> float:
    """Mean over the populations that still land; NaN if none does."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")


def bounded_and_ordered(plan: Plan, base: str) -> Evidence:
    """Bounded, ordered motion for N from 5 to 100 without overlap."""
    readings = [
        Reading(
            name,
            [
                one
                for setting in laws(base)
                for one in _table_1_ordered(plan, base, setting, *window)
            ],
        )
        for name, window in WINDOWS.items()
    ]
    if base == SPRUNG:
        return Evidence(base, readings, (_staggered_on_a_light_base(),))
    own = [own_slots(n, base, plan) for n in populations(base)]
    closest = number(
        "smallest separation of landings in own slots",
        min(map(smallest_separation, own)),
        "s",
        own_slots_setting(base),
    )
    return Evidence(
        base,
        readings,
        conditions=(in_own_slots(base, _in_order(own, base), 100),),
        numbers=(*_capacity(plan, base), closest),
    )


def _staggered_on_a_light_base() -> Reading:
    """Test whether staggered orbits of 5 and 20 particles attract on the base of finite mass."""
    checks = []
    for particles in (FEW, 20):
        forcing = STAGGERED[particles]
        base = theory.sprung.CoupledBase(
            forcing["restitution"], forcing["base_acceleration"], *MOUNT.values()
        )
        orbit = theory.sprung.staggered(base, particles, list(range(particles)))
        what = f"spectral radius of {particles} particles in separate slots (basin not claimed)"
        there = Setting("separate slots", constants={**forcing, **MOUNT})
        radius = theory.sprung.spectral_radius(orbit)
        checks.append(check(what, radius, "at most", 1.0, setting=there))
    name = "5 and 20 particles, each in its own slot"
    return Reading(name, checks, height_needed(20))


def _table_1_ordered(
    plan: Plan, base: str, setting: Setting, since: float, until: float
) -> list[Check]:
    """Tests over populations at Table 1, launched at irregular times of one period."""
    sizes = (FEW, 20) if base == SPRUNG else populations(base)
    turned: list[float] = []
    alone: list[bool] = []
    for random in plan.random():
        fractions: list[float] = []
        for n in sizes:
            launch = np.sort((np.arange(n) + random.uniform(0.0, 1.0, n)) / n)
            record = simulate(
                **setting.constants,
                **mount(base),
                base=base,
                launch_time=launch,
                duration=until,
                threads=plan.threads,
            )
            order = order_of_landings(record, since=since)
            fractions.append(float(order["sequence_change_fraction"][0]))
            window = measured(
                plan,
                base,
                single(setting),
                launch=launch.tolist(),
                transient=since,
                duration=until,
                separation=True,
            )
            alone.append(bool(window["collision_free"][0] == 1))
        turned.append(_average(np.array(fractions)))
    return [
        check(
            "share of landings that change the sequence",
            mean(turned, 0.0),
            "at most",
            0.05,
            setting=setting,
        ),
        nearly_all("share of populations in which no two particles share the base", alone, setting),
    ]


def _in_order(own: Sequence[xr.Dataset], base: str) -> list[Check]:
    orders = [order_of_landings(one)["sequence_change_fraction"][0] for one in own]
    shared = [np.isfinite(first_shared_base(one)["first_shared_time"][0]) for one in own]
    found = [
        ("share of landings that change the sequence", np.max(orders), 0.0),
        ("share of populations that share the base", np.mean(shared), 0.0),
    ]
    if base != SPRUNG:
        longest = max(_over_bound(one, base) for one in own)
        found.append(("longest flight over its proved bound", longest, 1.0 + 1e-12))
    there = own_slots_setting(base)
    return [check(what, value, "at most", bound, setting=there) for what, value, bound in found]


def _over_bound(record: xr.Dataset, base: str) -> float:
    unit = 2.0 * float(record["frequency"]) / float(record["gravity"])
    launch = unit * float(record["launch_velocity"])
    bound = theory.flight_time_bound(
        launch, unit * float(record["amplitude"]), float(record["restitution"]), base
    )
    return max(launch, unit * float(np.nanmax(record["rebound_velocity"].values))) / float(bound)


def _capacity(plan: Plan, base: str) -> tuple[Number, ...]:
    """Slots over all attractors at Table 1, where particles do not act on each other."""
    reached = basins(
        base=base,
        duration=4000.0,
        launch=(np.arange(40) / 40).tolist(),
        launch_velocity=np.linspace(0.5, 12.0, 24),
        threads=plan.threads,
    )
    slots = capacity(reached)
    return (
        number("slots over all attractors of 960 launches at Table 1", slots["capacity"]),
        number("slots of those without rests", slots["capacity_without_rests"]),
    )


def invariant(plan: Plan, base: str) -> Evidence:
    """The collision-free configuration is a stable invariant manifold, sec. 3."""
    checks = []
    for setting in settings_of(base):
        drawn = setting.drawn(plan, scale=SMALLER[base])
        first, later = (
            measured(
                plan,
                base,
                drawn,
                particles=FEW,
                transient=begin,
                duration=end,
                separation=True,
            )["collision_free"].values
            for begin, end in ((0.0, 12.0), (12.0, 36.0))
        )
        what = "populations free of collisions for 12 s that do not remain so until 36 s"
        checks.append(without_exception(what, later[first == 1] == 1, setting))
    own = [own_slots(n, base, plan, impacts=100) for n in populations(base, 20)]
    return Evidence(
        base,
        readings=(Reading(f"{FEW} staggered particles, any launch", checks),),
        conditions=(in_own_slots(base, _in_order(own, base), 20),),
    )
