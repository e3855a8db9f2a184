"""Running statistics of trajectories over the window: all that kernels keep of landings.

What a statistic is stands here and nowhere else: its row beside those of `lanes`, what a landing
adds, what a cycle that is passed over adds, how it is written out, how those of the particles make
those of a realization, and its physical unit.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels._jit import Flags, Floats, Integers, fma, jit, kernel, prefetch
from vibrosweep.kernels.bases import (
    Base,
    Constants,
    Counted,
    Flight,
    counted,
    fly,
    pending,
    take,
)
from vibrosweep.kernels.impact import Impact, land
from vibrosweep.kernels.lanes import ROW, ROWS, SPENT, STRIDE, aligned
from vibrosweep.model.status import Status

LINE = 8  # numbers in a cache line

COMPLETED = int(Status.COMPLETED)
BUDGET_EXCEEDED = int(Status.BUDGET_EXCEEDED)
NON_FINITE = int(Status.NON_FINITE)


class Statistics(NamedTuple):
    """Statistics of trajectories over the window, each array of shape (trajectory,)."""

    # landings, rests: number of landings, and of those after which the particle rested
    landings: Integers
    rests: Integers
    # 1 if the particle came to rest for good before the end; in sums, the number of such particles
    at_rest: Flags | Integers
    # flight_sum, flight_squares, flight_max: of the flights that follow the landings: sum, sum of
    # squares and maximum of the flight time, in forcing periods and their square; a particle at
    # rest for good adds nothing
    flight_sum: Floats
    flight_squares: Floats
    flight_max: Floats
    status: Flags  # `vibrosweep.model.status.Status`


class Cycle(NamedTuple):
    """Totals of one cycle, from a state to its return; of 0 impacts where it does not return."""

    impacts: float
    periods: float
    rests: float
    flight_sum: float
    flight_squares: float
    flight_max: float


class Running(NamedTuple):
    """Where the rows of statistics begin, behind those of `lanes`.

    Those up to LARGEST take part in every impact.
    """

    LANDINGS: int
    RESTS: int
    NEW_SUM: int  # of the flight times since the last look, and of their squares
    NEW_SQUARES: int
    LARGEST: int
    SUM: int  # up to the last look
    SQUARES: int
    CYCLE_IMPACTS: int  # of the cycle that it has entered, those of `Cycle` in their order
    CYCLE_PERIODS: int
    CYCLE_RESTS: int
    CYCLE_SUM: int
    CYCLE_SQUARES: int
    CYCLE_LARGEST: int


OF_CYCLE: Final = len(Cycle._fields)
OF_LANE: Final = ROWS + len(Running._fields)  # rows in all
RUNNING: Final = Running(*((ROWS + row) * STRIDE for row in range(len(Running._fields))))


def scratch() -> Floats:
    """Scratch memory for one caller of `vibrosweep.kernels.advance.advance`."""
    return aligned(OF_LANE * STRIDE)


def empty_statistics(trajectories: int) -> Statistics:
    """Allocate the statistics of a batch."""
    landings, rests = (np.empty(trajectories, np.int64) for _ in range(2))
    total, squares, largest = (np.empty(trajectories) for _ in range(3))
    at_rest, status = (np.empty(trajectories, np.int8) for _ in range(2))
    return Statistics(landings, rests, at_rest, total, squares, largest, status)


@jit
def expect(out: Statistics, lane: int) -> None:
    """Prefetch the memory of statistics that will be written a block of lanes later."""
    if lane % LINE > 0:  # the previous trajectory has prefetched this cache line
        return
    prefetch(out.landings, lane)
    prefetch(out.rests, lane)
    prefetch(out.flight_sum, lane)
    prefetch(out.flight_squares, lane)
    prefetch(out.flight_max, lane)
    prefetch(out.at_rest, lane)
    prefetch(out.status, lane)


@jit
def clear(s: Floats, j: int) -> None:
    """Begin the statistics of the trajectory in place j."""
    s[RUNNING.LANDINGS + j] = s[RUNNING.RESTS + j] = 0.0
    s[RUNNING.SUM + j] = s[RUNNING.SQUARES + j] = s[RUNNING.LARGEST + j] = 0.0
    s[RUNNING.CYCLE_IMPACTS + j] = 0.0  # none is known


@jit
def count(s: Floats, j: int, flight: Counted, ends: bool, leaves: bool, seen: bool) -> None:
    """Count a landing in place j where it is seen, and a flight where it ends."""
    # the sum, which changes nothing, keeps the compiler from choosing by a masked store: that takes
    # processors of AMD without AVX-512 as long as ten others
    largest = s[RUNNING.LARGEST + j] + 0.0
    time = flight[0] if ends else 0.0
    height, factor = flight[1] if ends else 0.0, flight[2] if ends else 0.0
    s[RUNNING.LANDINGS + j] += 1.0 if seen else 0.0
    s[RUNNING.RESTS + j] += 0.0 if leaves else (1.0 if seen else 0.0)
    s[RUNNING.NEW_SUM + j] += time
    s[RUNNING.NEW_SQUARES + j] = fma(height, factor, s[RUNNING.NEW_SQUARES + j])
    s[RUNNING.LARGEST + j] = height if height > largest else largest


@jit
def sum_up(s: Floats, j: int) -> None:
    """Add to the sums what came since the last look."""
    # sums of sums, which over a long orbit are rounded a sixth as often
    s[RUNNING.SUM + j] += s[RUNNING.NEW_SUM + j]
    s[RUNNING.SQUARES + j] += s[RUNNING.NEW_SQUARES + j]
    s[RUNNING.NEW_SUM + j] = s[RUNNING.NEW_SQUARES + j] = 0.0


@jit
def no_impacts() -> Cycle:
    """Totals of no impacts."""
    return Cycle(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@jit
def add(to: Cycle, fixed: Constants, hit: Impact) -> Cycle:
    """Add an impact, whose lift-off is counted from the beginning of the cycle."""
    time, height, factor = counted(fixed, hit.flight, hit.u)
    return Cycle(
        to.impacts + 1.0,
        hit.n_off,
        to.rests + (0.0 if hit.leaves else 1.0),
        to.flight_sum + time,
        to.flight_squares + height * factor,
        max(to.flight_max, height),
    )


@jit
def repeat(s: Floats, j: int, times: float) -> None:
    """Count the landings of so many whole cycles in place j."""
    s[RUNNING.LANDINGS + j] += times * s[RUNNING.CYCLE_IMPACTS + j]
    s[RUNNING.RESTS + j] += times * s[RUNNING.CYCLE_RESTS + j]
    s[RUNNING.SUM + j] += times * s[RUNNING.CYCLE_SUM + j]
    s[RUNNING.SQUARES + j] += times * s[RUNNING.CYCLE_SQUARES + j]
    largest = s[RUNNING.CYCLE_LARGEST + j] if times > 0.0 else 0.0
    s[RUNNING.LARGEST + j] = max(s[RUNNING.LARGEST + j], largest)


@jit
def write(s: Floats, j: int, base: Base, windowed: bool, out: Statistics) -> None:
    """Write the statistics of the trajectory in place j to its own slot."""
    # all in one function: with a second one inside, numba counts references at every call
    lane = int(s[ROW.LANE + j]) if j >= 0 else -1
    if lane < 0:  # never, which spares the compiler the look at it for each index below
        return
    over = False
    fixed = take(base, s, j)
    # a flight that begins after the end, when a rest does, is in progress here
    waits = pending(base, s, j)
    if waits or s[ROW.DONE + j] == SPENT:
        x_off, u = s[ROW.X + j], s[ROW.U + j]
        time, v = fly(fixed, x_off, u)
        x, passed = land(x_off, time)
        over = s[ROW.DONE + j] == SPENT and s[ROW.N + j] + passed <= s[ROW.X_END + j] - x
        if waits:
            last = counted(fixed, Flight(x_off, u, time, x, v), 0.0)
            s[RUNNING.SUM + j] += last[0]
            s[RUNNING.SQUARES + j] += last[1] * last[2]
            s[RUNNING.LARGEST + j] = max(s[RUNNING.LARGEST + j], last[1])
    out.landings[lane] = int(s[RUNNING.LANDINGS + j])
    out.rests[lane] = int(s[RUNNING.RESTS + j])
    out.flight_sum[lane] = s[RUNNING.SUM + j]
    out.flight_squares[lane] = s[RUNNING.SQUARES + j]
    out.flight_max[lane] = s[RUNNING.LARGEST + j]
    for_good = np.isnan(s[ROW.X + j])
    if not windowed:  # it may have come after the end, but not where it was counted
        for_good = for_good and s[RUNNING.RESTS + j] > 0.0
    out.at_rest[lane] = 1 if for_good else 0
    out.status[lane] = BUDGET_EXCEEDED if over else COMPLETED
    if not np.isfinite(s[RUNNING.SQUARES + j] + s[RUNNING.SUM + j]):
        out.status[lane] = NON_FINITE


@kernel
def combine(first: int, last: int, particles: int, each: Statistics, out: Statistics) -> None:
    """Combine the particles of realizations first ... last - 1, always in the same order.

    Sums, the largest maximum, the number of particles at rest for good and the worst status.
    """
    for i in range(first, last):
        landings, rests, at_rest, status = 0, 0, 0, 0
        total, squares, largest = 0.0, 0.0, 0.0
        for t in range(i * particles, (i + 1) * particles):
            landings += each.landings[t]
            rests += each.rests[t]
            at_rest += each.at_rest[t]
            total += each.flight_sum[t]
            squares += each.flight_squares[t]
            largest = max(largest, each.flight_max[t])
            status = max(status, each.status[t])
        out.landings[i] = landings
        out.rests[i] = rests
        out.at_rest[i] = at_rest
        out.flight_sum[i] = total
        out.flight_squares[i] = squares
        out.flight_max[i] = largest
        out.status[i] = status


def physical(
    found: Statistics,
    frequency: Floats,
    gravity: Floats,
    lifts: NDArray[np.bool_],
    lowest: Floats | None,
) -> dict[str, NDArray[Any]]:
    """Statistics in physical units, by the names of `vibrosweep.model.measures`.

    Of the base, `lifts` tells whether a resting particle is ever lifted, and `lowest` what heights
    are counted from; all are of the shape of `found`, in Hz and m s-2.
    """
    # height of a flight that lasts one forcing period: g / (8 f^2)
    height = gravity / (8.0 * frequency * frequency)
    # where nothing lifts a resting particle, its last landing is followed by no flight
    flights = found.landings - np.where(lifts, 0, found.rests)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        mean, largest = found.flight_squares / flights, found.flight_max
        of_flights = {
            "rebound_height_mean": height * (mean if lowest is None else mean - lowest),
            "rebound_height_max": height
            * (largest * largest if lowest is None else largest - lowest),
            "flight_time_mean": found.flight_sum / flights / frequency,
        }
    # one NaN for all: that of 0 / 0 has a sign which depends on the length of the batch
    known = {name: np.where(flights > 0, v, np.nan) for name, v in of_flights.items()}
    return {"impact_count": found.landings, "rest_count": found.rests, **known}
