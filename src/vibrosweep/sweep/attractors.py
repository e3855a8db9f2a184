"""What trajectories settle on, which of them share an orbit or a slot, and Lyapunov exponents."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels.attractor import SAME_ORBIT, Orbits, empty_orbits, settle
from vibrosweep.scene import Dimensionless, Launches
from vibrosweep.status import Regime
from vibrosweep.variables import LYAPUNOV

if TYPE_CHECKING:
    from vibrosweep.sweep.observation import Observation
    from vibrosweep.sweep.workers import Workers

__all__ = [
    "NO_ORBIT",
    "find_orbits",
    "label_orbits",
    "lyapunov",
    "orbit_variables",
    "slot_count",
    "slots",
]

Codes = NDArray[np.int64]

NO_ORBIT: Final = -1
TRAJECTORIES_PER_TASK: Final = 1024
CERTAIN: Final = 3.0  # standard errors by which a chaotic orbit's exponent exceeds zero


def find_orbits(
    problem: Dimensionless, launch: Launches, observation: Observation, workers: Workers
) -> Orbits:
    """What every trajectory settles on, in the order of realizations and within them of particles.

    Parameters
    ----------
    problem, launch
        Realizations and launches; the number of particles is that of the launches, and exponents
        of orbits that do not recur are means over the window of the problem.
    observation
        Gives the rebound law and the impact budget.
    workers
        Threads to use.

    Returns
    -------
    Orbits
        Arrays of shape (realization * particle,), in dimensionless units.
    """
    orbits = empty_orbits(problem.kick.size * launch.whole.shape[1])

    def task(first: int, last: int) -> None:
        budget, reflect = observation.impact_budget, observation.reflect
        settle(first, last, problem, launch, budget, reflect, orbits)

    workers.each(task, orbits.impacts.size, TRAJECTORIES_PER_TASK)
    return orbits


def label_orbits(orbits: Orbits, realizations: int) -> Codes:
    """Number the distinct orbits of each realization in the order of the particles on them.

    Two cycles are one orbit if their numbers of impacts, periods and rests agree and their
    representatives differ by less than `SAME_ORBIT`.

    Returns
    -------
    numpy.ndarray
        Shape (realization, particle); `NO_ORBIT` where no recurrence was found.
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
    """Which of the time-shifted copies of its orbit each particle is on; same shape as `orbits`.

    The orbits of a cycle of q forcing periods are q copies of one, shifted by whole periods.  The
    slot is the period, modulo q, in which the representative of the cycle falls; `NO_ORBIT` where
    no recurrence was found.
    """
    found = orbits.impacts > 0
    slot = np.mod(orbits.whole, np.maximum(orbits.periods, 1))
    return np.where(found, slot, NO_ORBIT).astype(np.int64)


def slot_count(labels: Codes, slot: Codes) -> Codes:
    """Number of distinct slots, of all orbits, that the particles of each realization occupy."""
    pairs = np.sort(np.where(labels == NO_ORBIT, NO_ORBIT, labels * (slot.max() + 1) + slot))
    steps = np.diff(pairs, axis=1, prepend=NO_ORBIT) != 0
    return np.asarray(np.count_nonzero(steps, axis=1))


def lyapunov(
    problem: Dimensionless, launch: Launches, observation: Observation, workers: Workers
) -> dict[str, NDArray[Any]]:
    """Lyapunov exponents of each particle, and the orbits and slots that are occupied.

    Returns
    -------
    dict
        The variables of `vibrosweep.variables.LYAPUNOV`.
    """
    orbits = find_orbits(problem, launch, observation, workers)
    found = orbit_variables(orbits, problem.kick.size)
    return {name: found[name] for name in LYAPUNOV}


def orbit_variables(orbits: Orbits, realizations: int) -> dict[str, NDArray[Any]]:
    """What orbits say of each particle and of each realization.

    Returns
    -------
    dict
        The variables of `vibrosweep.variables.LYAPUNOV`, and of its REGIMES all that do not depend
        on when an orbit began; arrays of shape (realization, particle) and (realization,).
    """
    shape = (realizations, -1)
    labels, slot = label_orbits(orbits, realizations), slots(orbits).reshape(shape)
    largest, error = orbits.largest.reshape(shape), orbits.largest_error.reshape(shape)
    regime = orbits.regime.reshape(shape)
    irregular = regime == Regime.IRREGULAR
    counts = {f"{one.meaning}_count": np.count_nonzero(regime == one, axis=1) for one in Regime}
    return {
        "regime": regime,
        "cycle_impacts": orbits.impacts.reshape(shape),
        "cycle_periods": orbits.periods.reshape(shape),
        "cycle_rests": orbits.rests.reshape(shape),
        **counts,
        "lyapunov_largest": largest,
        "lyapunov_largest_error": error,
        "lyapunov_sum": orbits.total.reshape(shape),
        "lyapunov_sum_error": orbits.total_error.reshape(shape),
        "orbit": labels,
        "slot": slot,
        "lyapunov_max": largest.max(axis=1),
        "chaotic_count": np.count_nonzero(irregular & (largest > CERTAIN * error), axis=1),
        "orbit_count": labels.max(axis=1) + 1,
        "slot_count": slot_count(labels, slot),
    }
