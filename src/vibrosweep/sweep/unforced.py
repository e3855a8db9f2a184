"""Trajectories without excitation: every number from a closed form, nothing iterated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels.advance import Statistics
from vibrosweep.scene import Dimensionless, Launches
from vibrosweep.status import Status

__all__ = ["is_unforced", "unforced"]

Array = NDArray[np.float64]


def is_unforced(problem: Dimensionless, budget: int) -> NDArray[np.bool_]:
    """Whether a realization has the closed form: no kick, some loss, and rest within the budget."""
    lossy = (problem.kick == 0.0) & (problem.restitution < 1.0)
    if lossy.any():
        e, u, r = problem.restitution, problem.launch_flight, problem.rest_flight
        lossy[lossy] = _landings_until_rest(e[lossy], u[lossy], r[lossy]) <= budget
    return np.asarray(lossy)


def unforced(problem: Dimensionless, launch: Launches) -> Statistics:
    """Statistics of every trajectory of realizations without excitation.

    After n landings the flight time is e**n u0, and (1 - e**n) / (1 - e) u0 has passed since the
    launch; at the first n with e**n u0 <= r the particle is at rest for good.

    Parameters
    ----------
    problem
        Realizations for which `is_unforced`.
    launch
        Launches of their particles.

    Returns
    -------
    Statistics
        Arrays of shape (trajectory,).
    """
    e, u, r = (
        values[:, np.newaxis]
        for values in (problem.restitution, problem.launch_flight, problem.rest_flight)
    )
    last = _landings_until_rest(e, u, r)
    end = _since_launch(problem, launch, problem.end_count, problem.end_phase)
    begin = _since_launch(problem, launch, problem.begin_count, problem.begin_phase)
    inside = _landings_by(end, e, u, last)
    before = _landings_before(begin, e, u, last)
    at_rest = inside == last
    landings = np.maximum(inside - before, 0.0)
    rests = at_rest & (landings > 0.0)
    flights = landings - rests  # none follows the last landing
    with np.errstate(over="ignore", invalid="ignore"):
        first = np.where(flights > 0.0, e ** (before + 1.0) * u, 0.0)
        total = first * _series(e, flights)
        squares = first * first * _series(e * e, flights)
    status = np.where(np.isfinite(squares), Status.COMPLETED, Status.NON_FINITE)
    return Statistics(
        landings.astype(np.int64).ravel(),
        rests.astype(np.int64).ravel(),
        at_rest.astype(np.int64).ravel(),
        total.ravel(),
        squares.ravel(),
        first.ravel(),
        status.astype(np.int8).ravel(),
    )


def _since_launch(problem: Dimensionless, launch: Launches, count: Array, phase: Array) -> Array:
    """Periods from each launch to an instant."""
    start = launch.phase + problem.phase[:, np.newaxis]
    return np.asarray((count[:, np.newaxis] - launch.whole) + (phase[:, np.newaxis] - start))


def _series(e: Array, terms: Array) -> Array:
    """Sum of e**k for k = 0 ... terms - 1, for 0 <= e < 1."""
    with np.errstate(divide="ignore", invalid="ignore"):
        powers = np.where(terms > 0.0, terms * np.log(e), 0.0)
    return np.asarray(-np.expm1(powers) / (1.0 - e))


def _landings_until_rest(e: Array, u: Array, r: Array) -> Array:
    """Number of the landing after which the particle is at rest for good."""
    with np.errstate(divide="ignore", invalid="ignore"):
        guess = np.ceil(np.log(r / u) / np.log(e))
    guess = np.where(np.isfinite(guess), np.maximum(guess, 1.0), 1.0)
    # the quotient of logarithms may be rounded past a whole number
    fewer = np.maximum(guess - 1.0, 1.0)
    guess = np.where(e**fewer * u <= r, fewer, guess)
    return np.asarray(np.where(e**guess * u <= r, guess, guess + 1.0))


def _landings_by(time: Array, e: Array, u: Array, last: Array) -> Array:
    """Number of landings up to an instant, that included."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        fraction = time * (1.0 - e) / u
        guess = np.floor(np.log1p(-fraction) / np.log(e))
    guess = np.where(fraction < 1.0, np.nan_to_num(guess, nan=0.0, posinf=0.0, neginf=0.0), last)
    guess = np.clip(guess, 0.0, last)
    more = np.minimum(guess + 1.0, last)
    guess = np.where(u * _series(e, more) <= time, more, guess)
    late = (guess > 0.0) & (u * _series(e, guess) > time)
    return np.asarray(np.where(late, guess - 1.0, guess))


def _landings_before(time: Array, e: Array, u: Array, last: Array) -> Array:
    """Number of landings before an instant."""
    found = _landings_by(time, e, u, last)
    at_once = (found > 0.0) & (u * _series(e, found) == time)
    return np.asarray(np.where(at_once, found - 1.0, found))
