"""Follow realizations with a base of finite mass; keep statistics, or every landing as well."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Flags, Floats, Integers, jit, part, uncounted
from vibrosweep.kernels.bases.sprung import Load, bounds, mount
from vibrosweep.kernels.coupled.events import next_event
from vibrosweep.kernels.coupled.neighbours import (
    HARMONICS,
    Landings,
    Order,
    clear,
    gap_median,
    lacks_room,
    note,
    order_of,
)
from vibrosweep.kernels.coupled.state import EVENT, NOW, Event, begin, motion_after
from vibrosweep.kernels.coupled.tally import (
    Each,
    Room,
    add_up,
    apex,
    count_flight,
    end_flight,
    forget,
)
from vibrosweep.kernels.coupled.written import (
    Scale,
    Track,
    write_base,
    write_landing,
    write_lift_off,
)
from vibrosweep.kernels.record import Record, Units
from vibrosweep.model.parameters import Dimensionless, Launches, Mounts
from vibrosweep.model.status import Status

COMPLETED = int(Status.COMPLETED)
BUDGET_EXCEEDED = int(Status.BUDGET_EXCEEDED)
NON_FINITE = int(Status.NON_FINITE)
AFTER_THE_END = 100_000  # events in which flights that began before the end are to land


class Coupled(NamedTuple):
    """Realizations, their mounts and launches."""

    problem: Dimensionless
    mounts: Mounts
    launches: Launches


class Whole(NamedTuple):
    """What realizations have one number of; each array of shape (realization,) but for `order`."""

    # gap, same, shared: as in `vibrosweep.kernels.separation.Separations`
    gap: Floats
    same: Floats
    shared: Flags
    # Decisions between bouncing and sticking, landing and grazing, or on the order of two landings,
    # that rounding may have made
    undecided: Integers
    changes: Integers  # landings out of turn
    # gap_median, gap_least: of the gaps between neighbouring landings of different particles in the
    # last period
    gap_median: Floats
    gap_least: Floats
    order: Floats  # shape (realization, harmonic)


def empty_whole(realizations: int) -> Whole:
    """Allocate what realizations have one number of."""
    gap, same, median, least = (np.full(realizations, np.nan) for _ in range(4))
    shared = np.full(realizations, -1, np.int8)
    undecided, changes = np.zeros(realizations, np.int64), np.zeros(realizations, np.int64)
    order = np.full((realizations, len(HARMONICS)), np.nan)
    return Whole(gap, same, shared, undecided, changes, median, least, order)


class Written(NamedTuple):
    """Where every landing and the motion of the base are written; what exceeds it is cut off."""

    record: Record
    track: Track
    units: Units


@jit
def _windows(problem: Dimensionless, i: int, now: Floats, past: bool) -> tuple[bool, bool]:
    """Whether now is in the window, and in its last period."""
    early = (problem.begin_count[i] - problem.end_count[i] - now[NOW.N]) + (
        problem.begin_phase[i] - now[NOW.X]
    )
    left = problem.end_phase[i] - now[NOW.X] - now[NOW.N]
    return not past and early <= 0.0, not past and early <= 0.0 and left <= 1.0


@part
def _leave(work: Room, first: int, past: bool, each: Each) -> None:
    """Count the flights of the riders, which leave now."""
    for j in range(work.rides.size):
        if work.rides[j] == 1:
            count_flight(work, first + j, j, past, each)


@part
def _count(work: Room, event: Event, windows: tuple[bool, bool], first: int, each: Each) -> None:
    """Count a landing, and the flight that begins with it; it has been noted."""
    j = event.who
    t = first + j
    sticks = event.kind == EVENT.STICK
    if windows[0]:
        each.landings[t] += 1
        each.rests[t] += 1 if sticks else 0
    work.counts[j] = 1 if windows[0] else 0
    if not sticks:
        count_flight(work, t, j, False, each)


@jit
def _launched(work: Room, j: int, t: int, seen: bool, each: Each) -> None:
    """Count a launch."""
    work.lifted[0, j], work.lifted[1, j] = work.of.now[NOW.N], work.of.now[NOW.X]
    if seen:
        each.launch_height[t] = apex(work.of, j)


@part
def _write(
    work: Room, load: Load, event: Event, scale: Scale, place: tuple[int, int], out: Written
) -> None:
    """Write an event; `place`: the realization, and how many events came before."""
    i, number = place
    first = i * work.rides.size
    write_base(work.of, load, scale, i, number, out.track)
    if event.kind == EVENT.BOUNCE or event.kind == EVENT.STICK:
        write_landing(work, scale, first + event.who, event, out.record)
    if event.kind == EVENT.LIFT or event.dropped:
        for j in range(work.rides.size):
            if work.rides[j] == 1:
                write_lift_off(work, scale, first + j, j, out.record)


@part
def _conclude(work: Room, memory: Landings, order: Order, i: int, out: Whole) -> None:
    """Write what a realization has one number of."""
    out.gap[i] = order.gap if order.gap < np.inf else np.nan
    out.same[i] = order.same if order.same < np.inf else np.nan
    out.shared[i], out.changes[i] = order.shared, order.changes
    out.undecided[i] = int(work.of.now[NOW.UNDECIDED])
    out.gap_median[i], out.gap_least[i] = gap_median(memory, order)
    for h in range(out.order.shape[1]):
        out.order[i, h] = order_of(memory, HARMONICS[h])


@jit
def _flies(work: Room) -> bool:
    """Whether a flight that counts has not ended."""
    number = 0
    for flag in work.flies:
        number += flag
    return number > 0


@jit
def _shared(order: Order) -> Order:
    """Return the same, with two particles on the base at once."""
    gap, same, _, who, number, seen, changes, gaps = order
    return Order(gap, same, 1, who, number, seen, changes, gaps)


@jit
def _scale(problem: Dimensionless, units: Units, i: int) -> Scale:
    """Units and origin of time of realization i."""
    return Scale(units.frequency[i], units.velocity[i], problem.end_count[i], problem.phase[i])


@jit
def _judge(first: int, particles: int, status: int, each: Each) -> None:
    """Write the status of all particles, which are coupled: that of the worst."""
    for t in range(first, first + particles):
        total = each.flight_sum[t] + each.height_sum[t]
        if each.landings[t] > 0 and not np.isfinite(total):
            status = NON_FINITE
    for t in range(first, first + particles):
        each.status[t] = status


@part
def _resting(work: Room, load: Load, weighs: bool, first: int, left: float, each: Each) -> None:
    """Note which particles rest for good at the end, which is `left` periods from now.

    All of them, or any where none moves the base, once the energy of the free oscillation is too
    small for the base ever to fall faster than gravity.
    """
    motion = motion_after(work.of, load, left)
    stays = bounds(load, motion.d, motion.b).pull <= 2.0
    for_good = stays and (load.riders == work.rides.size or not weighs)
    for j in range(work.rides.size):
        each.at_rest[first + j] = 1 if for_good and work.rides[j] == 1 else 0


@uncounted
def follow(
    first: int,
    last: int,
    batch: Coupled,
    budget: int,
    work: Room,
    statistics: tuple[Each, Each],
    whole: Whole,
    written: Written,
) -> int:
    """Follow realizations first ... last - 1 to the end of their windows.

    At most `budget` landings of a particle; `work` is not shared between threads, and only the
    slots of these realizations are written.  Returns `last`, or the realization that is to be begun
    again with a roomier `work`.
    """
    problem, mounts, launches = batch
    each, sums = statistics
    of, memory = work.of, work.landings
    particles = of.mode.size
    for i in range(first, last):
        fixed, place = mount(problem, mounts, i), i * particles
        load = begin(of, fixed, problem, launches, i)
        forget(work, place, each)
        order = clear(memory)
        past, events, late, status = False, 0, 0, COMPLETED
        if not np.isfinite(fixed.alpha):
            status = NON_FINITE
        while status == COMPLETED:
            until = (problem.end_phase[i] - of.now[NOW.X]) - of.now[NOW.N]
            riders, horizon = load.riders, np.inf if past else until
            event, load = next_event(of, fixed, load, problem.launch_flight[i], horizon)
            if event.kind <= EVENT.LOST:
                if riders > 1 and not past:
                    order = _shared(order)
                if event.kind == EVENT.LOST:
                    status = BUDGET_EXCEEDED
                elif not past:
                    _resting(work, load, fixed.mu > 0.0, place, max(until, 0.0), each)
                if event.kind == EVENT.NONE and _flies(work):
                    past = True
                    continue
                break
            windows = _windows(problem, i, of.now, past)
            if event.kind == EVENT.LAUNCH:
                _launched(work, event.who, place + event.who, windows[0], each)
            elif event.kind != EVENT.LIFT:
                if not past and memory.total[event.who] >= budget:
                    status = BUDGET_EXCEEDED
                    break
                if not past and lacks_room(memory, event.who):
                    return i
                end_flight(work, place + event.who, event.who, each)
                if not past:
                    order = note(of, riders, memory, order, event.who, windows, fixed.r)
                    _count(work, event, windows, place, each)
                elif not _flies(work):
                    break
                elif late >= AFTER_THE_END:
                    status = BUDGET_EXCEEDED
            if event.kind == EVENT.LIFT or event.dropped:
                _leave(work, place, past, each)
            if written.track.time.shape[1] > 0 and not past:
                _write(work, load, event, _scale(problem, written.units, i), (i, events), written)
            if event.kind == EVENT.LIFT or event.dropped:
                for j in range(particles):
                    work.rides[j] = 0
            if event.kind == EVENT.STICK:
                work.rides[event.who] = 1
            events += 1
            late += 1 if past else 0
        _conclude(work, memory, order, i, whole)
        _judge(place, particles, status, each)
        add_up(i, particles, each, sums)
    return last
