"""What each orbit has become: its regime and its cycle, from the cycles that were found."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Flags, Floats, Integers, jit, kernel
from vibrosweep.kernels.cycles import (
    CYCLE_FLIGHT,
    CYCLE_IMPACTS,
    CYCLE_PERIODS,
    CYCLE_PHASE,
    CYCLE_RESTS,
    CYCLE_WHOLE,
    Cycles,
)
from vibrosweep.kernels.impact import Scene, impact, scene
from vibrosweep.scene import Dimensionless
from vibrosweep.status import Regime

__all__ = ["SAME", "Regimes", "classify", "empty_regimes", "repeats"]

# Periods.  Near the loss of stability a cycle wanders by rounding over 1 - |multiplier|; distinct
# points of one cycle are never this close, unless it has just split.
SAME = 2.0**-30

AT_REST, RESTING = int(Regime.AT_REST), int(Regime.RESTING)
LOCKED, IRREGULAR = int(Regime.LOCKED), int(Regime.IRREGULAR)


class Regimes(NamedTuple):
    """Regimes of orbits.

    Attributes
    ----------
    regime
        `vibrosweep.status.Regime`, shape (realization, particle).
    impacts, periods, rests
        Of the cycle, 0 where there is none; shape (realization, particle).
    since
        Instant in s from which on the orbit is known to repeat, NaN where it is not; shape
        (realization, particle).
    counts
        How many particles are in each regime, shape (regime, realization).
    """

    regime: Flags
    impacts: Integers
    periods: Integers
    rests: Integers
    since: Floats
    counts: Integers


def empty_regimes(realizations: int, particles: int) -> Regimes:
    """Room for the regimes of a batch."""
    shape = (realizations, particles)
    impacts, periods, rests = (np.empty(shape, np.int64) for _ in range(3))
    counts = np.empty((len(Regime), realizations), np.int64)
    return Regimes(np.empty(shape, np.int8), impacts, periods, rests, np.empty(shape), counts)


@jit
def repeats(
    fixed: Scene, x: float, u: float, reflect: int | None, impacts: int, shorter: int
) -> int:
    """Periods of the shorter cycle that a cycle is up to rounding; 0 if it is none."""
    n = ahead_n = 0.0
    ahead_x, ahead_u = x, u
    for _ in range(shorter):
        _, _, ahead_n, ahead_x, ahead_u, _ = impact(fixed, ahead_n, ahead_x, ahead_u, reflect)
    periods = np.rint(ahead_n + (ahead_x - x))
    for _ in range(impacts):
        apart = (ahead_n - n - periods) + (ahead_x - x)
        if abs(apart) > SAME or abs(ahead_u - u) > SAME:
            return 0
        _, _, n, x, u, _ = impact(fixed, n, x, u, reflect)
        _, _, ahead_n, ahead_x, ahead_u, _ = impact(fixed, ahead_n, ahead_x, ahead_u, reflect)
    return int(periods)


@jit
def _shortest(
    fixed: Scene, x: float, u: float, reflect: int | None, impacts: int, periods: int
) -> tuple[int, int]:
    """Impacts and periods of a cycle with states closer than `SAME` taken as one.

    Rounding lets an orbit alternate between neighbouring numbers; the cycle of its bits is then a
    multiple of the orbit's.
    """
    for shorter in range(1, impacts // 2 + 1):
        if impacts % shorter == 0:
            found = repeats(fixed, x, u, reflect, impacts, shorter)
            if found > 0:
                return shorter, found
    return impacts, periods


@kernel
def classify(
    first: int,
    last: int,
    problem: Dimensionless,
    frequency: Floats,
    reflect: int | None,
    at_rest: Flags | Integers,
    cycles: Cycles,
    out: Regimes,
) -> None:
    """Find the regimes of the particles of realizations first ... last - 1.

    Parameters
    ----------
    first, last
        Range of realizations.
    problem : vibrosweep.scene.Dimensionless
    frequency
        Hz, shape (realization,).
    reflect
        None, or 1 for the `reflect` law; chosen at compile time.
    at_rest
        Shape (trajectory,): 1 where the particle came to rest for good.
    cycles
        From `vibrosweep.kernels.cycles.empty_cycles`, as they were found.
    out : Regimes
        Only the slots of these realizations are written.
    """
    particles = out.regime.shape[1]
    for i in range(first, last):
        fixed = scene(problem, i)
        launch = problem.end_count[i] - problem.phase[i]
        for regime in range(out.counts.shape[0]):
            out.counts[regime, i] = 0
        for p in range(particles):
            t = i * particles + p
            impacts, periods, rests, since = 0, 0, 0, np.nan
            regime = AT_REST if at_rest[t] > 0 else IRREGULAR
            if cycles[CYCLE_IMPACTS, t] > 0.0:
                x, u = cycles[CYCLE_PHASE, t], cycles[CYCLE_FLIGHT, t]
                impacts, periods = int(cycles[CYCLE_IMPACTS, t]), int(cycles[CYCLE_PERIODS, t])
                rests = int(cycles[CYCLE_RESTS, t])
                since = (cycles[CYCLE_WHOLE, t] + x + launch) / frequency[i]
                if rests == 0:  # a rest sets the state exactly
                    impacts, periods = _shortest(fixed, x, u, reflect, impacts, periods)
                if at_rest[t] == 0:
                    regime = RESTING if rests > 0 else LOCKED
            out.regime[i, p] = regime
            out.impacts[i, p], out.periods[i, p], out.rests[i, p] = impacts, periods, rests
            out.since[i, p] = since
            out.counts[regime, i] += 1
