"""Closed orbits near which trajectories return.

A trajectory that settles on an attractor, or passes an unstable orbit, returns nearly to the same
phases after p landings and q periods.  Newton's method starts from those p landings.  So every
attractor is found to which one of the launches leads, however small the region of the landing times
from which Newton's method leads to it.

Launches cover phase and speed evenly, more densely at low speeds.  Their number grows with the
square of the number of falls of the waveform, on which the attractors are, and to twice the number
of the launch that led to the last new attractor, unless `PATIENCE` ends it.
"""

from __future__ import annotations

import math

import numpy as np

from vibrosweep.kernels._jit import Floats, jit, part
from vibrosweep.kernels.bases import Constants
from vibrosweep.kernels.closed import ADMISSIBLE, ascends, close, reduced
from vibrosweep.kernels.impact import impact
from vibrosweep.kernels.orbit_list import Closed, add
from vibrosweep.kernels.waveforms import falls_of

PATIENCE = 32  # number of launches, relative to the least of a sine, beyond which it does not grow
LANDINGS = 400  # of a trajectory, at most
RESTS = 4  # at which a trajectory ends
NEAR = 0.02  # periods; Newton's method starts after returns as near as this
CLOSER = 1.0 / 16.0  # distance of the next return from which it starts, relative to the last one
CAPTURED = 1e-4  # periods; a trajectory that returns so nearly to an attracting orbit stays there
GOLDEN = 1.324717957244746  # root of g^3 = g + 1, by which points of a plane are spread


@jit
def _return(
    landed: Floats, k: int, impacts: int, periods: int, near: float
) -> tuple[int, int, float]:
    """Numbers of impacts and periods after which two landings return so nearly, and the distance.

    `landed` are k landing times; without a return there are 0 impacts.
    """
    for p in range(1, min(impacts, k - 2) + 1):
        one, other = landed[k - 1] - landed[k - 1 - p], landed[k - 2] - landed[k - 2 - p]
        q = np.rint(one)
        off = max(abs(one - q), abs(other - q))
        if off <= near and 1 <= q <= periods:
            return p, int(q), off
    return 0, 0, math.inf


@part
def _follow(fixed: Constants, i: int, number: int, out: Closed) -> int:
    """Follow a trajectory, and find the orbits to which it nearly returns.

    Returns the number of new ones that attract, -1 where orbits exceed the capacity.
    """
    impacts, periods = out.seeds.shape[1], out.seeds.shape[2]
    landed, times = np.empty(LANDINGS), np.empty(impacts)
    off, matrix = np.empty(impacts), np.empty((impacts, impacts))
    x, u = reduced(number / GOLDEN), periods * ((number / (GOLDEN * GOLDEN)) % 1.0) ** 2
    n, k, rests, near, attracting = 0.0, 0, 0, NEAR, 0
    for _ in range(LANDINGS):
        hit = impact(fixed, n, x, u)
        n, x, u = hit.n_off, hit.x_off, hit.u
        if not hit.leaves:
            rests, k = rests + 1, 0
        if rests == RESTS or not abs(n) < math.inf:
            break
        if not hit.leaves:
            continue
        landed[k] = hit.n + hit.x
        k += 1
        p, q, distance = _return(landed, k, impacts, periods, near)
        if p == 0:
            continue
        near = CLOSER * distance
        times[:p] = landed[k - 1 - p : k - 1]
        if ascends(times, p, q) and close(fixed, times, p, q, off, matrix):
            orbits = out.orbits[i]
            at = add(fixed, i, times, p, q, 0, out)
            if at == out.impacts.shape[1]:
                return -1
            bound = 1.0 + out.determinant[i, at]
            attracts = out.admissible[i, at] == ADMISSIBLE and abs(out.trace[i, at]) < bound
            attracting += attracts and at == orbits
            if attracts and distance < CAPTURED:
                break
    return attracting


@part
def follow_launches(fixed: Constants, i: int, launches: int, out: Closed) -> bool:
    """Find the orbits near which trajectories return; False where they exceed the capacity.

    `launches` is their least number under a sine.
    """
    most = PATIENCE * launches
    number, until = 0, min(launches * falls_of(fixed.base.waveform) ** 2, most)
    while number < until:
        number += 1
        found = _follow(fixed, i, number, out)
        if found < 0:
            return False
        if found > 0:
            until = max(until, min(2 * number, most))
    return True
