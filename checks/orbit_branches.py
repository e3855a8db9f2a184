"""Branches of periodic orbits in random ranges of random scenes, against each other and a search.

Run with ``python checks/orbit_branches.py --rounds 20 --ranges 50 --seed 1``.  In each range
- every event lies inside it, and every doubling has its child, or the line that was born there;
- every admissible orbit that `vibrosweep.orbits` finds at a value of the axis lies on a branch;
- no two branches are one: none passes an orbit that lies on another;
- events do not depend on the range: a wider range with more values has the same events inside,
  unless the search misses an orbit at a value of the axis, which is counted;
- no branch is lost.
Each waveform has its own kernels, which take a minute to compile.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from typing import Any

import numpy as np
import xarray as xr

import vibrosweep as vs

UNIT = 9.81 / 2.0  # m/s, at 1 Hz
DOUBLING, BORN = 1, 4
KINKS = (5, 6)  # of the waveform, and of the law of restitution
LOST = 4
SAME = 1e-6
LAWS: tuple[dict[str, Any], ...] = (
    {},
    {},
    {},
    {"restitution_law": "viscoelastic", "restitution_speed": 1.0},
    {"restitution_law": "plastic", "restitution_speed": 2.0},
)
FIXED: tuple[Any, ...] = (
    "sine",
    "sine",
    "parabolic",
    {"harmonics": [[1, 1, 0], [2, 0.4, 1.1]]},
    {
        "harmonics": [
            [2, -0.5632604946323857, -0.41719416078983107],
            [5, -0.055606027087918695, 1.3496419404578157],
            [6, 0.24382204464520169, 1.7694305540175774],
        ]
    },
)
Orbit = tuple[int, int, float, Any]  # impacts, periods, parameter, phases


def drawn(random: np.random.Generator) -> dict[str, Any]:
    """Draw a base, a waveform and a law."""
    waveform = FIXED[k] if (k := random.integers(len(FIXED) + 2)) < len(FIXED) else None
    if waveform is None:
        orders = random.choice(np.arange(1, 6), size=random.integers(2, 4), replace=False)
        weights = random.uniform(-1.0, 1.0, orders.size)
        phases = random.uniform(-np.pi, np.pi, orders.size)
        tones = zip(
            orders.tolist(), (weights / np.abs(weights).sum()).tolist(), phases, strict=True
        )
        waveform = {"harmonics": [[order, w, float(phase)] for order, w, phase in sorted(tones)]}
    base = str(random.choice(["high-bounce", "moving", "moving"]))
    return {"base": base, "waveform": waveform, **LAWS[random.integers(len(LAWS))]}


def ranges(random: np.random.Generator, least: float) -> tuple[str, dict[str, Any], Any, Any]:
    """Draw the name of an axis, what is fixed, the values of a range and those of a wider one.

    `least` is the smallest restitution.
    """
    if random.uniform() < 0.75:
        fixed = {"restitution": float(random.uniform(least, 0.97))}
        values = np.sort(random.uniform(0.15, 1.3, 3)) * UNIT
        wider = np.sort([*values, values[0] * 0.8, values[2] * 1.1])
        return "amplitude", fixed, values, wider
    fixed = {"amplitude": float(random.uniform(0.3, 1.2)) * UNIT}
    values = np.sort(random.uniform(least + 0.05, 0.95, 3))
    return "restitution", fixed, values, np.sort([*values, values[0] - 0.05, values[2] * 1.02])


def alike(one: Orbit, other: Orbit) -> bool:
    """Return whether two orbits are the same, whichever impact comes first."""
    if one[:2] != other[:2] or abs(one[2] - other[2]) > SAME * (1.0 + abs(one[2])):
        return False
    turned = (np.roll(other[3], k) - one[3] for k in range(one[0]))
    return any(np.abs(off - np.rint(off)).max() < SAME for off in turned)


def events_of(found: xr.Dataset, along: str) -> list[tuple[int, int, Orbit]]:
    """Branch, kind and orbit of every event."""
    kinds, values = found.bifurcation.values, found[f"bifurcation_{along}"].values
    phases = found.bifurcation_phase.values
    numbers = list(zip(found.cycle_impacts.values, found.cycle_periods.values, strict=True))
    return [
        (i, int(kinds[i, k]), (*map(int, numbers[i]), values[i, k], phases[i, k, : numbers[i][0]]))
        for i, k in np.argwhere(kinds >= 0)
    ]


def points_of(found: xr.Dataset, along: str, i: int) -> list[Orbit]:
    """Orbits of a branch."""
    p, q = int(found.cycle_impacts[i]), int(found.cycle_periods[i])
    values, phases = found[along].values[i], found.impact_phase.values[i, :, :p]
    return [(p, q, v, x) for v, x in zip(values, phases, strict=True) if np.isfinite(v)]


def judge(scene: dict[str, Any], random: np.random.Generator, say: Any) -> Counter[str]:
    """Judge the branches in one random range; return counts."""
    viscoelastic = scene.get("restitution_law") == "viscoelastic"  # from 0.46 on
    along, fixed, values, wider = ranges(random, 0.5 if viscoelastic else 0.25)
    impacts = int(random.integers(1, 4))
    most = {"impacts": impacts, "periods": int(random.integers(1, 4))}
    given = {**scene, **fixed, **most, along: values.tolist()}
    found = vs.branches(**given, doublings=2)
    events, count = events_of(found, along), Counter(branches=found.sizes["branch"])
    points = [points_of(found, along, i) for i in range(found.sizes["branch"])]
    count["events"] = len(events)

    def fail(name: str, *words: Any) -> None:
        count[name] += 1
        say(f"{name}: {given}", *words)

    for i in np.flatnonzero((found.ends.values == LOST).any(axis=1)):
        fail("lost", points[i][0], points[i][-1])
    for i, kind, orbit in events:
        if not values[0] - 1e-11 <= orbit[2] <= values[-1] + 1e-11:
            fail("outside", i, kind, orbit)
        generation, parent = 0, i
        while (parent := int(found.parent[parent])) >= 0:
            generation += 1
        if kind == DOUBLING and generation < 2:
            count["doublings"] += 1
            if any(j == i and k in KINKS and alike(one, orbit) for j, k, one in events):
                count["doublings at a kink"] += 1  # a multiplier jumps over -1: no child is smooth
                continue
            p, q = orbit[:2]
            twice = (2 * p, 2 * q, orbit[2], np.tile(orbit[3], 2))
            children = np.flatnonzero(found.parent.values == i)
            children = [k for k in children if len(points[k]) > 1]
            born = [one for _, k, one in events if k == BORN]
            if not any(alike(one, twice) for one in [*(points[k][0] for k in children), *born]):
                fail("childless", i, orbit)
    at_values(scene | fixed | most, along, values, points, fail, count)
    larger = vs.branches(**{**given, along: wider.tolist()}, doublings=2)
    # a line between two doublings is born at either of them
    beyond, own = ([e for e in events_of(f, along) if e[1] != BORN] for f in (larger, found))
    for name, some, others in (("only narrow", own, beyond), ("only wide", beyond, own)):
        for i, kind, orbit in some:
            inside = values[0] + SAME < orbit[2] < values[-1] - SAME
            wanted = orbit[0] <= most["impacts"] and orbit[1] <= most["periods"]
            if not inside or not wanted:
                continue
            if any(kind == k and alike(orbit, one) for _, k, one in others):
                continue
            if name == "only wide" and unsearched(points_of(larger, along, i), values, points):
                count["not found by the search"] += 1
            else:
                fail(name, kind, orbit)
    return count


def unsearched(line: list[Orbit], values: Any, points: Any) -> bool:
    """Return whether a line passes an orbit at a value of the axis that is on no branch."""
    return any(
        not any(alike(orbit, at) for other in points for at in other)
        for orbit in line
        if np.isclose(orbit[2], values, rtol=1e-12, atol=0.0).any()
    )


def at_values(
    given: dict[str, Any], along: str, values: Any, points: Any, fail: Any, count: Counter[str]
) -> None:
    """Judge whether each orbit at a value of the axis lies on one branch."""
    listed = vs.orbits(**given, **{along: values.tolist()})
    for j, value in enumerate(values):
        one = listed.isel({along: j})
        for k in np.flatnonzero(one.admissible.values == 1):
            p, q = int(one.cycle_impacts[k]), int(one.cycle_periods[k])
            orbit = (p, q, value, one.impact_phase.values[k, :p])
            on = [i for i, line in enumerate(points) if any(alike(orbit, at) for at in line)]
            count["orbits"] += 1
            if not on:
                fail("on no branch", orbit)
            elif len(on) > 1:
                fail("on two branches", orbit, on)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=20, help="scenes that are drawn")
    parser.add_argument("--ranges", type=int, default=50, help="ranges of each")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    total: Counter[str] = Counter()
    for i in range(options.rounds):
        random = np.random.default_rng([options.seed, i])
        scene = drawn(random)
        count: Counter[str] = Counter(ranges=options.ranges)
        for _ in range(options.ranges):
            count += judge(scene, random, lambda *words: print(" ", *words))
        print(scene, dict(count), flush=True)
        total += count
    print("all:", dict(total))
    good = {"ranges", "branches", "events", "doublings", "orbits", "not found by the search"}
    return int(bool(set(total) - good))


if __name__ == "__main__":
    sys.exit(main())
