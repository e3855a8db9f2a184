"""Trajectories through time with running statistics; no landing is stored.

A block of lanes (trajectories) lives in one flat scratch array, one row per quantity.  The inner
loop runs over the lanes without a branch and becomes vector code; every `CHECK` impacts the lanes
whose next landing lies past the end are written out and their places are filled again.

One array with constant row offsets, rather than one array per quantity, lets the compiler prove
that rows do not overlap, and the padding keeps equal lanes of different rows off the same sets of
the first-level cache.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Flags, Floats, Integers, fma, jit, kernel
from vibrosweep.kernels.impact import land, launch, lift_off, rebound
from vibrosweep.scene import Dimensionless, Launches
from vibrosweep.status import Status

__all__ = ["CHECK", "Statistics", "advance", "empty_statistics", "scratch"]

LANES = 128
VECTOR = 8
STRIDE = LANES + VECTOR
CHECK = 4

# rows of the scratch array
X, N, U = 0 * STRIDE, 1 * STRIDE, 2 * STRIDE  # phase, count (from the end), flight time
E, A, R = 3 * STRIDE, 4 * STRIDE, 5 * STRIDE  # restitution, kick, rest threshold
X_LIFT, WAIT, U_LIFT = 6 * STRIDE, 7 * STRIDE, 8 * STRIDE  # where a rest ends
X_END, N_BEGIN, X_BEGIN = 9 * STRIDE, 10 * STRIDE, 11 * STRIDE  # window
LANDINGS, RESTS = 12 * STRIDE, 13 * STRIDE
SUM, SQUARES, LARGEST = 14 * STRIDE, 15 * STRIDE, 16 * STRIDE  # of the flight times
AGE, DONE, LANE = 17 * STRIDE, 18 * STRIDE, 19 * STRIDE  # impacts so far, leaves the block, name
ROWS = 20

COMPLETED = int(Status.COMPLETED)
BUDGET_EXCEEDED = int(Status.BUDGET_EXCEEDED)
NON_FINITE = int(Status.NON_FINITE)


class Statistics(NamedTuple):
    """Statistics of trajectories over the window, each array of shape (trajectory,).

    Attributes
    ----------
    landings, rests
        Number of landings, and of those after which the particle rested.
    at_rest
        1 where the particle came to rest for good before the end; summed, the number of those.
    flight_sum, flight_squares, flight_max
        Of the flights that follow the landings: sum, sum of squares and maximum of the flight
        time, in forcing periods and their square; a particle at rest for good adds nothing.
    status
        `vibrosweep.status.Status`.
    """

    landings: Integers
    rests: Integers
    at_rest: Integers
    flight_sum: Floats
    flight_squares: Floats
    flight_max: Floats
    status: Flags


def empty_statistics(trajectories: int) -> Statistics:
    """Room for the statistics of a batch."""
    landings, rests, at_rest = (np.empty(trajectories, np.int64) for _ in range(3))
    total, squares, largest = (np.empty(trajectories) for _ in range(3))
    status = np.empty(trajectories, np.int8)
    return Statistics(landings, rests, at_rest, total, squares, largest, status)


def scratch() -> Floats:
    """Scratch memory for one caller of `advance`, on a cache line so that no vector spans two."""
    memory = np.zeros(ROWS * STRIDE + VECTOR)
    offset = (-memory.ctypes.data // memory.itemsize) % VECTOR
    return memory[offset : offset + ROWS * STRIDE]


@jit
def _step(s: Floats, lanes: int, reflect: int | None, window: int | None) -> None:
    """One impact of every lane; a lane past its end goes on harmlessly and counts nothing."""
    for j in range(lanes):
        x, passed = land(s[X + j], s[U + j])
        n = s[N + j] + passed
        w = rebound(x, s[U + j], s[E + j], s[A + j], reflect)
        seen = n <= s[X_END + j] - x
        # a rest for good after the end is not observed
        wait = s[WAIT + j] if seen else 0.0
        n_off, x_off, u, leaves = lift_off(n, x, w, s[R + j], s[X_LIFT + j], wait, s[U_LIFT + j])
        if window is not None:
            seen = seen & (s[N_BEGIN + j] - n <= x - s[X_BEGIN + j])
        counted = u if seen else 0.0
        s[N + j] = n_off
        s[X + j] = x_off
        s[U + j] = u
        s[LANDINGS + j] += 1.0 if seen else 0.0
        s[RESTS + j] += 0.0 if leaves else (1.0 if seen else 0.0)
        s[SUM + j] += counted
        s[SQUARES + j] = fma(counted, counted, s[SQUARES + j])
        s[LARGEST + j] = counted if counted > s[LARGEST + j] else s[LARGEST + j]


@jit
def _find_done(s: Floats, padded: int, lanes: int, budget: int, places: Integers) -> int:
    """List the places whose next landing is past the end, or whose budget is spent."""
    for j in range(padded):
        x, passed = land(s[X + j], s[U + j])
        s[AGE + j] += CHECK
        past = 0.0 if s[N + j] + passed <= s[X_END + j] - x else 1.0
        s[DONE + j] = past if s[AGE + j] < budget else 1.0
    done = 0
    for j in range(lanes):  # without a branch, which no processor could predict
        places[done] = j
        done += int(s[DONE + j])
    return done


@jit
def _load(
    s: Floats,
    j: int,
    i: int,
    p: int,
    lane: int,
    problem: Dimensionless,
    launches: Launches,
    window: int | None,
) -> None:
    """Put trajectory `lane` (realization i, particle p) into place j."""
    n, x = launch(problem, launches, i, p)
    lifts = problem.kick[i] > problem.rest_flight[i]
    s[X + j] = x
    s[N + j] = n - problem.end_count[i]
    s[U + j] = problem.launch_flight[i]
    s[E + j] = problem.restitution[i]
    s[A + j] = problem.kick[i]
    s[R + j] = problem.rest_flight[i]
    s[X_LIFT + j] = problem.liftoff_phase[i]
    s[WAIT + j] = 0.0 if lifts else np.inf
    s[U_LIFT + j] = problem.rest_flight[i] if lifts else 0.0
    s[X_END + j] = problem.end_phase[i]
    if window is not None:
        s[N_BEGIN + j] = problem.begin_count[i] - problem.end_count[i]
        s[X_BEGIN + j] = problem.begin_phase[i]
    for row_start in (LANDINGS, RESTS, SUM, SQUARES, LARGEST, AGE, DONE):
        s[row_start + j] = 0.0
    s[LANE + j] = lane


@jit
def _write(s: Floats, j: int, out: Statistics) -> None:
    """Write the statistics of the trajectory in place j to its own slot."""
    lane = int(s[LANE + j])
    out.landings[lane] = int(s[LANDINGS + j])
    out.rests[lane] = int(s[RESTS + j])
    out.flight_sum[lane] = s[SUM + j]
    out.flight_squares[lane] = s[SQUARES + j]
    out.flight_max[lane] = s[LARGEST + j]
    out.at_rest[lane] = 1 if s[N + j] == np.inf else 0
    x, passed = land(s[X + j], s[U + j])
    goes_on = s[N + j] + passed <= s[X_END + j] - x
    out.status[lane] = BUDGET_EXCEEDED if goes_on else COMPLETED
    if not np.isfinite(s[SQUARES + j]):
        out.status[lane] = NON_FINITE


@kernel
def advance(
    first: int,
    last: int,
    problem: Dimensionless,
    launches: Launches,
    budget: int,
    reflect: int | None,
    window: int | None,
    s: Floats,
    out: Statistics,
) -> None:
    """Advance trajectories first ... last - 1 of a batch to the end of their window.

    Parameters
    ----------
    first, last
        Range of trajectories; trajectory t is particle t % N of realization t // N.
    problem : vibrosweep.scene.Dimensionless
    launches : vibrosweep.scene.Launches
    budget
        Impacts after which a trajectory is given up, in steps of `CHECK`.
    reflect, window
        None, or 1 for the `reflect` law and for a window that begins after the launch; chosen at
        compile time.
    s
        From `scratch`; not shared between threads.
    out : Statistics
        Only the slots first ... last - 1 are written.
    """
    particles = launches.whole.shape[1]
    i, p = first // particles, first % particles
    following = first
    places = np.arange(LANES)
    lanes = done = min(LANES, last - first)
    while lanes > 0:
        fresh = min(done, last - following)
        for q in range(fresh):
            _load(s, places[q], i, p, following + q, problem, launches, window)
            p += 1
            if p == particles:
                i, p = i + 1, 0
        following += fresh
        for q in range(done - 1, fresh - 1, -1):  # close the gaps that are left, the last one first
            lanes -= 1
            for row in range(ROWS):
                s[row * STRIDE + places[q]] = s[row * STRIDE + lanes]
        # whole vectors only: the places behind the last lane hold stale, harmless numbers
        padded = (lanes + VECTOR - 1) // VECTOR * VECTOR
        for _ in range(CHECK):
            _step(s, padded, reflect, window)
        done = _find_done(s, padded, lanes, budget, places)
        for q in range(done):
            _write(s, places[q], out)
