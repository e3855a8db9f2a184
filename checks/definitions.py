"""Measures of every base against their definitions, and the bases against each other.

    python checks/definitions.py [--scenes 200] [--seed 1]

Windows: each random scene is recorded to some periods past its end, and the measures of windows
that begin and end anywhere (in a rest, in a flight, next to a landing, a lift-off or a launch) are
compared with what plain Python finds in the record by the definitions of docs/results.md.  Limits:
massless particles do not move a base on a mount, and without amplitude all bases are the same;
there integers must agree, and real numbers to within their error bounds.  Orders: realizations in
any order, one by one and together, over memory that was small, large or used before, must give the
same bits.  Exit code 1 if anything differs.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from accuracy import options_of
from vibrosweep.engine import coupled
from vibrosweep.engine.coupled import base_track
from vibrosweep.engine.landings import all_parameters, record_landings
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import Workers
from vibrosweep.kernels.coupled.realizations import landings
from vibrosweep.model.observables import Measures
from vibrosweep.model.parameters import Periods
from vibrosweep.scene.scene import Scene

BASES = ("high-bounce", "moving", "sprung without mass", "sprung")
ALL = Measures(separation=True, per_particle=True)
PAST = 40.0  # periods past the end up to which scenes are recorded, so that last flights land
BESIDE = 1e-7  # periods between an instant and the edge of a window beside it
NARROW = 1e-9  # periods; windows that depend on smaller differences are left out
CLOSE = 1e-8  # allowed relative difference of a measure from its definition

Case = tuple[dict[str, np.ndarray], Scene]


def scene(rng: np.random.Generator, base: str) -> Case:
    """One realization, simulated for 4 to 16 periods."""
    f = float(rng.choice([1.0, 0.7, 20.0]))
    g, particles = 9.81, int(rng.integers(1, 5))
    gamma = rng.choice([rng.uniform(0.1, 1.0), rng.uniform(1.0, 4.0)])
    e = rng.choice([rng.uniform(0.0, 0.4), rng.uniform(0.4, 0.95)])
    given = {
        "restitution": e,
        "amplitude": gamma * (1.0 + e) * g / (2.0 * np.pi * f),
        "frequency": f,
        "phase": rng.uniform(-3.0, 3.0),
        "gravity": g,
        "launch_velocity": rng.uniform(0.2, 1.5) * g / (2.0 * f),
        "contact_time": rng.choice([1e-4, 1e-2, 0.1]) / f,
    }
    if base.startswith("sprung"):
        given |= {
            "mass_ratio": 0.0 if base != "sprung" else 10.0 ** rng.uniform(-3.0, -0.5),
            "mount_frequency": f * 10.0 ** rng.uniform(-0.6, 0.6),
            "mount_damping": 10.0 ** rng.uniform(-2.0, 0.3),
        }
    launch = tuple(sorted(rng.uniform(0.0, 2.0 / f, particles)))
    law = str(rng.choice(["rest", "reflect"])) if base == "high-bounce" else "rest"
    parameters = all_parameters({n: np.array([v]) for n, v in given.items()})
    duration = rng.uniform(4.0, 16.0) / f
    observation = Scene(particles, launch, duration, law, ALL, base=base.split()[0])
    return parameters, observation


def over(parameters: Mapping[str, np.ndarray], observation: Scene, base: str) -> Case:
    """Return the same scene over another base, with a mount if that is sprung."""
    mount = {"mass_ratio": 0.0, "mount_frequency": 0.37, "mount_damping": 0.05}
    own = {n: v for n, v in parameters.items() if n not in mount}
    if base == "sprung":
        own |= {n: np.array([v]) for n, v in mount.items()}
    return own, replace(observation, base=base)


class Recorded:
    """Landings of a realization up to `PAST` periods after its end, and measures by definition."""

    def __init__(self, of: Case, workers: Workers) -> None:
        parameters, watched = of
        self.scene, self.observation = of, watched
        self.p = {name: float(v[0]) for name, v in parameters.items()}
        end = float(watched.duration) + PAST / self.p["frequency"]
        longer = replace(watched, duration=end).recorded(10**6)
        found = record_landings(parameters, longer, workers)
        self.complete = not found["status"].any()
        self.landings = []  # of each particle: landing, lift-off, speed, rested, next landing
        for j, n in enumerate(found["impact_count"][0]):
            names = ("landing_time", "liftoff_time", "rebound_velocity", "rested")
            time, left, speed, rested = (found[name][0, j, :n] for name in names)
            self.landings.append((time, left, speed, rested, np.append(time[1:], np.nan)))
        self.track = base_track(parameters, longer, workers) if watched.base == "sprung" else None

    def height(self, times: np.ndarray) -> np.ndarray:
        """Height of the base, m."""
        p, times = self.p, np.atleast_1d(times)
        if self.observation.base == "high-bounce":
            return np.zeros(times.size)
        if self.track is not None:
            order = np.argsort(times)
            out = np.empty(times.size)
            out[order] = self.track.at(times[order])[0]
            return out
        omega = 2.0 * np.pi * p["frequency"]
        return (
            -p["amplitude"] / (1.0 + p["restitution"]) / omega * np.cos(omega * times + p["phase"])
        )

    def edges(self, rng: np.random.Generator) -> Iterator[tuple[float, float]]:
        """Windows that begin and end anywhere."""
        end, period = float(self.observation.duration), 1.0 / self.p["frequency"]
        time, left = (np.concatenate([own[k] for own in self.landings]) for k in (0, 1))
        special = np.concatenate([time, left[np.isfinite(left)], self.observation.launch])
        stays = left > time
        inside = [time[stays] + rng.uniform(size=stays.sum()) * (left - time)[stays]]
        special = np.concatenate([*(special + s * BESIDE * period for s in (-1, 1)), *inside])
        special = special[(special > 0.0) & (special <= end)]
        for _ in range(4):
            pick = [
                float(rng.choice(special))
                if special.size and rng.random() < 0.8
                else rng.uniform(0.0, end)
                for _ in range(2)
            ]
            if abs(pick[0] - pick[1]) > 1e-3 * period:
                yield min(pick), max(pick)

    def decided(self, begin: float, end: float) -> bool:
        """Return whether the contents of a window do not depend on rounding."""
        near, p = NARROW / self.p["frequency"], self.p
        times = np.concatenate([np.concatenate(own[:2]) for own in self.landings])
        times = np.append(times, self.observation.launch)
        edges = np.array([begin, end, end + 1.0 / p["frequency"]])
        if np.any(abs(times[:, np.newaxis] - edges) < near):
            return False
        each = [
            np.concatenate([own[0], self.stay_ends(own), own[0] + p["contact_time"]])
            for own in self.landings
        ]
        each = [times[np.isfinite(times)] for times in each]
        apart = [abs(a[:, np.newaxis] - b) for a, b in itertools.combinations(each, 2)]
        # particles in exactly the same state do no harm
        return not any(np.any((d < near) & (d > 0.0)) for d in apart) and not any(
            np.any(abs(t[:, np.newaxis] - edges) < near) for t in each
        )

    def stay_ends(self, own: tuple[np.ndarray, ...]) -> np.ndarray:
        """Return the ends of the stays that begin with landings."""
        left = np.where(np.isnan(own[1]), np.inf, own[1])
        return np.maximum(left, own[0] + self.p["contact_time"])

    def measures(self, begin: float, end: float) -> dict[str, float | np.ndarray] | None:
        """Measures of a window, by their definitions; None where a flight outlasts the record."""
        g, each, period = self.p["gravity"], [], 1.0 / self.p["frequency"]
        heights, flights, listed, stays = [], [], [], []
        for j, own in enumerate(self.landings):
            time, left, speed, rested, following = own
            seen = (time >= begin) & (time <= end)
            follows = seen & (left <= end + period)
            rises = np.where(speed > 0.0, speed, 0.0)
            pushed = follows & (following <= left)
            high = np.where(pushed, 0.0, rises**2 / (2.0 * g))
            if follows.any():
                high[follows] += self.height(left[follows])
            heights.append(high[follows])
            flights.append((following - left)[follows])
            each.append((int(seen.sum()), int(rested[seen].sum())))
            listed += [(t, j, k) for k, t in enumerate(time) if seen[k]]
            until = self.stay_ends(own)
            reach = (time <= end) & (until >= begin)
            stays += [(j, max(t, begin), u) for t, u in zip(time[reach], until[reach], strict=True)]
        if any(np.isnan(flown).any() for flown in flights):
            return None
        shared = any(
            a[0] != b[0] and min(a[2], b[2]) >= max(a[1], b[1])
            for a, b in itertools.combinations(stays, 2)
        )
        gaps = [
            (abs(a[0] - b[0]), a[2] == b[2])
            for a, b in itertools.combinations(listed, 2)
            if a[1] != b[1]
        ]
        high, flown = np.concatenate(heights), np.concatenate(flights)
        return {
            "impact_count": sum(n for n, _ in each),
            "rest_count": sum(n for _, n in each),
            "particle_impact_count": np.array([n for n, _ in each]),
            "particle_rest_count": np.array([n for _, n in each]),
            "rebound_height_mean": high.mean() if high.size else np.nan,
            "rebound_height_max": high.max() if high.size else np.nan,
            "particle_rebound_height_max": np.array(
                [h.max() if h.size else np.nan for h in heights]
            ),
            "flight_time_mean": flown.mean() if flown.size else np.nan,
            "flight_height_max": np.fmax(
                high.max() if high.size else np.nan, self.launched(begin, end)
            ),
            "dt_min": min((d for d, _ in gaps), default=np.nan),
            "dt_min_same_index": min((d for d, same in gaps if same), default=np.nan),
            "base_shared": int(shared),
            "collision_free": int(not shared),
        }

    def launched(self, begin: float, end: float) -> float:
        """Height of the highest launch in a window."""
        times = np.array([t for t in self.observation.launch if begin <= t <= end])
        if not times.size:
            return np.nan
        v, g = self.p["launch_velocity"], self.p["gravity"]
        if self.track is not None:  # the track begins at the first launch, with its time rounded
            times = np.maximum(times, self.track.track.time[0, 0])
        low = self.height(times)
        if self.observation.base == "high-bounce":
            return v * v / (2.0 * g)
        step = 1e-6 / self.p["frequency"]  # the base is above it at once where it is faster
        if self.track is None:
            flies = v >= (self.height(times + step) - low) / step
        else:
            flies = v >= self.track.at(np.sort(times))[1]
        return float(np.max(low + np.where(flies, v * v / (2.0 * g), 0.0)))


def differences(
    found: Mapping[str, np.ndarray],
    wanted: Mapping[str, float | np.ndarray],
    near: Mapping[str, float],
) -> list[str]:
    """Name the measures that differ: integers at all, others by more than `near` allows."""
    wrong = []
    for name, value in wanted.items():
        own = found[name][0]
        if found[name].dtype.kind == "i":
            same = np.array_equal(own, value)
        else:
            kind = next(k for k in near if k in name)
            same = np.allclose(own, value, rtol=1e-12, atol=near[kind], equal_nan=True)
        if not same:
            wrong.append(f"{name} {own} instead of {value}")
    return wrong


def windows(rng: np.random.Generator, base: str, workers: Workers) -> tuple[int, list[str]]:
    """Compare windows of a scene with their definitions; return their number and differences."""
    own, wrong, compared = Recorded(scene(rng, base), workers), [], 0
    if not own.complete:
        return 0, []
    parameters, watched = own.scene
    f = own.p["frequency"]
    height = own.p["gravity"] / (8.0 * f * f)
    for begin, end in own.edges(rng):
        if not own.decided(begin, end):
            continue
        wanted = own.measures(begin, end)
        if wanted is None:
            continue
        asked = replace(watched.with_measures(transient=begin), duration=end)
        found = measure(parameters, asked, workers)
        size = max(1.0, abs(float(np.nan_to_num(wanted["flight_height_max"]))) / height)
        near = {"height": CLOSE * size * height, "": CLOSE / f}
        told = [f"{base} [{begin!r}, {end!r}]: {one}" for one in differences(found, wanted, near)]
        compared, wrong = compared + 1, wrong + told
        if told:
            wrong.append(repr((own.p, watched.launch)))
    return compared, wrong


def limit(rng: np.random.Generator, workers: Workers) -> tuple[int, list[str]]:
    """Compare bases in limits where they agree; return the number of windows and differences."""
    still = rng.random() < 0.2
    parameters, watched = scene(rng, "moving")
    if still:  # without amplitude all bases stay at their level
        parameters["amplitude"][:] = 0.0
    own, wrong, compared = Recorded((parameters, watched), workers), [], 0
    for begin, end in own.edges(rng):
        trusting = Measures(separation=True, per_particle=True, trust=True, transient=begin)
        asked = replace(watched, duration=end, measures=trusting)
        one = measure(parameters, asked, workers)
        late, fast = float(one["landing_time_error"][0]), float(one["rebound_velocity_error"][0])
        if one["status"].any() or not late * own.p["frequency"] < 1e-9:
            continue  # not trusted: rounding may make different decisions
        if not own.decided(begin, end):
            continue
        names = [
            n for n in one if "error" not in n and n not in ("trusted_until", "dt_min_resolved")
        ]
        high = np.nan_to_num(max(float(one["flight_height_max"][0]), 0.0))
        speed = np.sqrt(2.0 * own.p["gravity"] * high) + own.p["amplitude"]
        near = {
            "height": 4.0 * (speed * fast / own.p["gravity"] + own.p["amplitude"] * late),
            "": 4.0 * late,
        }
        for base in ("sprung", "high-bounce") if still else ("sprung",):
            there, same = over(
                parameters, replace(asked, measures=replace(ALL, transient=begin)), base
            )
            other = measure(there, same, workers)
            told = differences(other, {n: one[n][0] for n in names}, near)
            wrong += [f"{base} against moving [{begin!r}, {end!r}]: {t}" for t in told]
            if told:
                wrong.append(repr((own.p, watched.launch)))
            compared += 1
    return compared, wrong


def orders(rng: np.random.Generator, base: str, threads: int = 2) -> tuple[int, list[str]]:
    """Compute realizations in other orders over used memory; return runs and differences."""
    scenes = [scene(rng, base)[0] for _ in range(12)]
    together = {n: np.concatenate([one[n] for one in scenes]) for n in scenes[0]}
    coupled_base = base.startswith("sprung")
    others = {"joint": True} if coupled_base else {"regimes": True, "lyapunov": True, "trust": True}
    begin, end = float(rng.uniform(0.0, 10.0)), float(rng.uniform(20.0, 60.0))
    asked = Measures(
        separation=True, per_particle=True, ordering=True, transient=Periods(begin), **others
    )
    late = float(rng.choice([0.0, 15.0])) / together["frequency"].min()
    launch = (*sorted(rng.uniform(0.0, 1.0, 3)), late)
    watched = Scene(4, launch, Periods(end), "rest", asked, base=base.split()[0])
    wanted = [one_by_one(together, watched, i) for i in range(12)]
    wrong = []
    for size in (1, 256, 2**14):
        for order in (np.arange(12), np.arange(12)[::-1], rng.permutation(12)):
            with remembering(size), Workers(int(rng.integers(1, threads + 1))) as workers:
                found = measure({n: v[order] for n, v in together.items()}, watched, workers)
            for name, values in found.items():
                own = np.stack([wanted[i][name][0] for i in order])
                if own.tobytes() != values.tobytes():
                    wrong.append(f"{base}: {name} depends on the order, or on room for {size}")
    return 9, wrong


def one_by_one(parameters, watched, i):
    """Measure one realization over unused memory."""
    with Workers(1) as workers:
        return measure({n: v[i : i + 1].copy() for n, v in parameters.items()}, watched, workers)


@contextmanager
def remembering(size: int):
    """Let the coupled engine begin with room for `size` impact numbers."""
    before = coupled.work_for
    coupled.work_for = lambda n: before(n)._replace(landings=landings(n, size))
    try:
        yield
    finally:
        coupled.work_for = before


def campaign(scenes: int, seed: int) -> tuple[dict[str, int], list[str]]:
    """Run `scenes` scenes of each kind; return the numbers of comparisons, and differences."""
    rng, counts, wrong = np.random.default_rng(seed), {}, []

    def add(what: str, one: tuple[int, list[str]]) -> None:
        counts[what] = counts.get(what, 0) + one[0]
        wrong.extend(one[1])

    with Workers(1) as workers:
        for _ in range(scenes):
            for base in BASES:
                add(f"windows, {base}", windows(rng, base, workers))
            add("limits", limit(rng, workers))
    for _ in range(max(1, scenes // 20)):
        for base in BASES:
            add(f"orders, {base}", orders(rng, base))
    return counts, wrong


def main() -> int:
    options = options_of(__doc__, scenes=200, seed=1, write=False)
    counts, wrong = campaign(options.scenes, options.seed)
    for line in wrong:
        print(line)
    for what, number in counts.items():
        print(f"{what}: {number}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
