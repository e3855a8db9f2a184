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

__all__ = [
    "CHECK",
    "Cycles",
    "Statistics",
    "advance",
    "empty_cycles",
    "empty_statistics",
    "scratch",
]

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
AGE, DONE, LANE = 17 * STRIDE, 18 * STRIDE, 19 * STRIDE  # impacts so far, why it leaves, name
X_ANCHOR, N_ANCHOR, U_ANCHOR = 20 * STRIDE, 21 * STRIDE, 22 * STRIDE  # an earlier state
NEXT_ANCHOR = 23 * STRIDE  # age at which the next one is taken
ROWS = 24

SAME = 2.0**-40  # periods

GOES_ON, ENDED, SPENT, RECURRED = 0.0, 1.0, 2.0, 3.0  # values of DONE

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


class Cycles(NamedTuple):
    """Cycles that trajectories have entered, each array of shape (trajectory,).

    Attributes
    ----------
    impacts, periods, rests
        Impacts, forcing periods and rests in one cycle; 0 where no recurrence was found.  Rounding
        lets an orbit alternate between neighbouring numbers: states closer than `SAME` are one.
    begin
        When it had been entered at the latest: whole periods from the end's, plus the phase; NaN
        without.
    """

    impacts: Integers
    periods: Integers
    rests: Integers
    begin: Floats


def empty_cycles(trajectories: int) -> Cycles:
    """Room for the cycles of a batch."""
    impacts, periods, rests = (np.empty(trajectories, np.int64) for _ in range(3))
    return Cycles(impacts, periods, rests, np.empty(trajectories))


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
def _mark(s: Floats, lanes: int, budget: int, cycles: Cycles | None) -> None:
    """Mark the lanes whose next landing is past the end, that recur, or whose budget is spent."""
    for j in range(lanes):
        x, passed = land(s[X + j], s[U + j])
        s[AGE + j] += CHECK
        why = GOES_ON if s[AGE + j] < budget else SPENT
        if cycles is not None:
            # the same bits again: from here on the orbit repeats, later by whole periods
            again = (s[X + j] == s[X_ANCHOR + j]) & (s[U + j] == s[U_ANCHOR + j])
            why = RECURRED if again & (s[N + j] > s[N_ANCHOR + j]) else why
            anchor = s[AGE + j] >= s[NEXT_ANCHOR + j]  # Brent: at ages that double
            s[X_ANCHOR + j] = s[X + j] if anchor else s[X_ANCHOR + j]
            s[N_ANCHOR + j] = s[N + j] if anchor else s[N_ANCHOR + j]
            s[U_ANCHOR + j] = s[U + j] if anchor else s[U_ANCHOR + j]
            s[NEXT_ANCHOR + j] = 2.0 * s[AGE + j] if anchor else s[NEXT_ANCHOR + j]
        s[DONE + j] = why if s[N + j] + passed <= s[X_END + j] - x else ENDED


@jit
def _find_done(s: Floats, lanes: int, places: Integers) -> int:
    """List the places of the lanes that are marked; return their number."""
    done = 0
    for j in range(lanes):  # without a branch, which no processor could predict
        places[done] = j
        done += 1 if s[DONE + j] != GOES_ON else 0
    return done


@jit
def _occurrences(first: float, last: float, period: float) -> float:
    """Count the members of first, first + period, ... up to last; all are whole numbers."""
    # below 2**53 the quotient is never rounded across a whole number
    times: float = np.floor((last - first) / period) + 1.0
    return max(0.0, times)


@jit
def _impact(
    s: Floats, j: int, n: float, x: float, u: float, reflect: int | None
) -> tuple[float, float, float, float, float, bool]:
    """Landing and lift-off of lane j after a flight u from (n, x)."""
    x, passed = land(x, u)
    n += passed
    w = rebound(x, u, s[E + j], s[A + j], reflect)
    n_off, x_off, u, leaves = lift_off(n, x, w, s[R + j], s[X_LIFT + j], s[WAIT + j], s[U_LIFT + j])
    return n, x, n_off, x_off, u, leaves


@jit
def _cycle(s: Floats, j: int, reflect: int | None) -> tuple[int, int, float]:
    """Impacts, rests and forcing periods of the cycle that lane j has entered."""
    x, n, u = s[X + j], s[N + j], s[U + j]
    impacts, rests = 0, 0
    while impacts == 0 or x != s[X + j] or u != s[U + j]:
        _, _, n, x, u, leaves = _impact(s, j, n, x, u, reflect)
        impacts += 1
        rests += 0 if leaves else 1
    return impacts, rests, n - s[N + j]


