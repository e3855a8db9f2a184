"""Particles under a forcing whose period fluctuates.

The lengths of the forcing periods vary independently, so that the phase of the forcing performs a
random walk, the same for all particles of a repeat.  Within a period the phase grows uniformly.
The phase of a moving base cannot wander, because its flights are computed for a steady oscillation.
Impacts are those of `vibrosweep.kernels.impact`; without imperfections the record equals that of
the engine in every bit.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from vibrosweep.errors import ParameterError
from vibrosweep.kernels._jit import Floats, jit, kernel
from vibrosweep.kernels.bases import constants, fly, lift_off, rebound, speed
from vibrosweep.kernels.impact import Batch, land, launch, launch_speed
from vibrosweep.kernels.record import (
    Record,
    Scale,
    empty_record,
    no_landings,
    write_landing,
    write_lift_off,
)

# Steps of a fixed-point iteration, each of which multiplies the error by the relative change of a
# period, far below 1
INVERSIONS: Final = 30
# Most landings of a particle in a recording: those of ten hours at 20 Hz
MOST_LANDINGS: Final = 2**20


def phase_walk(rng: np.random.Generator, jitter: float, periods: int) -> Floats:
    """Draw the deviations of the phase, in turns, at the beginning of each period.

    The first period begins at -1 mean periods, and the shape is (period + 1,).  `jitter` is the
    standard deviation of the length of a period, relative to its mean.
    """
    return np.concatenate([[0.0], np.cumsum(jitter * rng.standard_normal(periods))])


@jit
def _deviation(n: float, x: float, walk: Floats) -> float:
    """Deviation of the phase in turns at n + x mean periods."""
    floor = np.floor(x)
    j = min(max(int(n + floor) + 1, 0), walk.size - 2)
    return float(walk[j] + (x - floor) * (walk[j + 1] - walk[j]))


@jit
def _phase(n: float, x: float, walk: Floats) -> tuple[float, float]:
    """Whole turns and reduced phase of the forcing at n + x mean periods."""
    turned = x + _deviation(n, x, walk)
    carry = np.rint(turned)
    return n + carry, turned - carry


@jit
def _instant(n: float, x: float, walk: Floats) -> tuple[float, float]:
    """Instant at which the forcing has the phase n + x, as whole and remaining mean periods."""
    count, rest = n, x
    for _ in range(INVERSIONS):
        back = x - _deviation(count, rest, walk)
        carry = np.rint(back)
        count, rest = n + carry, back - carry
    return count, rest


@kernel
def _fill(batch: Batch, walk: Floats, frequency: float, unit: float, out: Record) -> bool:
    """Write the landings of each particle p of realization p; return whether all fit."""
    base, problem, launches = batch
    no_landings(out, 0, launches.whole.shape[1])
    for p in range(launches.whole.shape[1]):
        fixed = constants(base, problem, p)
        n, x = launch(launches, p, p, problem.phase[p])
        u = launch_speed(fixed, problem, p, x)
        scale = Scale(frequency, unit, 0.0, problem.phase[p])
        ended = False
        for k in range(out.rested.shape[1]):
            flight, v = fly(fixed, x, u)
            x, passed = land(x, flight)
            n += passed
            if not n - problem.end_count[p] <= problem.end_phase[p] - x:
                ended = True
                break
            turns, phase = _phase(n, x, walk)
            turns, phase, u, leaves = lift_off(fixed, turns, phase, rebound(fixed, phase, v))
            write_landing(out, p, k, scale, n, x, not leaves)
            if turns == np.inf:
                ended = True
                break
            if not leaves:
                n, x = _instant(turns, phase, walk)
            write_lift_off(out, p, k, scale, n, x, speed(fixed, x, u))
        if not ended:
            return False
    return True


def wandering_record(batch: Batch, walk: Floats, frequency: float, gravity: float) -> Record:
    """Record every landing of particles with parameters of their own, under a wandering forcing.

    The problem of the batch holds arrays of shape (particle,), its launches have the shape (1,
    particle), and arrays of the record the shape (particle, impact).  Beyond the ends of the
    `walk`, a `phase_walk`, the phase continues as in its first or last period.  Raises a
    ParameterError if a particle lands more than `MOST_LANDINGS` times.
    """
    capacity = 1024
    while capacity <= MOST_LANDINGS:
        out = empty_record(batch.launches.whole.shape[1], capacity)
        if _fill(batch, walk, frequency, gravity / (2.0 * frequency), out):
            used = int(np.isfinite(out.landing_time).sum(axis=1).max(initial=1))
            return Record._make(np.ascontiguousarray(values[:, :used]) for values in out)
        capacity *= 2
    raise ParameterError(
        f"at {frequency:g} Hz a particle lands more than {MOST_LANDINGS} times in the time that is "
        f"filmed: check frequency, restitution, amplitude and contact_time"
    )
