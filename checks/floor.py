"""Restitution of a ball: coverage of stated errors, detection of laws, false detections.

Virtual films and lists of clicks over a floor and over a shaken base, with all
effects seen in real recordings; run `python checks/floor.py --sets 200 --first 1000` with unused
seeds.  Exits with 1 if a coverage lies outside its required range.
"""

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.optimize import brentq

from vibrosweep.errors import TrackError
from vibrosweep.lab import (
    Camera,
    Experiment,
    FloorExperiment,
    Recording,
    Variation,
    estimate,
    film_drops,
    find_impacts,
    hear_drops,
    read_tracks,
    restitution,
    times_on_shaker,
)
from vibrosweep.lab.trials import write_experiments

TWO_PI, G = 2.0 * np.pi, 9.81
MOTION = ("frequency", "restitution", "base_acceleration", "phase")
TRANSIENT = 20  # impacts before the beginning of a recording over a shaken base
RATES = (240.0, 300.0, 480.0, 500.0, 600.0, 1000.0)  # frames per second over a shaken base
SHORTEST = 4e-3  # s, shortest flight over a shaken base
# Required coverage of 68 % and 95 % intervals, and rms of deviations in standard errors
REQUIRED = {"68 %": (0.60, 0.76), "95 %": (0.91, 0.985), "rms": (0.9, 1.15)}


def random_setup(rng, kind, slope=0.0):
    """A random ball and its recording."""
    mass, diameter = rng.uniform(0.005, 0.06), rng.uniform(0.015, 0.05)
    drag = rng.normal(1.0, 0.2) * 0.47 * 1.2 * np.pi * diameter**2 / 8.0 / (mass * 9.81)
    setup = FloorExperiment(
        height=rng.uniform(0.4, 1.2),
        height_spread=0.03,
        restitution=rng.uniform(0.6, 0.92),
        slope=slope,
        scatter=rng.uniform(0.003, 0.012),
        drop_scatter=rng.uniform(0.0, 0.005),
        contact_time=np.exp(rng.uniform(np.log(2e-4), np.log(5e-3))),
        contact=rng.choice(["dashpot", "hertz"]),
        terminal_speed=max(drag, 1e-6) ** -0.5,
        bounces=int(rng.integers(5, 10)),
        frame_rate=rng.uniform(120.0, 500.0),
        noise=rng.uniform(1e-4, 6e-4),
        unit=rng.choice([1.0, 5e-4]),
        lost=rng.choice([0.0, 0.03]),
        hands=bool(rng.integers(2)),
        timing=rng.uniform(5e-5, 5e-4),
        missed=rng.choice([0.0, 0.02]),
        false=rng.choice([0.0, 0.02]),
        rounding=rng.choice([0.0, 1e-3]) if kind == "times" else 0.0,
    )
    return setup, {"mass": mass, "diameter": diameter}


def measured(kind, seed, slope=0.0):
    """The truth, and the result for one set of drops; None if it was refused."""
    rng = np.random.default_rng(seed)
    setup, about = random_setup(rng, kind, slope)
    drops = int(rng.integers(6, 17)) if kind == "times" else int(rng.integers(4, 9))
    record = hear_drops if kind == "times" else film_drops
    recordings, _ = record(setup, drops, seed + 10**6)  # random numbers independent of the setup
    try:
        return setup, restitution(recordings, **about)
    except TrackError as error:
        print(f"seed {seed}: {error}")
        return setup, None


def in_range(name, scores, shares):
    """Print coverage and rms for one quantity; return whether they are in the required ranges."""
    values = {"68 %": shares[0], "95 %": shares[1], "rms": np.sqrt(np.mean(scores**2))}
    good = all(low <= values[key] <= high for key, (low, high) in REQUIRED.items())
    words = ", ".join(f"{key} {value:.3f}" for key, value in values.items())
    print(f"  {name}: {words}{'' if good else ', out of range'}")
    return good


def orbit(rng, truth, impacts):
    """Return impact times over a sine, relative to the first, and the first; None at rest."""
    rate, contact = TWO_PI * truth["frequency"], truth["contact"]
    peak = truth["base_acceleration"] * G / rate

    def height(t):
        return -peak / rate * np.cos(rate * t + truth["phase"])

    def velocity(t):
        return peak * np.sin(rate * t + truth["phase"])

    up, leaves, times, step = -5.0 - rng.random(), 4.0 * peak, [], TWO_PI / rate / 200
    grid = step * np.arange(1, 4000)
    while len(times) < TRANSIENT + impacts:

        def gap(since, up=up, leaves=leaves):
            return height(up) + leaves * since - G / 2.0 * since**2 - height(up + since)

        below = np.flatnonzero(gap(grid) < 0.0)
        if not below.size or grid[below[0]] < SHORTEST:
            return None
        since = brentq(gap, grid[below[0]] - step, grid[below[0]])
        arrives, lands = leaves - G * since, up + since
        e = truth["restitution"] + truth["scatter"] * rng.standard_normal()
        up = lands + contact
        leaves = velocity(up) + e * (velocity(lands) - arrives)
        times.append(lands)
    times = np.array(times[TRANSIENT:])
    return times - times[0], times[0]


