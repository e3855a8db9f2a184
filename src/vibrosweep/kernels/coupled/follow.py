"""Follow realizations with a base of finite mass; keep statistics, or every landing as well."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, Integers, jit, part, uncached, uncounted
from vibrosweep.kernels.bases import Instant
from vibrosweep.kernels.bases.drives import until_corner
from vibrosweep.kernels.bases.sprung import Load, bounds, mount
from vibrosweep.kernels.coupled.counting import (
    CoupledStatistics,
    Work,
    apex,
    begin_statistics,
    count_landing,
    judge,
    take_off,
)
from vibrosweep.kernels.coupled.events import next_event
from vibrosweep.kernels.coupled.motion_record import MotionRecord, write_base
from vibrosweep.kernels.coupled.noted import Noted, clear, close, end_stay, lacks_memory, note
from vibrosweep.kernels.coupled.state import (
    EVENT,
    MODE,
    NOW,
    PARTICLE,
    Event,
    System,
    begin,
    motion_after,
    since_now,
)
from vibrosweep.kernels.listing import Listed
from vibrosweep.kernels.record import (
    Record,
    Scale,
    Units,
    no_landings,
    write_landing,
    write_lift_off,
)
from vibrosweep.kernels.separation import Separations, empty_separations, write_separations
from vibrosweep.kernels.sequence import Orders, empty_orders, write_order
from vibrosweep.kernels.slabs import UNKNOWN
from vibrosweep.kernels.statistics import Statistics
from vibrosweep.kernels.totals import add_up
from vibrosweep.kernels.unwritten import unwritten
from vibrosweep.model.measures import Status
from vibrosweep.model.parameters import Dimensionless, Launches, Mounts

COMPLETED = int(Status.COMPLETED)
BUDGET_EXCEEDED = int(Status.BUDGET_EXCEEDED)
NON_FINITE = int(Status.NON_FINITE)
AFTER_THE_END = 100_000  # events after the end within which counted flights must land
# Periods after the end within which the lift-off of resting particles is awaited: if the base lifts
# them without further impacts, it does so within one period
PATIENCE = 1.0
SAME_INSTANT = 2.0**-50  # periods; two sums of the same time and phase differ by less


class Coupled(NamedTuple):
    """Realizations, their mounts and launches."""

    problem: Dimensionless
    mounts: Mounts
    launches: Launches


class PerRealization(NamedTuple):
    """Results with one number per realization."""

    separations: Separations
    order: Orders
    # Decisions between bouncing and sticking, landing and grazing, or on the order of two landings,
    # that rounding may have made; shape (realization,)
    undecided: Integers


def empty_per_realization(realizations: int) -> PerRealization:
    """Allocate the results of realizations."""
    separations, order = empty_separations(realizations), empty_orders(realizations)
    return PerRealization(separations, order, unwritten(realizations, np.int64))


@jit
def _listed(state: System, event: Event, begin: Instant, least: float) -> Listed:
    """List a landing that happens now; the stay of a particle that rests is infinite so far."""
    n, x = state.now[NOW.N], state.now[NOW.X]
    seen = begin.whole - n <= x - begin.phase
    stay = np.inf if event.kind == EVENT.STICK else least
    return Listed(n, x, stay, float(event.who if seen else -1 - event.who))


@part
def _launched_at_the_end(
    work: Work, load: Load, left: float, launch_speed: float, first: int, launch_height: Floats
) -> None:
    """Count launches at the end, `left` from now, which rounding puts slightly after it."""
    state = work.state
    motion = motion_after(state, load, left)
    height = state.now[NOW.HEIGHT] + state.now[NOW.SPEED] * left + motion.rise
    speed = state.now[NOW.SPEED] + motion.gain
    for j in range(state.mode.size):
        if state.mode[j] == MODE.WAITING and since_now(state, j) - left <= SAME_INSTANT:
            launch_height[first + j] = apex(height, speed, launch_speed - speed)


@part
def _write(work: Work, event: Event, first: int, scale: Scale, out: Record) -> None:
    """Write a landing, and the lift-off of a particle that bounces."""
    now = work.state.now
    k, sticks = work.landings.total[event.who] - 1, event.kind == EVENT.STICK
    write_landing(out, first + event.who, k, scale, now[NOW.N], now[NOW.X], sticks)
    if not sticks:
        _write_lift_off(work, event.who, first, scale, out)


@part
def _write_lift_off(work: Work, j: int, first: int, scale: Scale, out: Record) -> None:
    """Write the lift-off of particle j after its last landing."""
    now = work.state.now
    speed = now[NOW.SPEED] + work.state.particle[PARTICLE.SPEED, j]
    k = work.landings.total[j] - 1
    write_lift_off(out, first + j, k, scale, now[NOW.N], now[NOW.X], speed)


@part
def _lift_off(
    work: Work, first: int, least: float, counts: bool, scale: Scale, out: Record
) -> None:
    """Let the riders leave; if this `counts`, begin their flights and write their lift-off.

    A stay lasts at least the contact time, `least`.
    """
    for j in range(work.rides.size):
        if work.rides[j] == 1 and counts:
            end_stay(work.state, work.landings, j, least)
            take_off(work, j)
            _write_lift_off(work, j, first, scale, out)
        work.rides[j] = 0


@part
def _conclude(work: Work, noted: Noted, complete: bool, i: int, out: PerRealization) -> None:
    """Write the results of a realization; `complete` if all landings up to the end were found."""
    shared = noted.shared if complete else UNKNOWN
    write_separations(out.separations, i, noted.gap, noted.same, shared)
    write_order(out.order, i, work.landings.turns, noted.order, complete)
    out.undecided[i] = int(work.state.now[NOW.UNDECIDED])


@jit
def _any(flags: Integers) -> bool:
    """Return whether any particle has the flag."""
    number = 0
    for flag in flags:
        number += flag
    return number > 0


@jit
def _horizon(work: Work, until: float, past: bool) -> float:
    """Return the time within which to search for the next event; minus infinity for no search."""
    if not past:
        return until
    if _any(work.flies):
        return np.inf
    return until + PATIENCE if until >= -PATIENCE and _any(work.rides) else -np.inf


@jit
def _scale(problem: Dimensionless, units: Units, i: int) -> Scale:
    """Units and origin of time of realization i."""
    return Scale(units.frequency[i], units.velocity[i], problem.end_count[i], problem.phase[i])


@part
def _resting(
    work: Work, load: Load, weighs: bool, first: int, left: float, found: Statistics
) -> None:
    """Note which particles rest for good at the end, which is `left` periods from now.

    They do if the energy of the free oscillation is too small for the base ever to fall faster than
    gravity.  If particles move the base, all of them must rest.
    """
    motion = motion_after(work.state, load, left)
    # the corners of a drive keep exciting a base under a load
    calm = load.riders == 0 or not weighs or until_corner(load.drive, 0.0) == np.inf
    stays = calm and bounds(load, motion.d, motion.b).pull <= 2.0
    if stays and (load.riders == work.rides.size or not weighs):
        for j in range(work.rides.size):
            found.at_rest[first + j] = work.rides[j]
            work.rides[j] = 0  # do not wait for a lift-off


@uncounted
def follow(
    first: int,
    last: int,
    batch: Coupled,
    budget: int,
    work: Work,
    statistics: CoupledStatistics,
    per_realization: PerRealization,
    written: MotionRecord,
) -> int:
    """Follow realizations first ... last - 1 to the end of their windows.

    They are followed further until counted flights have ended, and until particles at rest at the
    end have left the base or have rested for another `PATIENCE`.  A particle may land `budget`
    times; `work` is not shared between threads, and only the slots of these realizations are
    written.  Returns `last`, or the realization that must be repeated with a larger `work`.
    """
    problem, mounts, launches = batch
    found, sums, launch_height, observer = statistics
    state, memory, particles = work.state, work.landings, work.counts.size
    for i in range(first, last):
        fixed, place = mount(problem, mounts, i), i * particles
        load = begin(state, fixed, problem, launches, i)
        begin_statistics(work, place, found, launch_height, observer)
        no_landings(written.record, place, place + particles)
        noted = clear(memory)
        opening = Instant(problem.begin_count[i] - problem.end_count[i], problem.begin_phase[i])
        scale, speed = _scale(problem, written.units, i), problem.launch_flight[i]
        past, events, late = False, 0, 0
        status = COMPLETED if np.isfinite(fixed.alpha) else NON_FINITE
        while status == COMPLETED:
            until = (problem.end_phase[i] - state.now[NOW.X]) - state.now[NOW.N]
            horizon = _horizon(work, until, past)
            if horizon == -np.inf:
                break
            event, load = next_event(state, fixed, load, speed, horizon)
            if event.kind == EVENT.LOST or late >= AFTER_THE_END:
                status = BUDGET_EXCEEDED
                break
            if event.kind == EVENT.NONE or event.kind == EVENT.FINISHED:
                if past:
                    break
                left, past = max(until, 0.0), True
                noted = close(memory, noted, opening)
                _launched_at_the_end(work, load, left, speed, place, launch_height)
                _resting(work, load, fixed.mu > 0.0, place, left, found)
                continue
            left = (problem.end_phase[i] - state.now[NOW.X]) - state.now[NOW.N]
            if event.kind == EVENT.LAUNCH:
                if not past:
                    take_off(work, event.who)
                    launch_height[place + event.who] = work.lifted[2, event.who]
            elif event.kind == EVENT.BOUNCE or event.kind == EVENT.STICK:
                landing = _listed(state, event, opening, fixed.r)
                seen = landing.who >= 0.0
                if not past and memory.total[event.who] >= budget:
                    status = BUDGET_EXCEEDED
                    break
                if not past and lacks_memory(memory, event.who, seen):
                    return i
                count_landing(work, event, seen and not past, place + event.who, found, observer)
                if not past:
                    noted = note(memory, noted, landing, seen and left <= 1.0, opening)
                    if event.kind != EVENT.STICK:
                        take_off(work, event.who)
                    _write(work, event, place, scale, written.record)
            if not past:
                write_base(state, load, scale, i, events, written.track)
            if event.kind == EVENT.LIFT or event.dropped:
                _lift_off(work, place, fixed.r, left >= -PATIENCE, scale, written.record)
            if event.kind == EVENT.STICK and not past:
                work.rides[event.who] = 1
            events, late = events + 1, late + (1 if past else 0)
        judge(place, particles, status, found)
        add_up(found.kinds, i, particles, found, sums)
        _conclude(work, noted, found.status[place] == COMPLETED, i, per_realization)
    return last


# Machine code for an observer that only this process has is not kept on disk
follow_uncached = uncached(follow)
