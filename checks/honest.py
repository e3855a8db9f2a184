"""Compute random sweeps and verify them: an honest file never fails.

    python checks/honest.py [--specs 300] [--seed 1] [--seconds 3600]

Every specification that fails is printed with its complaints.  It ends with 1 if there is any.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from vibrosweep.proof.verification import State
from vibrosweep.proof.verify import verify
from vibrosweep.runs.driver import run_sweep
from vibrosweep.spec.sweep import parse_spec

DESIGNS = ("uniform", "latin", "sobol", "grid")


def random_spec(rng: np.random.Generator, longest: float = 300.0) -> str:
    """Text of a small sweep: any base, law, window and measures, few realizations."""

    def truth(probability: float = 0.5) -> str:
        return "true" if rng.random() < probability else "false"

    frequency = float(rng.choice([1.0, 1.0, rng.uniform(0.2, 40.0)]))
    particles, realizations = int(rng.integers(1, 5)), int(rng.integers(1, 4))
    periods = float(np.exp(rng.uniform(0.0, np.log(longest))))
    duration = periods / frequency
    if rng.random() < 0.3:
        duration = round(duration, 2) + 0.01
    launch = '"staggered"'
    if rng.random() < 0.5:
        times = rng.uniform(-1.0, 2.0, particles) / frequency
        if rng.random() < 0.3:
            times = np.round(times * frequency) / frequency
        launch = "[" + ", ".join(repr(float(t)) for t in times) + "]"
    transient = rng.choice([0.0, rng.uniform(0.0, 0.95)]) * duration
    design = str(rng.choice(DESIGNS, p=(0.4, 0.1, 0.1, 0.4)))
    scale = 1.0 / frequency  # the kick in periods is that of 1 Hz
    base = str(rng.choice(["high-bounce", "moving"]))
    rebound = str(rng.choice(["rest", "reflect"])) if base == "high-bounce" else "rest"
    largest = 4.0 if base == "high-bounce" else float(rng.choice([4.0, 30.0]))
    low = float(rng.choice([0.0, 0.3, 0.8, 0.95])) if rng.random() < 0.8 else 0.999
    restitution = (low, float(rng.uniform(low, 1.0)) if rng.random() < 0.9 else 1.0)
    amplitude = sorted((scale * rng.uniform(0.0, largest, 2)).tolist())
    if rng.random() < 0.1:
        amplitude[0] = 0.0
    if design == "grid":
        # not e = 0 or 1 themselves more often than by chance
        axes = [
            sorted(set(rng.uniform(*ends, int(rng.integers(1, 3))).tolist()))
            for ends in (restitution, amplitude)
        ]
        if rng.random() < 0.15:
            axes[0] = [float(rng.choice([0.0, 1.0, 0.5]))]
        if rng.random() < 0.15:
            axes[1] = [0.0]
        sampled = f"restitution = {axes[0]}\namplitude = {axes[1]}"
    else:
        sampled = (
            f"realizations = {realizations}\nseed = {int(rng.integers(1000))}\n"
            f"restitution = [{restitution[0]!r}, {restitution[1]!r}]\n"
            f"amplitude = [{amplitude[0]!r}, {amplitude[1] + 1e-3!r}]"
        )
    record = ""
    if rng.random() < 0.2:
        record = f"[record]\nrestitution = {restitution[1]!r}\namplitude = {amplitude[1]!r}\n"
    return f"""title = "Honest"
[scene]
frequency = {frequency!r}
phase = {float(rng.choice([0.0, rng.uniform(-10.0, 10.0)]))!r}
launch_velocity = {float(scale * rng.choice([5.0, rng.uniform(0.0, 20.0)]))!r}
contact_time = {float(scale * rng.choice([1e-4, 1e-2, 1e-6, 1e-9]))!r}
particles = {particles}
launch = {launch}
duration = {duration!r}
rebound = "{rebound}"
base = "{base}"
[sample]
design = "{design}"
{sampled}
[measure]
transient = {float(transient)!r}
separation = {truth()}
per_particle = {truth()}
regimes = {truth(0.7)}
lyapunov = {truth(0.7)}
trust = {truth()}
{record}"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--specs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=3600.0)
    options = parser.parse_args()
    begun, done, failed = time.perf_counter(), 0, 0
    states: Counter[str] = Counter()
    undecided: Counter[str] = Counter()
    compared: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        for number in range(options.specs):
            if time.perf_counter() - begun > options.seconds:
                break
            rng = np.random.default_rng([options.seed, number])
            text = random_spec(rng)
            path = Path(folder, "honest.h5")
            run_sweep(parse_spec(text), path, threads=1, force=True)
            report = verify(path)
            done += 1
            states.update({state.value: report.count(state) for state in State})
            for name, found in report.variables().items():
                undecided[name] += len(found.undecided)
                compared[name] += len(found.errors)
            if not report.passed:
                failed += 1
                print(f"--- specification {number} of seed {options.seed}\n{text}")
                print("\n".join(report.complaints()), flush=True)
    seconds = time.perf_counter() - begun
    print(f"{done} specifications in {seconds:.0f} s, {failed} of them failed")
    print(", ".join(f"{number} {state}" for state, number in states.items() if number))
    print("undecided:", ", ".join(f"{n} {k}/{compared[n]}" for n, k in undecided.items() if k))
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
