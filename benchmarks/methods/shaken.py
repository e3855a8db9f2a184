"""The map under two tones, or with noise of the kick, as a scalar loop of plain numba.

Rests are left out: the scenes have none.  Random numbers are read from the stored stream.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numba import njit

from methods.compiled import MARGIN, NAIVE
from methods.scenes import Point, Scene, table
from methods.timing import timed
from vibrosweep.proof.sampling import deviates_of

ROOM = 20  # landings past the last one that is compared
COPIES = 200


@njit(nogil=True, error_model="numpy")
def _trajectories(rows, tones, push, deviates, duration, times, speeds):
    """Compute the landings of each row up to the end; return their number, -1 after a rest."""
    landings = 0
    for i in range(rows.shape[0]):
        e, amplitude, frequency, phi = rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3]
        gravity, v, contact, t = rows[i, 4], rows[i, 5], rows[i, 6], rows[i, 7]
        omega, rest, j = 2.0 * math.pi * frequency, 0.5 * gravity * contact, i % deviates.shape[0]
        for n in range(deviates.shape[1]):
            t += 2.0 * v / gravity
            if t > duration:
                break
            times[j, n] = t
            landings += 1
            angle, shape = omega * t + phi, 0.0
            for k in range(tones.shape[0]):
                shape += tones[k, 1] * math.sin(tones[k, 0] * angle + tones[k, 2])
            v = abs(e * v + amplitude * shape + (1.0 + e) * push * deviates[j, n])
            if v <= rest:
                return -1
            speeds[i] += v
    return landings


def shaken(scene: Scene, sizes: list[int], threads: int) -> Iterator[Point]:
    """A running time, the library's sine, random numbers from memory; one thread."""
    sample, push = table(scene.cases), scene.parameters.get("kick_noise", 0.0)
    tones = np.array(scene.waveform.tones or ((1, 1.0, 0.0),), dtype=np.float64)
    shape = (scene.proved, max(sizes) + ROOM)
    of = [deviates_of(0, 0.0, particle).of_impact for particle in range(scene.proved)]
    deviates = np.array([[drawn(n)[1] for n in range(shape[1])] for drawn in of])
    times, rows = np.full(shape, np.nan), np.tile(sample, (COPIES, 1))
    speeds = np.zeros(len(rows))
    _trajectories(sample, tones, push, deviates, scene.duration + MARGIN, times, speeds)

    def run() -> int:
        return _trajectories(rows, tones, push, deviates, scene.duration, np.empty(shape), speeds)

    landings, seconds = timed(run)
    if landings < 0:
        raise NotImplementedError(f"scene {scene.key}: a rest, which this loop leaves out")
    yield Point(scene.key, NAIVE, "streaming", 1, len(rows), landings, seconds, list(times))
