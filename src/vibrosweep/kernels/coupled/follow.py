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
    close,
    end_stay,
    gap_median,
    lacks_room,
    note,
    order_of,
)
from vibrosweep.kernels.coupled.state import (
    EVENT,
    MODE,
    NOW,
    PARTICLE,
    Event,
    begin,
    motion_after,
    since_now,
)
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
from vibrosweep.kernels.impact import Instant
from vibrosweep.kernels.record import Record, Units
from vibrosweep.model.parameters import Dimensionless, Launches, Mounts
from vibrosweep.model.status import Status

COMPLETED = int(Status.COMPLETED)
BUDGET_EXCEEDED = int(Status.BUDGET_EXCEEDED)
NON_FINITE = int(Status.NON_FINITE)
AFTER_THE_END = 100_000  # events in which flights that count are to land
# Periods after the end up to which a lift-off is waited for: a base without particles that lifts
# what rests on it does so within one
PATIENCE = 1.0
SAME_INSTANT = 2.0**-50  # periods; two sums of the same time and phase differ by less


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
def _windows(begin: Instant, now: Floats, left: float) -> tuple[bool, bool]:
    """Whether a landing now, up to the end, is in the window, and in its last period."""
    seen = begin[0] - now[NOW.N] <= now[NOW.X] - begin[1]
    return seen, seen and left <= 1.0


@part
def _count(work: Room, event: Event, seen: bool, first: int, each: Each) -> None:
    """Count a landing, where it is seen, and the flight that begins with it; it has been noted."""
    j = event.who
    t = first + j
    sticks = event.kind == EVENT.STICK
    if seen:
        each.landings[t] += 1
        each.rests[t] += 1 if sticks else 0
    work.counts[j] = 1 if seen else 0
    if not sticks:
        count_flight(work, t, j, each)


@jit
def _launched(work: Room, j: int, t: int, each: Each) -> None:
    """Count a launch."""
    of = work.of
    work.lifted[0, j], work.lifted[1, j] = of.now[NOW.N], of.now[NOW.X]
    each.launch_height[t] = apex(
        of.now[NOW.HEIGHT], of.now[NOW.SPEED], of.particle[PARTICLE.SPEED, j]
    )


@part
def _launched_at_the_end(
    work: Room, load: Load, left: float, launch_speed: float, first: int, each: Each
) -> None:
    """Count launches at the very end, which is `left` from now and rounding puts after it."""
    of = work.of
    motion = motion_after(of, load, left)
    height = of.now[NOW.HEIGHT] + of.now[NOW.SPEED] * left + motion.rise
    speed = of.now[NOW.SPEED] + motion.gain
    for j in range(of.mode.size):
        if of.mode[j] == MODE.WAITING and since_now(of, j) - left <= SAME_INSTANT:
            each.launch_height[first + j] = apex(height, speed, launch_speed - speed)


@part
def _write(
    work: Room, load: Load, event: Event, scale: Scale, place: tuple[int, int], out: Written
) -> None:
    """Write an event up to the end; `place`: the realization, and how many events came before."""
    i, number = place
    write_base(work.of, load, scale, i, number, out.track)
    if event.kind == EVENT.BOUNCE or event.kind == EVENT.STICK:
        write_landing(work, scale, i * work.rides.size + event.who, event, out.record)


@part
def _lift_off(
    work: Room, first: int, least: float, counts: bool, scale: Scale, out: Written, each: Each
) -> None:
    """Let the riders leave, and count and write it where it `counts`.

    A stay lasts at least the contact time, `least`.
    """
    for j in range(work.rides.size):
        if work.rides[j] == 1 and counts:
            end_stay(work.of, work.landings, j, least)
            count_flight(work, first + j, j, each)
            if out.track.time.shape[1] > 0:
                write_lift_off(work, scale, first + j, j, out.record)
        work.rides[j] = 0


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
def _any(flags: Integers) -> bool:
    """Whether a particle has the flag."""
    number = 0
    for flag in flags:
        number += flag
    return number > 0


@jit
def _horizon(work: Room, until: float, past: bool) -> float:
    """Return how far to look for the next event; minus infinity where none counts any more."""
    if not past:
        return until
    if _any(work.flies):
        return np.inf
    return until + PATIENCE if until >= -PATIENCE and _any(work.rides) else -np.inf


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
    if stays and (load.riders == work.rides.size or not weighs):
        for j in range(work.rides.size):
            each.at_rest[first + j] = work.rides[j]
            work.rides[j] = 0  # no lift-off is waited for


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

    And on until flights that count have ended, and what rests at the end has left the base or has
    rested for another `PATIENCE`.  At most `budget` landings of a particle; `work` is not shared
    between threads, and only the slots of these realizations are written.  Returns `last`, or the
    realization that is to be begun again with a roomier `work`.
    """
    problem, mounts, launches = batch
    each, sums = statistics
    of, memory = work.of, work.landings
    particles, writes = of.mode.size, written.track.time.shape[1] > 0
    for i in range(first, last):
        fixed, place = mount(problem, mounts, i), i * particles
        load = begin(of, fixed, problem, launches, i)
        forget(work, place, each)
        order = clear(memory)
        opening = problem.begin_count[i] - problem.end_count[i], problem.begin_phase[i]
        scale = _scale(problem, written.units, i)
        past, events, late = False, 0, 0
        status = COMPLETED if np.isfinite(fixed.alpha) else NON_FINITE
        while status == COMPLETED:
            until = (problem.end_phase[i] - of.now[NOW.X]) - of.now[NOW.N]
            horizon = _horizon(work, until, past)
            if horizon == -np.inf:
                break
            event, load = next_event(of, fixed, load, problem.launch_flight[i], horizon)
            if event.kind == EVENT.LOST or late >= AFTER_THE_END:
                status = BUDGET_EXCEEDED
                break
            if event.kind == EVENT.NONE or event.kind == EVENT.FINISHED:
                if past:
                    break
                left, past = max(until, 0.0), True
                order = close(memory, order, opening)
                _launched_at_the_end(work, load, left, problem.launch_flight[i], place, each)
                _resting(work, load, fixed.mu > 0.0, place, left, each)
                continue
            left = (problem.end_phase[i] - of.now[NOW.X]) - of.now[NOW.N]
            if event.kind == EVENT.LAUNCH:
                if not past:
                    _launched(work, event.who, place + event.who, each)
            elif event.kind != EVENT.LIFT:
                windows = _windows(opening, of.now, left)
                if not past and memory.total[event.who] >= budget:
                    status = BUDGET_EXCEEDED
                    break
                if not past and lacks_room(memory, event.who, windows[0]):
                    return i
                end_flight(work, place + event.who, event.who, each)
                if past:
                    work.counts[event.who] = 0
                else:
                    stay = np.inf if event.kind == EVENT.STICK else fixed.r
                    order = note(of, memory, order, event.who, windows, opening, stay)
                    _count(work, event, windows[0], place, each)
            if writes and not past:
                _write(work, load, event, scale, (i, events), written)
            if event.kind == EVENT.LIFT or event.dropped:
                _lift_off(work, place, fixed.r, left >= -PATIENCE, scale, written, each)
            if event.kind == EVENT.STICK and not past:
                work.rides[event.who] = 1
            events += 1
            late += 1 if past else 0
        _conclude(work, memory, order, i, whole)
        _judge(place, particles, status, each)
        add_up(i, particles, each, sums)
    return last
