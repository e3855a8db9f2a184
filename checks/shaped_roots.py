"""The landings of a moving base of harmonics against a method that cannot miss one.

    python checks/shaped_roots.py [--flights 1000000] [--seed 1] [--waveforms 20]

The clearance over the base is covered from the launch on with intervals on which its Taylor
polynomial of second degree, with a bound of the third derivative, either shows that there is no
root, or that there is one and the clearance falls throughout.  An interval that is halved down to
1e-7 of its time without an answer holds a minimum within rounding of zero, an undecided graze, at
which the particle may land or fly on.  The method shares only the equation with the kernel.

Waveforms: two to sixteen harmonics, weights normal, phases uniform.  Flights: the greatest downward
acceleration 0.01-50 g and launch speeds relative to the base 1e-9-20 periods, both log-uniform,
phases uniform.  Exit code 1 where a landing is missed, or differs by more than roundings can make.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from typing import NamedTuple

import numpy as np
from numba import njit

from accuracy import bare_problem
from vibrosweep.kernels.bases import constants, fly
from vibrosweep.kernels.bases.moving_errors import along
from vibrosweep.kernels.impact import base_of
from vibrosweep.model.shapes import Waveform

TWO_PI = 2.0 * math.pi
EPS = 2.0**-53
NARROWEST = 1e-7  # intervals, relative to the time
ROUNDINGS = 16.0  # of a clearance, in units of EPS times the moduli of its terms


class Judged(NamedTuple):
    """Landings compared, each array of shape (flight,)."""

    missed: np.ndarray
    # error, speed_error: in units of the effect that rounding errors of both clearances can have,
    # of `ROUNDINGS` in the one here and of the bound that results claim for theirs
    error: np.ndarray
    speed_error: np.ndarray
    grazes: np.ndarray  # whether an undecided graze came first


@njit(error_model="numpy", nogil=True)
def _turned(h, x, psi):
    angle = h * x
    return TWO_PI * (angle - np.rint(angle)) + psi


@njit(error_model="numpy", nogil=True)
def _lag(q):
    """Return q - sin(q), by its series where the difference would cancel."""
    if q > 1.0:
        return q - math.sin(q)
    term, total = q * q * q / 6.0, 0.0
    for k in range(4, 28, 2):
        total += term
        term *= -q * q / (k * (k + 1.0))
    return total


@njit(error_model="numpy", nogil=True)
def clearance(tones, alpha, x, y, s):
    """Clearance after s periods, two derivatives, error bounds of it and the first derivative."""
    value, size = 0.5 * s * (y - s), 0.5 * s * (abs(y) + s)
    blur = ROUNDINGS * (0.5 * abs(y) + s)
    slope, bend = 0.5 * y - s, -1.0
    for k in range(tones.shape[0]):
        h, c, psi = tones[k]
        theta, q = _turned(h, x, psi), TWO_PI * h * s
        part = TWO_PI * (h * s - np.rint(h * s))
        sine, cosine = math.sin(theta), math.cos(theta)
        versine = 2.0 * math.sin(0.5 * part) ** 2
        scale = 0.5 * alpha * c / (TWO_PI * h)
        value -= scale * (cosine * versine - sine * _lag(q))
        size += abs(scale) * (abs(cosine) * versine + abs(sine) * _lag(q))
        moved = cosine * math.sin(part) - sine * versine
        slope -= 0.5 * alpha * c * moved
        blur += 0.5 * alpha * abs(c) * (ROUNDINGS + 2.0 * q)  # the angle q is rounded, too
        bend -= 0.5 * alpha * c * TWO_PI * h * (cosine * (1.0 - versine) - sine * math.sin(part))
    return value, slope, bend, ROUNDINGS * EPS * size, EPS * blur


@njit(error_model="numpy", nogil=True)
def first_root(tones, alpha, x, y):
    """Return the first certain root, and the time of the first undecided graze, or infinity."""
    steep = jerk = 0.0
    for k in range(tones.shape[0]):
        steep += 0.5 * alpha * TWO_PI * tones[k, 0] * abs(tones[k, 1])
        jerk += 0.5 * alpha * (TWO_PI * tones[k, 0]) ** 2 * abs(tones[k, 1])
    s = 0.5 * y / (1.0 + steep)
    half, graze = 0.25 * s, np.inf
    for _ in range(10_000_000):
        middle = s + half
        value, slope, bend, error, _ = clearance(tones, alpha, x, y, middle)
        rest = jerk * half**3 / 6.0 + error
        least = value - abs(slope) * half + 0.5 * bend * half * half
        if bend > 0.0 and abs(slope) < bend * half:
            least = value - 0.5 * slope * slope / bend
        if least > rest:
            s += 2.0 * half
            half *= 1.5
            continue
        right, _, _, right_error, _ = clearance(tones, alpha, x, y, s + 2.0 * half)
        if slope + abs(bend) * half + 0.5 * jerk * half * half < 0.0 and right < -right_error:
            low, high = s, s + 2.0 * half
            for _ in range(100):
                middle = 0.5 * (low + high)
                low, high = (
                    (middle, high)
                    if clearance(tones, alpha, x, y, middle)[0] > 0.0
                    else (low, middle)
                )
            return 0.5 * (low + high), graze
        if half < NARROWEST * s:
            graze = min(graze, s)
            s += 2.0 * half
            continue
        half *= 0.5
    return np.nan, graze


@njit(error_model="numpy", nogil=True)
def _judge(base, problem, tones, x, y, missed, error, speed_error, grazes):
    for i in range(x.size):
        fixed = constants(base, problem, i)
        found, v = fly(fixed, x[i], y[i])
        root, graze = first_root(tones, fixed.alpha, x[i], y[i])
        grazes[i] = graze < root
        _, slope, bend, noise, blur = clearance(tones, fixed.alpha, x[i], y[i], root)
        at = along(fixed, x[i], y[i], root)
        off = (noise + at.f_error) / abs(slope) + EPS * root
        error[i] = abs(found - root) / off
        speed_error[i] = abs(v + 2.0 * slope) / (2.0 * (abs(bend) * off + blur) + at.z_error)
        near = abs(found - root) <= 1e-6 * root
        at_graze = grazes[i] and found >= graze * (1.0 - 1e-5) and found <= root * (1.0 + 1e-6)
        missed[i] = not (near or at_graze)
        if grazes[i]:
            error[i] = speed_error[i] = 0.0


def judge(waveform: Waveform, flights: int, random: np.random.Generator) -> Judged:
    """Draw flights over a base, and judge their landings."""
    gamma = np.exp(random.uniform(np.log(0.01), np.log(50.0), flights))
    y = np.exp(random.uniform(np.log(1e-9), np.log(20.0), flights))
    x = random.uniform(-0.5, 0.5, flights)
    problem = bare_problem(np.zeros(flights), 2.0 * gamma / waveform.fall)
    missed, grazes = np.zeros(flights, bool), np.zeros(flights, bool)
    error, speed_error = np.empty(flights), np.empty(flights)
    base = base_of("moving", "rest", waveform)
    _judge(base, problem, np.array(waveform.tones), x, y, missed, error, speed_error, grazes)
    return Judged(missed, error, speed_error, grazes)


def drawn(harmonics: int, random: np.random.Generator) -> Waveform:
    """Draw a waveform with all harmonics up to a number."""
    numbers = range(1, harmonics + 1)
    return Waveform(
        "harmonics",
        tuple(
            (h, float(random.normal()), float(random.uniform(-math.pi, math.pi))) for h in numbers
        ),
    )


def main() -> int:
    """Judge flights over random bases and print what was found; return 1 if a landing is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=1_000_000)
    parser.add_argument("--waveforms", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    random = np.random.default_rng(given.seed)
    missed = grazes = 0
    largest, begin = 0.0, time.perf_counter()
    for k in range(given.waveforms):
        waveform = drawn(2 + k * 14 // max(given.waveforms - 1, 1), random)
        found = judge(waveform, given.flights // given.waveforms, random)
        missed += int(found.missed.sum())
        grazes += int(found.grazes.sum())
        largest = max(largest, float(found.error.max()), float(found.speed_error.max()))
    print(
        f"{given.flights} flights over {given.waveforms} bases: {missed} missed, {grazes} behind "
        f"an undecided graze, largest error {largest:.3g}, {time.perf_counter() - begin:.0f} s"
    )
    return 1 if missed or largest > 1.0 else 0


if __name__ == "__main__":
    sys.exit(main())
