"""Trajectories without excitation: every number from a closed form, nothing iterated.

After n landings the flight time is e^n u0, and (1 - e^n) / (1 - e) u0 has passed since the launch;
at the first n with e^n u0 <= r the particle is at rest for good.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels._jit import jit, kernel
from vibrosweep.kernels.impact import launch
from vibrosweep.kernels.statistics import Statistics
from vibrosweep.scene import Dimensionless, Launches
from vibrosweep.status import Status

__all__ = ["has_closed_form", "landings_seen", "unforced", "whole_series"]

COMPLETED = int(Status.COMPLETED)
NON_FINITE = int(Status.NON_FINITE)


@jit
def _series(e: float, terms: float) -> float:
    """Sum of e^k for k = 0 ... terms - 1, for 0 <= e < 1."""
    if terms <= 0.0:
        return 0.0
    if e == 0.0:
        return 1.0
    return -math.expm1(terms * math.log(e)) / (1.0 - e)


@jit
def _until_rest(e: float, u: float, r: float) -> float:
    """Number of the landing after which the particle is at rest for good."""
    if e * u <= r:
        return 1.0
    number: float = np.ceil(math.log(r / u) / math.log(e))
    # the quotient of logarithms may be rounded past a whole number
    if number > 1.0 and e ** (number - 1.0) * u <= r:
        return number - 1.0
    return number if e**number * u <= r else number + 1.0


@jit
def _landings_by(time: float, e: float, u: float, last: float, total: float) -> float:
    """Number of landings up to an instant, that included; `total` is the time of the last one."""
    if time >= total:
        return last
    if time < u:
        return 0.0
    number: float = 1.0
    if e > 0.0:
        number = np.floor(math.log1p(-time * (1.0 - e) / u) / math.log(e))
    number = min(max(number, 1.0), last)
    if number < last and u * _series(e, number + 1.0) <= time:
        return number + 1.0
    return number - 1.0 if u * _series(e, number) > time else number


@jit
def whole_series(problem: Dimensionless, i: int) -> tuple[float, float]:
    """Number of landings of realization i until the rest, and their time from the launch on."""
    e, u = problem.restitution[i], problem.launch_flight[i]
    final = _until_rest(e, u, problem.rest_flight[i])
    return final, u * _series(e, final)


@jit
def landings_seen(
    problem: Dimensionless, i: int, start: tuple[float, float], final: float, total: float
) -> tuple[float, float]:
    """Number of landings before the window and up to its end of a particle launched at `start`."""
    e, u = problem.restitution[i], problem.launch_flight[i]
    n, x = start
    until = (problem.end_count[i] - n) + (problem.end_phase[i] - x)
    since = (problem.begin_count[i] - n) + (problem.begin_phase[i] - x)
    by = _landings_by(until, e, u, final, total)
    before = _landings_by(since, e, u, final, total)
    if before > 0.0 and u * _series(e, before) == since:  # at the beginning is inside
        before -= 1.0
    return before, by


@kernel
def has_closed_form(problem: Dimensionless, budget: int, out: NDArray[np.bool_]) -> int:
    """Find the realizations without a kick, with some loss, that come to rest within the budget.

    Returns their number; writes `out`, of shape (realization,).
    """
    found = 0
    for i in range(problem.kick.size):
        out[i] = False
        e = problem.restitution[i]
        if problem.kick[i] == 0.0 and e < 1.0:
            out[i] = _until_rest(e, problem.launch_flight[i], problem.rest_flight[i]) <= budget
            found += 1 if out[i] else 0
    return found


@kernel
def unforced(
    first: int, last: int, problem: Dimensionless, launches: Launches, out: Statistics
) -> None:
    """Statistics of all trajectories of realizations first ... last - 1, without excitation.

    Parameters
    ----------
    first, last
        Range of realizations, for which `has_closed_form`.
    problem : vibrosweep.scene.Dimensionless
    launches : vibrosweep.scene.Launches
    out : Statistics
        Written: the slots of these realizations' trajectories.
    """
    particles = launches.whole.shape[1]
    for i in range(first, last):
        e, u = problem.restitution[i], problem.launch_flight[i]
        final, total = whole_series(problem, i)
        # of a particle that is seen from its launch to its rest
        flights = e * u * _series(e, final - 1.0)
        squares = e * u * (e * u) * _series(e * e, final - 1.0)
        for p in range(particles):
            t = i * particles + p
            before, by = landings_seen(problem, i, launch(problem, launches, i, p), final, total)
            seen = max(by - before, 0.0)
            rests = 1.0 if by == final and seen > 0.0 else 0.0
            out.landings[t], out.rests[t] = int(seen), int(rests)
            out.at_rest[t] = 1 if by == final else 0
            followed = seen - rests  # no flight follows the last landing
            highest = e ** (before + 1.0) * u if followed > 0.0 else 0.0
            out.flight_max[t] = highest
            if followed == final - 1.0:
                out.flight_sum[t], out.flight_squares[t] = flights, squares
            else:
                out.flight_sum[t] = highest * _series(e, followed)
                out.flight_squares[t] = highest * highest * _series(e * e, followed)
            finite = np.isfinite(out.flight_squares[t])
            out.status[t] = COMPLETED if finite else NON_FINITE
