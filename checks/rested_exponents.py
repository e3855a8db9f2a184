"""Largest exponents of chaos over a moving base, by a plain loop: what rests do to their mean.

Prints the numbers of checks/README.md; takes about 90 s of processor time.  The loop shares no code
with the package.  A trajectory that rests forgets its past, so that it has no finite exponent: the
package gives NaN.  The loop averages the growth of a tangent vector over trajectories that do not
rest within so many impacts, and over all impacts before the first rest.
"""

from __future__ import annotations

import math

import numba
import numpy as np

import vibrosweep as vs

FREQUENCY, RESTITUTION = 60.0, 0.85
ACCELERATIONS = (2.5, 3.0, 4.0)  # in g
CONTACT_TIME = 1e-4  # s
TRAJECTORIES, IMPACTS, SKIPPED = 4000, 3000, 50
TURN = 2.0 * math.pi


@numba.njit
def flight(gamma, x, y):
    """Duration of the flight from phase x with relative speed y, and speed of arrival.

    The height is positive up to the root of the parabola of the largest fall, 1 + gamma.
    """
    alpha = gamma / math.pi
    u = y + alpha * math.sin(TURN * x)
    s, height, slope = 0.0, 0.0, 0.5 * y
    while True:
        root = math.sqrt(slope * slope + 2.0 * (1.0 + gamma) * max(height, 0.0))
        step = (slope + root) / (1.0 + gamma)
        s += step
        fallen = math.cos(TURN * (x + s)) - math.cos(TURN * x)
        height = 0.5 * s * (u - s) + 0.5 * alpha / TURN * fallen
        slope = 0.5 * (u - 2.0 * s - alpha * math.sin(TURN * (x + s)))
        if step < 1e-13 * (1.0 + s) or (height <= 1e-15 and slope < 0.0):
            return s, -2.0 * slope


@numba.njit
def follow(gamma, e, r, x, y, logs):
    """Write the growth of a tangent vector in each impact; return their number until a rest."""
    alpha = gamma / math.pi
    across, along = 0.6, 0.8
    for k in range(logs.size):
        s, v = flight(gamma, x, y)
        change = alpha * (math.sin(TURN * (x + s)) - math.sin(TURN * x))
        before = alpha * TURN * math.cos(TURN * x)
        after = alpha * TURN * math.cos(TURN * (x + s))
        faster = along + before * across
        longer = (s * faster - change * across) / v
        across += longer
        along = e * (2.0 * longer - faster + after * across)
        x = x + s - np.rint(x + s)
        y = e * v
        if y <= r and 1.0 + gamma * math.cos(TURN * x) > 0.0:
            return k
        size = math.hypot(across, along)
        logs[k] = math.log(size)
        across, along = across / size, along / size
    return logs.size


def plain(gamma: float, random: np.random.Generator) -> None:
    """Print the means of the loop, with standard errors."""
    logs = np.zeros((TRAJECTORIES, IMPACTS))
    threshold = FREQUENCY * CONTACT_TIME
    phases = random.uniform(-0.5, 0.5, TRAJECTORIES)
    speeds = random.uniform(0.05, 2.05, TRAJECTORIES)
    until = np.array(
        [
            follow(gamma, RESTITUTION, threshold, x, y, row)
            for x, y, row in zip(phases, speeds, logs, strict=True)
        ]
    )
    for impacts in (300, IMPACTS):
        means = logs[until >= impacts, SKIPPED:impacts].mean(axis=1)
        error = means.std() / math.sqrt(means.size)
        print(f"  no rest in {impacts} impacts ({means.size}): {means.mean():.4f}({error:.4f})")
    counted = until[until > SKIPPED] - SKIPPED
    grown = np.array([logs[i, SKIPPED:k].sum() for i, k in enumerate(until) if k > SKIPPED])
    mean = grown.sum() / counted.sum()
    error = math.sqrt(((grown - mean * counted) ** 2).sum()) / counted.sum()
    print(f"  all impacts before the first rest: {mean:.4f}({error:.4f})")


def main() -> None:
    random = np.random.default_rng(11)
    for gamma in ACCELERATIONS:
        print(f"Gamma = {gamma}")
        plain(gamma, random)
        found = vs.sweep(
            base="moving",
            frequency=FREQUENCY,
            restitution=RESTITUTION,
            base_acceleration=gamma,
            contact_time=CONTACT_TIME,
            launch_velocity=0.1,
            particles=1000,
            transient=1.0,
            duration=50.0,
            lyapunov=True,
            per_particle=True,
        )
        largest = found.lyapunov_largest.values.ravel()
        largest = largest[np.isfinite(largest)]
        error = largest.std() / math.sqrt(largest.size)
        print(f"  package ({largest.size}): {largest.mean():.4f}({error:.4f})", flush=True)


if __name__ == "__main__":
    main()
