"""Compute random sweeps and verify them: an honest file never fails.

    python checks/honest.py [--specs 300] [--seed 1] [--seconds 3600]

Every specification that fails is printed with its complaints.  The exit code is 1 if any fails.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from accuracy import options_of
from vibrosweep.proof.report import ProofState
from vibrosweep.proof.verifying import verify
from vibrosweep.runs.driver import run_sweep
from vibrosweep.scene.sweep import parse_spec

DESIGNS = ("uniform", "latin", "sobol", "grid")
FORCINGS = {  # value for an amplitude of 1 m/s at e = 0.9 and 1 Hz, and power of the frequency
    "amplitude": (1.0, -1),
    "base_velocity": (1.0 / 1.9, -1),
    "base_displacement": (1.0 / 1.9 / (2.0 * np.pi), -2),
    "base_acceleration": (2.0 * np.pi / 1.9 / 9.81, 0),
}
LONGEST_COUPLED = 30.0  # periods; in longer sweeps verify meets too many landings to prove any


def random_spec(rng: np.random.Generator, longest: float = 300.0) -> str:
    """Text of a small sweep: any base, law, forcing, window and measures, few realizations."""

    def truth(probability: float = 0.5) -> str:
        return "true" if rng.random() < probability else "false"

    frequency = float(rng.choice([1.0, 1.0, rng.uniform(0.2, 40.0)]))
    period = 1.0 / frequency
    particles = int(rng.integers(1, 5))
    base = str(rng.choice(["high-bounce", "moving", "sprung"], p=(0.4, 0.4, 0.2)))
    rebound = str(rng.choice(["rest", "reflect"])) if base == "high-bounce" else "rest"
    most = min(longest, LONGEST_COUPLED) if base == "sprung" else longest
    duration = float(np.exp(rng.uniform(0.0, np.log(most))))
    in_periods = bool(rng.random() < 0.3)
    if not in_periods:
        duration *= period
        if rng.random() < 0.3:
            duration = round(duration, 2) + 0.01
    times_are = "_periods" if in_periods else ""
    launch = '"staggered"'
    if rng.random() < 0.5:
        times = rng.uniform(-1.0, 2.0, particles) * period
        if rng.random() < 0.3:
            times = np.round(times * frequency) * period
        launch = "[" + ", ".join(repr(float(t)) for t in times) + "]"
    transient = float(rng.choice([0.0, rng.uniform(0.0, 0.95)])) * duration
    if base == "sprung":
        mount = f"""mass_ratio = {float(rng.choice([0.0, 10.0 ** rng.uniform(-4.0, 0.0)]))!r}
mount_frequency = {frequency * 10.0 ** rng.uniform(-1.0, 0.7)!r}
mount_damping = {float(rng.choice([0.0, 0.05, 1.0, rng.uniform(0.0, 3.0)]))!r}
"""
        measures = f"joint = {truth()}"
    else:
        mount = ""
        measures = f"regimes = {truth(0.7)}\nlyapunov = {truth(0.7)}\ntrust = {truth()}"
        measures += "\nordering = true"
    sampled, recorded = random_sample(rng, base, frequency)
    record = f"[record]\n{recorded}{mount}" if rng.random() < 0.2 else ""
    return f"""title = "Honest"
[scene]
frequency = {frequency!r}
phase = {float(rng.choice([0.0, rng.uniform(-10.0, 10.0)]))!r}
launch_velocity = {float(period * rng.choice([5.0, rng.uniform(0.0, 20.0)]))!r}
contact_time = {float(period * rng.choice([1e-4, 1e-2, 1e-6, 1e-9]))!r}
particles = {particles}
launch = {launch}
duration{times_are} = {duration!r}
rebound = "{rebound}"
base = "{base}"
{mount}[sample]
{sampled}
[measure]
transient{times_are} = {transient!r}
separation = {truth()}
per_particle = {truth()}
{measures}
{record}"""


def random_sample(rng: np.random.Generator, base: str, frequency: float) -> tuple[str, str]:
    """Keys of [sample], and of a [record] at the end of its ranges."""
    forcing = str(rng.choice(list(FORCINGS)))
    factor, power = FORCINGS[forcing]
    scale = factor * frequency**power  # the kick in periods is that of 1 Hz
    largest = 4.0 if base == "high-bounce" else float(rng.choice([4.0, 30.0, 148.0]))
    low = float(rng.choice([0.0, 0.3, 0.8, 0.95])) if rng.random() < 0.8 else 0.999
    restitution = (low, float(rng.uniform(low, 1.0)) if rng.random() < 0.9 else 1.0)
    strength = sorted((scale * rng.uniform(0.0, largest, 2)).tolist())
    if rng.random() < 0.1:
        strength[0] = 0.0
    design = str(rng.choice(DESIGNS, p=(0.4, 0.1, 0.1, 0.4)))
    if design == "grid":
        # inside the ranges: e = 0 and 1 themselves come only from the choice below
        axes = [
            sorted(set(rng.uniform(*ends, int(rng.integers(1, 3))).tolist()))
            for ends in (restitution, strength)
        ]
        if rng.random() < 0.15:
            axes[0] = [float(rng.choice([0.0, 1.0, 0.5]))]
        if rng.random() < 0.15:
            axes[1] = [0.0]
        ranges = f"restitution = {axes[0]}\n{forcing} = {axes[1]}"
    else:
        ranges = (
            f"realizations = {int(rng.integers(1, 4))}\nseed = {int(rng.integers(1000))}\n"
            f"restitution = [{restitution[0]!r}, {restitution[1]!r}]\n"
            f"{forcing} = [{strength[0]!r}, {strength[1] + 1e-3 * scale!r}]"
        )
    recorded = f"restitution = {restitution[1]!r}\n{forcing} = {strength[1]!r}\n"
    return f'design = "{design}"\n{ranges}', recorded


def main() -> int:
    options = options_of(__doc__, specs=300, seed=1, seconds=3600.0, write=False)
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
            states.update({state.value: report.count(state) for state in ProofState})
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
