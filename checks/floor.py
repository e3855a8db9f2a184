"""Restitution of a ball on a floor: do its errors hold, are laws found, are constants left alone.

Virtual films and lists of clicks with everything on that real recordings show; run
`python checks/floor.py --sets 200 --first 1000` with seeds that were not used before.  Exits with
1 if a share lies outside of what is demanded.
"""

import argparse
import sys

import numpy as np

from vibrosweep.errors import TrackError
from vibrosweep.lab import FloorExperiment, film_drops, hear_drops, restitution

# Shares of the 68 % and 95 % intervals that hold the truth, and rms of deviation over error
DEMANDED = {"68 %": (0.60, 0.76), "95 %": (0.91, 0.985), "rms": (0.9, 1.15)}


def drawn(rng, kind, slope=0.0):
    """A ball and its recording, with random properties."""
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
    """The truth, the result (None if nothing was found) for one set of drops."""
    rng = np.random.default_rng(seed)
    setup, about = drawn(rng, kind, slope)
    drops = int(rng.integers(6, 17)) if kind == "times" else int(rng.integers(4, 9))
    record = hear_drops if kind == "times" else film_drops
    recordings, _ = record(setup, drops, seed + 10**6)  # numbers that the setup did not use
    try:
        return setup, restitution(recordings, **about)
    except TrackError as error:
        print(f"seed {seed}: {error}")
        return setup, None


def campaign(kind, sets, first):
    """Print the shares of one kind of recording; return whether all are as demanded."""
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
            print(f"seed {seed}: {scores[-1]:.1f} errors off, {setup}")
    hit = 0
    for seed, error in slopes:  # the same balls, whose e now falls by 4 standard errors
        found = measured(kind, seed, -4.0 * error)[1]
        hit += found is not None and found.attrs["dependence"] == "falls"
    n = len(scores)
    shares = np.mean(covered, axis=0)
    values = {"68 %": shares[0], "95 %": shares[1], "rms": np.sqrt(np.mean(np.square(scores)))}
    print(f"{kind}: {n} sets, {failed} not measured")
    good = failed == 0
    for name, (low, high) in DEMANDED.items():
        good &= low <= values[name] <= high
        print(f"  {name}: {values[name]:.3f} (demanded {low} to {high})")
    print(f"  mean deviation {np.mean(scores):.2f} errors; limit of the scatter holds in {scatter}")
    print(f"  a constant e called a law: {laws} (at most {0.05 * sets:g})")
    print(f"  a change of 4 standard errors found: {hit} of {n} (at least 90 %)")
    return good and laws <= 0.05 * sets and hit >= 0.9 * n


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=200)
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--kinds", nargs="+", default=["times", "films"])
    given = parser.parse_args()
    results = [campaign(kind, given.sets, given.first) for kind in given.kinds]
    sys.exit(not all(results))
