"""Identities that hold bit for bit, or within proved bounds, between different computations.

Each check takes a law, a number of cases, a seed and workers, and returns the number of cases that
it tried and the faults.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction

import numpy as np
from flint import arb, ctx

from accuracy import ULP, bare_problem, batch_of, orbit
from vibrosweep.engine.landings import record_landings
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import Workers
from vibrosweep.kernels.bases import constants as constants_of
from vibrosweep.kernels.bases import rebound
from vibrosweep.kernels.impact import base_of, land
from vibrosweep.kernels.trust import empty_trust, trust
from vibrosweep.model.measures import Status
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.scene.scene import Scene

Outcome = tuple[int, list[str]]
CAPACITY = 400


def dyadic_scene(rng: np.random.Generator) -> dict[str, float]:
    """A scene whose frequency is a power of two: whole periods are exact in s."""
    frequency = 2.0 ** rng.integers(-8, 9)
    gravity = rng.uniform(1.0, 20.0)
    speed = gravity / (2.0 * frequency)
    return {
        "restitution": rng.uniform(),
        "amplitude": 10.0 ** rng.uniform(-3.0, 0.7) * speed,
        "frequency": frequency,
        "phase": rng.uniform(-7.0, 7.0),
        "gravity": gravity,
        "launch_velocity": rng.uniform(0.0, 3.0) * speed,
        "contact_time": 10.0 ** rng.uniform(-9.0, -1.0) / frequency,
    }


def orbit_of(scene: dict[str, float], law: str) -> tuple[np.ndarray, int]:
    found, inside = orbit(batch_of([scene], law), 0, CAPACITY)
    return found, inside


def same_orbit(first: dict[str, float], second: dict[str, float], law: str) -> bool:
    """Return whether two scenes have the same reduced orbit, bit for bit, counted from the end."""
    (a, inside), (b, other) = orbit_of(first, law), orbit_of(second, law)
    return inside == other and np.array_equal(a[:inside], b[:inside])


def late_launch(law: str, cases: int, seed: int, workers: Workers) -> Outcome:
    """An orbit launched a billion periods later is the same, bit for bit."""
    faults = []
    for number in range(cases):
        rng = np.random.default_rng([seed, number])
        scene = dyadic_scene(rng)
        # a multiple of 2^-20 periods, exact even after a billion periods are added
        start = math.floor(rng.uniform(0.0, 1.0) * 2.0**20) / 2.0**20
        early, later = (
            scene
            | {
                "launch_time": (start + shift) / scene["frequency"],
                "duration": (shift + 40.0) / scene["frequency"],
            }
            for shift in (0.0, float(rng.integers(10**9, 2 * 10**9)))
        )
        if not same_orbit(early, later, law):
            faults.append(str(early))
    return cases, faults


def in_other_units(scene: dict[str, float], length: float, second: float) -> dict[str, float]:
    """Return a scene in units of length and time that are so many times smaller."""
    speed = length / second
    units = {
        "amplitude": speed,
        "frequency": 1.0 / second,
        "gravity": length / second**2,
        "launch_velocity": speed,
        "contact_time": second,
        "duration": second,
    }
    return {name: value * units.get(name, 1.0) for name, value in scene.items()}


def scaled(law: str, cases: int, seed: int, workers: Workers) -> Outcome:
    """Units scaled by powers of two: the same orbit, bit for bit."""
    faults = []
    for number in range(cases):
        rng = np.random.default_rng([seed, number])
        scene = dyadic_scene(rng) | {"launch_time": 0.0}
        scene["duration"] = 40.0 / scene["frequency"]
        length, second = 2.0 ** rng.integers(-30, 31), 2.0 ** rng.integers(-30, 31)
        other = in_other_units(scene, length, second)
        if not same_orbit(scene, other, law):
            faults.append(str(scene))
    return cases, faults


def bound_of(scene: dict[str, float], law: str) -> float:
    out = empty_trust(1)
    trust(0, 1, batch_of([scene], law), np.array([np.inf]), 100_000, out)
    return float(out.landing_error[0])


def scaled_freely(law: str, cases: int, seed: int, workers: Workers) -> Outcome:
    """Units scaled by any factor: the orbits differ by less than both bounds.

    The scaled parameters are rounded: each moves the orbit as the rounding inside the change to
    dimensionless numbers does, so twice the sum of the bounds is allowed.
    """
    tried, faults = 0, []
    for number in range(cases):
        rng = np.random.default_rng([seed, number])
        scene = dyadic_scene(rng) | {"launch_time": 0.0}
        scene["duration"] = 12.0 / scene["frequency"]
        length, second = rng.uniform(0.1, 10.0, 2)
        other = in_other_units(scene, length, second)
        allowed = 2.0 * (bound_of(scene, law) + bound_of(other, law))
        if not allowed < 0.1:
            continue
        tried += 1
        (a, inside), (b, same) = orbit_of(scene, law), orbit_of(other, law)
        if inside != same:
            faults.append(f"{inside} and {same} landings: {scene}")
            continue
        apart = (a[:inside, 0] - b[:inside, 0]) + (a[:inside, 1] - b[:inside, 1])
        if np.any(np.abs(apart) > allowed):
            faults.append(f"{np.abs(apart).max():.3g} > {allowed:.3g}: {scene}")
    return tried, faults


def fold_points(law: str, cases: int, seed: int, workers: Workers) -> Outcome:
    """Landings exactly at folds and zeros of the sine, and one ulp to each side.

    The phase must be exact, and w within three ulp of the larger of its terms.
    """
    tried, faults = 0, []
    folds = (-0.5, -0.25, 0.0, 0.25, 0.5)
    phases = [p for f in folds for p in (np.nextafter(f, -1.0), f, np.nextafter(f, 1.0))]
    phases = [float(p) for p in phases if abs(p) <= 0.5] + [5e-324, -5e-324, 2.0**-54]
    rng = np.random.default_rng(seed)
    with ctx.workprec(2200):
        for phase in phases:
            for _ in range(max(1, cases // len(phases))):
                e, a, whole = rng.uniform(), 10.0 ** rng.uniform(-3.0, 3.0), float(rng.integers(4))
                x, passed = land(phase, whole)
                problem = bare_problem(np.array([e]), np.array([a]))
                w = rebound(constants_of(base_of("high-bounce", law), problem, 0), x, whole)
                tried += 1
                if (x, passed) != (phase, whole):
                    faults.append(f"phase {phase!r} becomes {x!r}")
                exact = abs(arb(e) * whole + arb(a) * (2 * arb(phase)).sin_pi())
                larger = max(e * whole, a * abs(math.sin(2.0 * math.pi * phase)), 1e-300)
                error = float(abs(exact - abs(w)).abs_upper())
                if error > 3.0 * np.spacing(larger):
                    faults.append(f"phase {phase!r}: w off by {error / np.spacing(larger):.3g} ulp")
    return tried, faults


def window_edges(law: str, cases: int, seed: int, workers: Workers) -> Outcome:
    """Landings exactly on the edges of the window, and one ulp to each side, without excitation.

    With frequency 1, gravity 2 and no kick every landing is a sum of exact numbers, so rational
    arithmetic says which landings count: those with begin <= t <= end.
    """
    faults = []
    for number in range(cases):
        rng = np.random.default_rng([seed, number])
        flight = float(rng.integers(1, 2**20)) / 2.0**18
        start = float(rng.integers(0, 2**10)) / 2.0**10 + float(rng.choice([0.0, 10**6]))
        bounce = float(rng.choice([1.0, 0.5]))
        at = [Fraction(start)]
        for k in range(12):
            at.append(at[-1] + Fraction(flight) * Fraction(bounce) ** k)
        first, last = sorted(rng.choice(np.arange(1, 10), 2, replace=False))
        begin, end = float(at[first]), float(at[last])
        begin = float(rng.choice([begin, *np.nextafter(begin, [-np.inf, np.inf])]))
        end = float(rng.choice([end, *np.nextafter(end, [-np.inf, np.inf])]))
        expected = sum(Fraction(begin) <= t <= Fraction(end) for t in at[1:])
        scene = {
            "restitution": bounce, "amplitude": 0.0, "frequency": 1.0, "phase": 0.0,
            "gravity": 2.0, "launch_velocity": flight, "contact_time": 1e-9,
        }  # fmt: skip
        plain = Scene(1, (start,), end, law).recorded(10_000)
        watched = plain.with_measures(transient=begin, separation=True)
        parameters = {name: np.array([scene[name]]) for name in PARAMETERS}
        count = int(measure(parameters, watched, workers)["impact_count"][0])
        if bounce == 1.0:
            expected = count_steady(start, flight, begin, end)
        if count != expected:
            faults.append(f"{count} landings, {expected} expected: {start} {flight} {begin} {end}")
    return cases, faults


def count_steady(start: float, flight: float, begin: float, end: float) -> int:
    """Landings at start + k flight, k >= 1, in [begin, end], in rational arithmetic."""
    low = math.ceil((Fraction(begin) - Fraction(start)) / Fraction(flight))
    high = math.floor((Fraction(end) - Fraction(start)) / Fraction(flight))
    return max(0, high - max(low, 1) + 1)


def bad_company(law: str, cases: int, seed: int, workers: Workers) -> Outcome:
    """A realization that overflows or exhausts its budget changes no bit of the others."""
    faults = []
    for number in range(max(1, cases // 10)):
        rng = np.random.default_rng([seed, number])
        scenes = [dyadic_scene(rng) for _ in range(40)]
        given = {name: np.array([scene[name] for scene in scenes]) for name in PARAMETERS}
        given["frequency"][:] = 1.0
        observation = Scene(3, (0.0, 0.25, 0.3), 12.0, law).recorded(2000).with_measures(
            transient=0.0, separation=True, per_particle=True, regimes=True, trust=True,
            tolerance=1e-9,
        )  # fmt: skip
        bad = {name: values.copy() for name, values in given.items()}
        where = rng.choice(40, 4, replace=False)
        bad["launch_velocity"][where[0]] = 1e200
        # the square of a flight overflows
        bad["amplitude"][where[1]], bad["launch_velocity"][where[1]] = 1e300, 1.0
        bad["contact_time"][where[2]], bad["amplitude"][where[2]] = 1e-300, 1e-290
        bad["launch_velocity"][where[3]] = 1e15
        try:
            alone, beside = (measure(p, observation, workers) for p in (given, bad))
        except Exception as error:
            faults.append(f"{type(error).__name__}: {error}")
            continue
        others = np.setdiff1d(np.arange(40), where)
        for name, values in alone.items():
            if not np.array_equal(values[others], beside[name][others], equal_nan=True):
                faults.append(f"{name} of the others changes")
        if beside["status"][where[1]] != Status.NON_FINITE:
            faults.append("an overflow is not reported")
    return max(1, cases // 10), faults


def many_particles(law: str, cases: int, seed: int, workers: Workers) -> Outcome:
    """10^5 particles: separations against all landings, sorted."""
    number = 100_000
    given = {name: np.array([p.default]) for name, p in PARAMETERS.items()}
    rng = np.random.default_rng(seed)
    launch = tuple(rng.uniform(0.0, 1.0, number).tolist())
    plain = Scene(number, launch, 3.0, law).recorded(1000)
    measured = measure(given, plain.with_measures(transient=0.0, separation=True), workers)
    record = record_landings(given, plain, workers)
    times = record["landing_time"][0]
    order = np.argsort(times, axis=None)
    flat, who = times.ravel()[order], order // times.shape[1]
    flat = flat[~np.isnan(flat)]
    gaps, different = np.diff(flat), np.diff(who[: flat.size]) != 0
    smallest = gaps[different].min()
    faults = []
    if abs(float(measured["dt_min"][0]) - smallest) > 8.0 * ULP:
        faults.append(f"dt_min {measured['dt_min'][0]!r}, {smallest!r} from all landings")
    if int(measured["impact_count"][0]) != flat.size:
        faults.append("the counts differ")
    return 1, faults


EXACT: dict[str, Callable[[str, int, int, Workers], Outcome]] = {
    "launch 10^9 periods later: same bits": late_launch,
    "units scaled by powers of two: same bits": scaled,
    "units scaled freely: within both bounds": scaled_freely,
    "phases 0, 1/4, 1/2 and one ulp off": fold_points,
    "landings on the window's edges and one ulp off": window_edges,
    "a bad realization in a batch of 40": bad_company,
    "10^5 particles": many_particles,
}