def clicks_on_shaker(seed):
    """Return clicks of an irregular orbit, and the truth with the phase on the same clock."""
    rng, found = np.random.default_rng(seed), None
    while found is None or np.std(np.diff(found[0])) < 0.1 * np.diff(found[0]).mean():
        truth = {
            "frequency": rng.uniform(10.0, 60.0),
            "restitution": rng.uniform(0.5, 0.9),
            "base_acceleration": rng.uniform(1.5, 6.0),
            "phase": rng.uniform(-np.pi, np.pi),
            "scatter": rng.uniform(0.0, 0.01),
            "contact": rng.choice([0.0, 5e-4]),
            "timing": rng.uniform(5e-5, 3e-4),
        }
        found = orbit(rng, truth, int(rng.integers(30, 90)))
    time, origin = found
    truth["phase"] += TWO_PI * truth["frequency"] * origin
    time = time + truth["timing"] * rng.standard_normal(time.size)
    share, rounding = rng.choice([0.0, 0.02]), rng.choice([0.0, 1e-4])
    extra = rng.uniform(time[0], time[-1], rng.poisson(share * time.size))
    time = np.sort(np.append(time[rng.random(time.size) >= share], extra))
    time = np.round(time / rounding) * rounding if rounding else time
    return Recording(f"seed {seed}", "", time, None, None, True, True, rounding, None), truth


def film_on_shaker(seed):
    """Return tracks of irregular orbits as files hold them, the truth, and the ball."""
    rng = np.random.default_rng((seed, 54))
    mass, diameter = rng.uniform(0.005, 0.06), rng.uniform(0.015, 0.05)
    drag = rng.normal(1.0, 0.2) * 0.47 * 1.2 * np.pi * diameter**2 / 8.0 / (mass * 9.81)
    truth = {
        "frequency": rng.uniform(8.0, 40.0),
        "restitution": rng.uniform(0.5, 0.9),
        "base_acceleration": rng.uniform(1.5, 4.0),
        "phase": rng.uniform(-np.pi, np.pi),
    }
    displacement = truth["base_acceleration"] * G / (TWO_PI * truth["frequency"]) ** 2
    begin = rng.uniform(0.5, 2.0)
    camera = Camera(
        frame_rate=rng.choice([r for r in RATES if r > 12.0 * truth["frequency"]]),
        pixel=displacement * rng.uniform(0.02, 0.06),
        noise=rng.uniform(0.5, 1.0),
        dropped=rng.choice([0.0, rng.uniform(0.0, 0.03)]),
        scale_error=rng.uniform(-0.005, 0.005),
        rounding=rng.choice([0.0, 1e-3]),
    )
    variation = Variation(
        level_spread=rng.uniform(0.0, 5e-4),
        scatter=rng.uniform(0.0, 0.01),
        contact_time=np.exp(rng.uniform(np.log(2e-4), np.log(3e-3))),
        contact=str(rng.choice(["dashpot", "hertz"])),
        terminal_speed=max(drag, 1e-6) ** -0.5,
    )
    plan = Experiment(
        **truth,
        base="moving",
        launch_velocity=rng.uniform(0.15, 0.4),
        particles=int(rng.integers(2, 4)),
        transient=begin,
        duration=begin + rng.uniform(4.0, 6.0),
        repeats=1,
        camera=camera,
        variation=variation,
        seed=seed,
    )
    with TemporaryDirectory() as place:
        tracks, landings = write_experiments([plan], Path(place), "film", force=False)
        flight = np.diff(np.genfromtxt(landings, delimiter=",", skip_header=1)[:, 2])
        if np.std(flight[flight > 0.0]) < 0.1 * flight[flight > 0.0].mean():
            return film_on_shaker(seed + 10**6)
        return read_tracks([tracks]), truth, variation, {"mass": mass, "diameter": diameter}


