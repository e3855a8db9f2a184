"""Loops with which kernels are compared: the plain way, and the least possible work."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from vibrosweep.kernels._jit import wide_vectors
from vibrosweep.kernels.arithmetic import sin_turns
from vibrosweep.kernels.bases import fly, rebound
from vibrosweep.kernels.bases.high_bounce import HighBounceConstants
from vibrosweep.kernels.impact import base_of, land
from vibrosweep.kernels.memory import aligned
from vibrosweep.kernels.noise import SILENT, STILL

BASE = base_of("high-bounce", "rest")
LANES = 256
STRIDE = LANES + 24
X, U, E, A = 0, STRIDE, 2 * STRIDE, 3 * STRIDE


@njit(nogil=True, error_model="numpy")
def scalar_trajectories(first, last, problem, launches, periods, landings, total, squares, largest):
    """One trajectory after the other, time as one running number, the library's sine."""
    particles = launches.phase.shape[1]
    for lane in range(first, last):
        i, p = lane // particles, lane % particles
        e, a, r = problem.restitution[i], problem.kick[i], problem.rest_flight[i]
        u = problem.launch_flight[i]
        t = launches.whole[0, p] + launches.phase[0, p]
        n, s, q, m = 0, 0.0, 0.0, 0.0
        while True:
            t += u
            if t > periods:
                break
            n += 1
            w = e * u + a * math.sin(2.0 * math.pi * t)
            if w > r:
                u = w
            else:
                if a <= r:
                    break
                wait = math.asin(r / a) / (2.0 * math.pi) - (t - math.floor(t))
                t += wait if wait >= 0.0 else wait + 1.0
                u = r
            s += u
            q += u * u
            m = max(m, u)
        landings[lane], total[lane], squares[lane], largest[lane] = n, s, q, m


@njit(nogil=True, error_model="numpy")
def sine_only(s, repetitions):
    """Nothing but the polynomial sine of every lane's phase."""
    wide_vectors()
    for _ in range(repetitions):
        for j in range(LANES):
            s[U + j] = sin_turns(s[X + j])


@njit(nogil=True, error_model="numpy")
def bare_map(s, repetitions):
    """The map without rests, windows and statistics."""
    wide_vectors()
    for _ in range(repetitions):
        for j in range(LANES):
            fixed = HighBounceConstants(BASE, s[E + j], s[A + j], *(0.0,) * 5, SILENT, STILL)
            flight, v = fly(fixed, s[X + j], s[U + j])
            x, _ = land(s[X + j], flight)
            s[U + j] = rebound(fixed, x, v)
            s[X + j] = x


def lanes():
    """Random lanes for `sine_only` and `bare_map`, aligned to a cache line.

    Each is near a stable orbit of one impact in every period, so that no flight dies away: slow
    subnormal numbers would be timed instead of the map.
    """
    rng = np.random.default_rng(1)
    s = aligned(4 * STRIDE)
    e = rng.uniform(0.5, 0.95, LANES)
    # a flight of one period repeats where a sin(2 pi x) = 1 - e; it is stable while
    # -2 pi a cos(2 pi x) lies between 0 and 2 (1 + e)
    slope = rng.uniform(0.2, 1.8, LANES) * (1.0 + e)
    a = np.hypot(1.0 - e, slope / (2.0 * np.pi))
    x = 0.5 - np.arcsin((1.0 - e) / a) / (2.0 * np.pi)
    near = rng.uniform(-1e-3, 1e-3, LANES)
    for start, values in ((X, x + near), (U, 1.0), (E, e), (A, a)):
        s[start : start + LANES] = values
    return s