@jit
def _repeats(
    s: Floats, j: int, reflect: int | None, impacts: int, shorter: int
) -> tuple[bool, float]:
    """Whether a cycle of lane j is, up to rounding, a shorter one; and that one's periods."""
    x, n, u = s[X + j], s[N + j], s[U + j]
    ahead_x, ahead_n, ahead_u = x, n, u
    for _ in range(shorter):
        _, _, ahead_n, ahead_x, ahead_u, _ = _impact(s, j, ahead_n, ahead_x, ahead_u, reflect)
    periods = np.rint((ahead_n - n) + (ahead_x - x))
    for _ in range(impacts):
        apart = (ahead_n - n - periods) + (ahead_x - x)
        if abs(apart) > SAME or abs(ahead_u - u) > SAME:
            return False, periods
        _, _, n, x, u, _ = _impact(s, j, n, x, u, reflect)
        _, _, ahead_n, ahead_x, ahead_u, _ = _impact(s, j, ahead_n, ahead_x, ahead_u, reflect)
    return True, periods


@jit
def _close(s: Floats, j: int, reflect: int | None, window: int | None, cycles: Cycles) -> None:
    """Count each landing of the cycle that lane j has entered as often as it recurs.

    The landing decided by n <= x_end - x is decided by n <= floor(x_end - x), for n is whole: the
    number of landings is the one that going on would find.
    """
    lane = int(s[LANE + j])
    impacts, rests, period = _cycle(s, j, reflect)
    x, n, u = s[X + j], s[N + j], s[U + j]
    for _ in range(impacts):
        landed_n, landed_x, n, x, u, leaves = _impact(s, j, n, x, u, reflect)
        times = _occurrences(landed_n, np.floor(s[X_END + j] - landed_x), period)
        if window is not None:
            early = s[N_BEGIN + j] - np.floor(landed_x - s[X_BEGIN + j]) - 1.0
            times -= _occurrences(landed_n, early, period)
        s[LANDINGS + j] += times
        s[RESTS + j] += 0.0 if leaves else times
        s[SUM + j] += times * u
        s[SQUARES + j] += times * (u * u)
        s[LARGEST + j] = max(s[LARGEST + j], u if times > 0.0 else 0.0)
    cycles.impacts[lane], cycles.rests[lane], cycles.periods[lane] = impacts, rests, int(period)
    for shorter in range(1, impacts // 2 + 1):
        if impacts % shorter == 0:
            same, period = _repeats(s, j, reflect, impacts, shorter)
            if same:
                cycles.impacts[lane], cycles.periods[lane] = shorter, int(period)
                cycles.rests[lane] = rests * shorter // impacts
                break
    cycles.begin[lane] = s[N_ANCHOR + j] + s[X_ANCHOR + j]


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
    cycles: Cycles | None,
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
    if cycles is not None:
        s[X_ANCHOR + j], s[N_ANCHOR + j], s[U_ANCHOR + j] = x, s[N + j], s[U + j]
        s[NEXT_ANCHOR + j] = CHECK
        cycles.impacts[lane], cycles.periods[lane], cycles.rests[lane] = 0, 0, 0
        cycles.begin[lane] = np.nan


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
    out.status[lane] = BUDGET_EXCEEDED if s[DONE + j] == SPENT else COMPLETED
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
    cycles: Cycles | None = None,
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
    cycles : Cycles or None
        Where given, a trajectory whose state returns bit for bit is not followed any further: the
        rest is counted from one cycle.  Sums then differ from those of going on by rounding only.
    """
    particles = launches.whole.shape[1]
    i, p = first // particles, first % particles
    following = first
    places = np.arange(LANES)
    lanes = done = min(LANES, last - first)
    while lanes > 0:
        fresh = min(done, last - following)
        for q in range(fresh):
            _load(s, places[q], i, p, following + q, problem, launches, window, cycles)
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
        _mark(s, padded, budget, cycles)
        done = _find_done(s, lanes, places)
        for q in range(done):
            if cycles is not None and s[DONE + places[q]] == RECURRED:
                _close(s, places[q], reflect, window, cycles)
            _write(s, places[q], out)