def shaken_films_campaign(sets, first):
    """Print coverages for films over a shaken base; return whether all are in range."""
    scores, refused, limits = {name: [] for name in MOTION}, 0, np.zeros(2, int)
    for seed in range(first, first + sets):
        tracks, truth, variation, ball = film_on_shaker(seed)
        scale = {"gravity": (0.995 * G, 1.005 * G), "contact": (2e-4, 5e-3)}
        try:
            found = estimate(find_impacts(tracks, motion="moving", **scale, **ball))
            warning = found.attrs["warning"] * (not found["determined"])
        except TrackError as error:
            warning = str(error)
        if warning:
            print(f"seed {seed}: {warning}", flush=True)
            refused += 1
            continue
        limits[0] += float(found["scatter_limit"]) >= variation.scatter
        row = f"seed {seed}:"
        for name in MOTION:
            if name == "base_acceleration":
                value, error = float(found[name]), float(found[f"{name}_error"])
            else:
                own = found.sel(parameter=name)
                value, error = float(own["estimate"]), float(own["error"])
            off = value - truth[name]
            off = (off + np.pi) % TWO_PI - np.pi if name == "phase" else off
            scores[name].append(off / error)
            row += f" {name} {off / error:.2f}"
        print(row, flush=True)
    return judged("films over a shaken base", scores, refused, sets, limits)


def shaken_campaign(sets, first):
    """Print coverages for times over a shaken base; return whether all are in range."""
    scores, refused, limits = {name: [] for name in MOTION}, 0, np.zeros(2, int)
    for seed in range(first, first + sets):
        recording, truth = clicks_on_shaker(seed)
        try:
            found = times_on_shaker([recording], contact=truth["contact"] or None)
        except TrackError as error:
            print(error)
            found = None
        if found is None or not found["determined"]:
            refused += 1
            continue
        limits += [float(found[f"{k}_limit"]) >= truth[k] for k in ("scatter", "timing")]
        for name in MOTION:
            off = float(found[name]) - truth[name]
            off = (off + np.pi) % TWO_PI - np.pi if name == "phase" else off
            scores[name].append(off / float(found[f"{name}_error"]))
    return judged("times over a shaken base", scores, refused, sets, limits)


def judged(kind, scores, refused, sets, limits):
    """Print coverages of all numbers; return whether all are in range."""
    print(f"{kind}: {sets - refused} sets, {refused} not determined (at most {0.05 * sets:g})")
    good = refused <= 0.05 * sets
    for name, values in scores.items():
        far = np.abs(values)
        good &= in_range(name, far, (np.mean(far < 1.0), np.mean(far < 1.96)))
    print(f"  upper limits of scatter and timing hold in {limits[0]} and {limits[1]}")
    return good


def campaign(kind, sets, first):
    """Print coverages for one kind of recording; return whether all are in range."""
    scores, covered, laws, failed, scatter = [], [], 0, 0, 0
    slopes = []
    for seed in range(first, first + sets):
        setup, found = measured(kind, seed)
        if found is None:
            failed += 1
            continue
        truth = setup.restitution
        q = found["restitution_quantile"].values
        scores.append(float((found["restitution"] - truth) / found["restitution_error"]))
        covered.append((q[1] <= truth <= q[2], q[0] <= truth <= q[3]))
        laws += found.attrs["dependence"] != "constant"
        scatter += float(found["scatter_limit"]) >= setup.scatter
        slopes.append((seed, float(found["slope_error"])))
        if abs(scores[-1]) > 3.5:
            print(f"seed {seed}: deviation of {scores[-1]:.1f} errors, {setup}")
    detected = 0
    for seed, error in slopes:  # the same balls, with a slope of e of 4 standard errors
        found = measured(kind, seed, -4.0 * error)[1]
        detected += found is not None and found.attrs["dependence"] == "falls"
    n = len(scores)
    print(f"{kind}: {n} sets, {failed} not measured")
    good = failed == 0 and in_range("e", np.array(scores), np.mean(covered, axis=0))
    print(
        f"  mean deviation {np.mean(scores):.2f} errors; upper limit of scatter holds in {scatter}"
    )
    print(f"  constant e found to vary: {laws} (at most {0.05 * sets:g})")
    print(f"  slope of 4 standard errors detected: {detected} of {n} (at least 90 %)")
    return good and laws <= 0.05 * sets and detected >= 0.9 * n


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=200)
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--kinds", nargs="+", default=["times", "films", "shaken"])
    given = parser.parse_args()
    shaken = {"shaken": shaken_campaign, "shaken_films": shaken_films_campaign}
    results = [
        shaken[kind](given.sets, given.first)
        if kind in shaken
        else campaign(kind, given.sets, given.first)
        for kind in given.kinds
    ]
    sys.exit(not all(results))
