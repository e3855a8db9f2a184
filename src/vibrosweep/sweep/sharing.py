"""Realizations, and trajectories, that are one and the same problem."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels.distinct import first_of_each
from vibrosweep.kernels.shared import Shared
from vibrosweep.scene import Dimensionless, Launches

__all__ = ["Chains", "find_chains", "find_equal", "find_shared"]

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


class Chains(NamedTuple):
    """Realizations that differ only in how long they are watched.

    Attributes
    ----------
    first
        Shape (scene,): of those that are the same scene, the one watched for the shortest time.
    after
        Shape (realization,): the one watched for the next longer time, or -1.
    """

    first: Places
    after: Places


def find_chains(
    problem: Dimensionless, launch: Launches, window: int | None, patience: float
) -> Chains | None:
    """Find realizations that differ only in how long they are watched.

    These are equal, bit for bit, in e, a, r, u0, the phases of all launches, the whole periods
    between these, and the time from the first launch to the beginning of the window: realizations
    that differ in gravity, frequency or phase at the same e, a, r and u0.

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
    Chains or None
        None where all realizations differ.
    """
    if _all_differ(problem):
        return None
    launched, phase = _launched(problem, launch)
    periods = problem.end_count[:, np.newaxis] - launched
    recurs = periods > patience
    all_or_none = recurs.all(axis=1) | ~recurs.any(axis=1)
    decisive = [
        *_orbits(problem),
        phase[:, 0],
        np.where(all_or_none, recurs[:, 0], 2.0 + np.arange(recurs.shape[0])),
    ]
    if window is not None:
        decisive += [problem.begin_count - launched[:, 0], problem.begin_phase]
    same_as = _firsts(decisive, Launches(launched - launched[:, :1], phase))
    if same_as is None:
        return None
    return Chains(*_in_order(same_as, periods[:, 0], problem.end_phase))


def find_shared(
    problem: Dimensionless, launch: Launches, window: int | None, patience: float
) -> Shared | None:
    """Find the trajectories of a batch that differ only in how long they are watched.

    These are particles of realizations that are the same scene, see `find_chains`; where there are
    none, particles of one realization that are launched whole periods apart, and those of others
    at the same e, a, r, u0 and phase of the launch.

    Parameters
    ----------
    problem, launch, window, patience
        As for `find_chains`.

    Returns
    -------
    Shared or None
        None where all trajectories differ.
    """
    repeated = _repeats(launch.phase)
    all_differ = _all_differ(problem) or _firsts(_orbits(problem), AT_ONCE) is None
    if all_differ and not repeated:
        return None
    launched, _ = _launched(problem, launch)
    periods = problem.end_count[:, np.newaxis] - launched
    alike = all_differ and launch.phase.shape[0] == 1 and np.ptp(problem.phase) == 0.0
    if alike and periods.min() > patience:  # what one realization shares, all do
        one = Dimensionless._make(values[:1] for values in problem)
        shared = _find_shared_particles(one, launch, window, patience)
        return None if shared is None else _in_all(shared.first, shared.after, periods)
    chains = None if repeated else find_chains(problem, launch, window, patience)
    if chains is None:
        return _find_shared_particles(problem, launch, window, patience)
    particle = np.arange(periods.shape[1])
    first, after = (i[:, np.newaxis] * particle.size + particle for i in chains)
    after[chains.after < 0] = -1
    return Shared(first.ravel(), after.ravel(), periods.ravel())


def _in_all(first: Places, after: Places, periods: Array) -> Shared:
    """The same particles of every realization as one trajectory; periods of all of them."""
    begin = np.arange(periods.shape[0])[:, np.newaxis] * periods.shape[1]
    return Shared(
        (begin + first).ravel(),
        np.where(after < 0, -1, begin + after).ravel(),
        periods.ravel(),
    )


def _find_shared_particles(
    problem: Dimensionless, launch: Launches, window: int | None, patience: float
) -> Shared | None:
    """Do as `find_shared` where single particles may be one trajectory."""
    launched, phase = _launched(problem, launch)

    def of_each(values: Array) -> Array:
        return np.broadcast_to(values[:, np.newaxis], launched.shape).ravel()

    periods = (problem.end_count[:, np.newaxis] - launched).ravel()
    decisive = [of_each(values) for values in _orbits(problem)]
    decisive += [phase.ravel(), (periods > patience).astype(np.float64)]
    if window is not None:
        decisive.append((problem.begin_count[:, np.newaxis] - launched).ravel())
        decisive.append(of_each(problem.begin_phase))
    same_as = _firsts(decisive, AT_ONCE)
    if same_as is None:
        return None
    return Shared(*_in_order(same_as, periods, of_each(problem.end_phase)), periods)


def _orbits(problem: Dimensionless) -> list[Array]:
    """What decides an orbit, apart from its launch."""
    return [
        problem.restitution,
        problem.kick,
        problem.rest_flight,
        problem.liftoff_phase,
        problem.launch_flight,
    ]


def _launched(problem: Dimensionless, launch: Launches) -> tuple[Array, Array]:
    """Whole periods and phase of all launches, shape (realization, particle)."""
    start = launch.phase + problem.phase[:, np.newaxis]
    carry = np.rint(start)
    return launch.whole + carry, start - carry


def _in_order(same_as: Places, whole: Array, phase: Array) -> tuple[Places, Places]:
    """First of those that are the same, and next one of each, by the length of their watch."""
    order = np.lexsort((phase, whole, same_as))
    goes_on = same_as[order][1:] == same_as[order][:-1]
    after = np.full(order.size, -1)
    after[order[:-1][goes_on]] = order[1:][goes_on]
    return np.sort(order[np.append(True, ~goes_on)]), after


def _all_differ(problem: Dimensionless) -> bool:
    """Whether no two realizations can be the same problem, as is plain where they are drawn."""
    return _firsts([problem.kick], AT_ONCE) is None


def _repeats(values: Array) -> bool:
    """Whether a value occurs twice in a row."""
    ordered = np.sort(values)
    return bool(np.any(ordered[..., 1:] == ordered[..., :-1]))


def _firsts(columns: Sequence[Array], launch: Launches) -> Places | None:
    """The first place that agrees in all columns and launches, for each; None where all differ."""
    first = np.empty(columns[0].size, np.int64)
    return first if first_of_each(np.stack(columns), launch, first) < first.size else None
