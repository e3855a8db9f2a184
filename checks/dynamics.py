"""Regimes, exponents and windows over a grid of 200 x 200 with 20 particles: times and accuracy.

Prints the numbers of checks/README.md.  Times are processor times, summed over both threads, since
the machine may be shared; kernels are compiled beforehand.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import vibrosweep as vs
from vibrosweep import theory
from vibrosweep.analysis.windows import find_windows
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import Workers
from vibrosweep.scene.sweep import read_spec

PLANE = Path(__file__).parents[1] / "sweeps" / "plane.toml"
SIZE = 200
REALIZATIONS_AT_A_TIME = 4000


def clocked(task):
    """Result, processor time and wall time in s."""
    processor, wall = time.process_time(), time.perf_counter()
    result = task()
    return result, time.process_time() - processor, time.perf_counter() - wall


def plane(workers, **changes):
    """Measure the plane; compare known sums of exponents with ln e.

    Returns their number, how many are off by more than their error, and the largest deviation.
    """
    spec = read_spec(PLANE)
    scene = spec.scene
    observation = scene.with_measures(**changes)
    grid = np.meshgrid(
        spec.design.sampled["restitution"].values, spec.design.sampled["amplitude"].values
    )
    e, amplitude = (axis.ravel() for axis in grid)
    orbits, beyond, largest = 0, 0, 0.0
    for start in range(0, e.size, REALIZATIONS_AT_A_TIME):
        piece = slice(start, start + REALIZATIONS_AT_A_TIME)
        parameters = scene.parameters({"restitution": e[piece], "amplitude": amplitude[piece]})
        found = measure(parameters, observation, workers)
        if observation.measures.lyapunov:
            off = np.abs(found["lyapunov_sum"] - np.log(e[piece])[:, np.newaxis])
            known = np.isfinite(found["lyapunov_sum"])
            orbits += np.count_nonzero(known)
            beyond += np.count_nonzero(off[known] > found["lyapunov_sum_error"][known])
            largest = max(largest, off[known].max(initial=0.0))
    return orbits, beyond, largest


def windows(conditions, **options):
    """Windows over the same plane."""
    asked = {"conditions": conditions, **options}
    return find_windows(replace(read_spec(PLANE), windows=asked), 2)


def worst_end(frequency):
    """Largest relative deviation of an end of a locked window from its closed form."""
    e = np.linspace(0.30, 0.99, SIZE)
    scan = np.linspace(0.005, 14.5, SIZE) / frequency  # from below every end
    names = [f"locked({k})" for k in (1, 2, 3, 4)]
    found = vs.windows(
        restitution=e, amplitude=scan, frequency=frequency, conditions=names, threads=2
    )
    assert (found["window_count"] == 1).all()
    off = 0.0
    for k, name in enumerate(names, start=1):
        one = found.sel(condition=name, direction="launch").isel(window=0)
        for end, exact in (("A_min", theory.amplitude_min), ("A_max", theory.amplitude_max)):
            off = max(off, float(np.abs(one[end].values / exact(k, e, frequency) - 1.0).max()))
    return off


def main() -> None:
    with Workers(2) as workers:
        for condition in ("ordered", "regular"):  # compile
            for way in (False, True):
                vs.windows(amplitude=[1.0, 3.0], conditions=[condition], continuation=way)
        print("| what | processor (s) | wall (s) |\n|---|---|---|")
        lines = [
            ("regimes", lambda: plane(workers, lyapunov=False)),
            ("regimes and exponents", lambda: plane(workers)),
            ("windows of locked(1) ... locked(4)", lambda: worst_end(1.0)),
            ("windows of `ordered`", lambda: windows(["ordered"])),
            ("windows of `periodic`", lambda: windows(["periodic"])),
            ("windows of `regular`", lambda: windows(["regular"])),
            (
                "windows of `ordered`, continued up and down",
                lambda: windows(["ordered"], continuation=True),
            ),
        ]
        for name, task in lines:
            result, processor, wall = clocked(task)
            print(f"| {name} | {processor:.1f} | {wall:.1f} |", flush=True)
            if name == "regimes and exponents":
                sums = result
    print(
        f"{sums[0]} orbits without rests: the sum of exponents is off ln e by at most "
        f"{sums[2]:.1e}, by more than its own error in {sums[1]}"
    )
    for frequency in (1.0, 17.0):
        print(f"{frequency} Hz: ends of locked windows off by {worst_end(frequency):.1e} at most")


if __name__ == "__main__":
    main()
