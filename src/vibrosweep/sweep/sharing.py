"""Realizations, and trajectories, that are one and the same problem."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels.distinct import first_of_each
from vibrosweep.kernels.shared import Shared
from vibrosweep.scene import Dimensionless, Launches

__all__ = ["find_equal", "find_shared"]

Array = NDArray[np.float64]
Places = NDArray[np.int64]

AT_ONCE = Launches(np.zeros((1, 1)), np.zeros((1, 1)))  # the same for all


def find_equal(problem: Dimensionless, launch: Launches, *others: Array) -> Places | None:
    """Find realizations that are the same problem.

    Parameters
    ----------
    problem, launch
        The batch.
    others
        What else has to be equal, each of shape (realization,).

    Returns
    -------
    numpy.ndarray or None
        For each realization the first one that is the same; None where all differ.
    """
    return None if _all_differ(problem) else _firsts([*problem, *others], launch)


def find_shared(
    problem: Dimensionless, launch: Launches, window: int | None, patience: float
) -> Shared | None:
    """Find the trajectories of a batch that differ only in how long they are watched.

    These are equal, bit for bit, in e, a, r, u0, the phase of the launch, and the time from the
    launch to the beginning of the window: particles of one realization that are launched whole
    periods apart, and realizations that differ in gravity, frequency or phase at the same e, a, r
    and u0.

    Parameters
    ----------
    problem, launch
        The batch.
    window
        None where the window begins before all launches.
    patience
        Forcing periods; recurrence is looked for in trajectories that are watched for longer, and
        those are not shared with the others.

    Returns
    -------
    Shared or None
        None where all trajectories differ.
    """
    orbits = [
        problem.restitution,
        problem.kick,
        problem.rest_flight,
        problem.liftoff_phase,
        problem.launch_flight,
    ]
    if not _repeats(launch.phase) and (_all_differ(problem) or _firsts(orbits, AT_ONCE) is None):
        return None
    shape = (problem.kick.size, launch.whole.shape[1])

    def of_each(values: Array) -> Array:
        return np.broadcast_to(values, shape).ravel()

    start = launch.phase + problem.phase[:, np.newaxis]
    launched = launch.whole + np.rint(start)
    periods = of_each(problem.end_count[:, np.newaxis] - launched)
    decisive = [of_each(values[:, np.newaxis]) for values in orbits]
    decisive += [of_each(start - np.rint(start)), (periods > patience).astype(np.float64)]
    if window is not None:
        decisive.append(of_each(problem.begin_count[:, np.newaxis] - launched))
        decisive.append(of_each(problem.begin_phase[:, np.newaxis]))
    same_as = _firsts(decisive, AT_ONCE)
    if same_as is None:
        return None
    order = np.lexsort((of_each(problem.end_phase[:, np.newaxis]), periods, same_as))
    goes_on = same_as[order][1:] == same_as[order][:-1]
    after = np.full(order.size, -1)
    after[order[:-1][goes_on]] = order[1:][goes_on]
    return Shared(np.sort(order[np.append(True, ~goes_on)]), after, periods)


def _all_differ(problem: Dimensionless) -> bool:
    """Whether no two realizations can be the same problem, as is plain where they are drawn."""
    return not _repeats(problem.kick) or not _repeats(problem.restitution)


def _repeats(values: Array) -> bool:
    """Whether a value occurs twice in a row."""
    ordered = np.sort(values)
    return bool(np.any(ordered[..., 1:] == ordered[..., :-1]))


def _firsts(columns: Sequence[Array], launch: Launches) -> Places | None:
    """The first place that agrees in all columns and launches, for each; None where all differ."""
    first = np.empty(columns[0].size, np.int64)
    return first if first_of_each(np.stack(columns), launch, first) < first.size else None
