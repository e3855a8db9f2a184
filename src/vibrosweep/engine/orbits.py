"""Orbits of trajectories, orbits that particles share, and Lyapunov exponents."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.engine.trajectories import base_in, settled, statistics
from vibrosweep.kernels.impact import Batch
from vibrosweep.kernels.settle import SAME_ORBIT, Orbits
from vibrosweep.model.parameters import Dimensionless, Launches
from vibrosweep.model.status import Regime

if TYPE_CHECKING:
    from vibrosweep.engine.workers import Workers
    from vibrosweep.scene.scene import Scene

Codes = NDArray[np.int64]

NO_ORBIT: Final = -1


def find_orbits(problem: Dimensionless, launch: Launches, scene: Scene, workers: Workers) -> Orbits:
    """Return the orbit on which each trajectory settles, ordered by realization, then by particle.

    Arrays have shape (realization * particle,), in dimensionless units.  The exponent of an orbit
    that is not a cycle is a mean over the window of the problem.  The scene must agree with the
    launches in the number of particles, and with the problem in whether a launch precedes the
    window.
    """
    scene = replace(scene.with_measures(lyapunov=True), skip=True)
    cycles = workers.cycles(problem.kick.size * scene.particles)
    found = statistics(problem, launch, scene, workers, cycles)
    batch = Batch(base_in(scene, problem), problem, launch)
    return settled(batch, found, cycles, scene, workers)


def label_orbits(orbits: Orbits, realizations: int) -> Codes:
    """Number the distinct orbits of each realization, in the order of their first particles.

    Two cycles are the same orbit if their numbers of impacts, periods and rests agree and their
    representative states differ by less than `SAME_ORBIT`.  Shape (realization, particle);
    `NO_ORBIT` where no recurrence was found.
    """
    shape = (realizations, -1)
    codes = [v.reshape(shape) for v in (orbits.impacts, orbits.periods, orbits.rests)]
    phase, flight = orbits.phase.reshape(shape), orbits.flight.reshape(shape)
    labels = np.full(phase.shape, NO_ORBIT)
    pending = codes[0] > 0
    rows = np.arange(realizations)
    for number in range(phase.shape[1]):
        if not pending.any():
            break
        chosen = pending.argmax(axis=1)
        same = pending & (np.abs(flight - flight[rows, chosen][:, np.newaxis]) <= SAME_ORBIT)
        apart = phase - phase[rows, chosen][:, np.newaxis]
        same &= np.abs(apart - np.rint(apart)) <= SAME_ORBIT
        for code in codes:
            same &= code == code[rows, chosen][:, np.newaxis]
        labels[same] = number
        pending &= ~same
    return labels


def slots(orbits: Orbits) -> Codes:
    """Return the slot of each particle, one of the copies of its orbit; same shape as `orbits`.

    A cycle of q forcing periods exists in q copies, shifted by whole periods.  The slot is the
    period, modulo q, that contains the representative state of the cycle; `NO_ORBIT` where no
    recurrence was found.
    """
    found = orbits.impacts > 0
    slot = np.mod(orbits.whole, np.maximum(orbits.periods, 1))
    return np.where(found, slot, NO_ORBIT).astype(np.int64)


def slot_count(labels: Codes, slot: Codes) -> Codes:
    """Return how many distinct slots of all orbits the particles of each realization occupy."""
    pairs = np.sort(np.where(labels == NO_ORBIT, NO_ORBIT, labels * (slot.max() + 1) + slot))
    steps = np.diff(pairs, axis=1, prepend=NO_ORBIT) != 0
    return np.asarray(np.count_nonzero(steps, axis=1))


def orbit_variables(orbits: Orbits, frequency: NDArray[np.float64]) -> dict[str, NDArray[Any]]:
    """Return the variables of regimes and exponents, per particle and per realization.

    They are named as in `vibrosweep.model.measures`; the orbits are ordered by realization.
    """
    shape = (frequency.size, -1)
    labels, slot = label_orbits(orbits, frequency.size), slots(orbits).reshape(shape)
    largest, regime = orbits.largest.reshape(shape), orbits.regime.reshape(shape)
    uncertain = orbits.uncertain.reshape(shape)
    counts = {f"{r.meaning}_count": np.count_nonzero(regime == r, axis=1) for r in Regime}
    return {
        "regime": regime,
        "cycle_impacts": orbits.impacts.reshape(shape),
        "cycle_periods": orbits.periods.reshape(shape),
        "cycle_rests": orbits.rests.reshape(shape),
        "cycle_uncertain": uncertain,
        "recurrent_from": orbits.since.reshape(shape) / frequency[:, np.newaxis],
        **counts,
        "uncertain_cycle_count": np.count_nonzero(uncertain == 1, axis=1),
        "lyapunov_largest": largest,
        "lyapunov_largest_error": orbits.largest_error.reshape(shape),
        "lyapunov_sum": orbits.total.reshape(shape),
        "lyapunov_sum_error": orbits.total_error.reshape(shape),
        "orbit": labels,
        "slot": slot,
        "lyapunov_max": np.fmax.reduce(largest, axis=1),
        "orbit_count": labels.max(axis=1) + 1,
        "slot_count": slot_count(labels, slot),
    }
