"""Advance realizations with a base of finite mass: statistics, and every landing if requested."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels import ordering, record
from vibrosweep.kernels._jit import Floats, Integers, jit, part, uncached, uncounted
from vibrosweep.kernels.bases import Counted, Instant, sprung
from vibrosweep.kernels.bases.sprung import Load
from vibrosweep.kernels.coupled.events import (
    EVENT,
    MODE,
    NOW,
    PARTICLE,
    Event,
    System,
    begin,
    motion_after,
    next_event,
    since_now,
    system,
)
from vibrosweep.kernels.memory import unwritten
from vibrosweep.kernels.ordering import Listed, Order, Orders, Turns
from vibrosweep.kernels.record import Record, Scale, Units
from vibrosweep.kernels.separation import UNKNOWN, Separations, empty_separations, write_separations
from vibrosweep.kernels.statistics import (
    Kinds,
    Observer,
    Statistics,
    add_event,
    add_up,
    empty_statistics,
    empty_sums,
    flight_sums,
    reset,
)
from vibrosweep.model.measures import Status
from vibrosweep.model.observables import Landing
from vibrosweep.model.parameters import Dimensionless, Launches, Mounts

# --- Landings in the order of time: separations and order -----------------------------------------


INDICES = 256  # impact numbers remembered at first
MOST_INDICES = 2**22


class Landings(NamedTuple):
    """The landings that are remembered; not shared between threads."""

    turns: Turns
    # How long each particle stays on the base after its last landing, at least the contact time;
    # infinite while it rests
    stay: Floats
    total: Integers  # landings of each particle since its launch
    # Last landing in the window with an impact number: whole periods, phase, and particle; shape
    # (3, place)
    numbered: Floats
    number: Integers  # the impact number that stands in each place, 0 for none


class Noted(NamedTuple):
    """Separations and order so far."""

    # gap, same: smallest separation of landings of different particles, and of those with the same
    # impact number
    gap: float
    same: float
    shared: int  # 1 where two particles were on the base at once in the window
    seen: bool  # True if the last landing was in the window
    order: Order


def landings(particles: int, indices: int = INDICES) -> Landings:
    """Allocate memory of landings, for `indices` impact numbers."""
    stay, numbered = np.zeros(particles), np.zeros((3, indices))
    total, number = np.zeros(particles, np.int64), np.zeros(indices, np.int64)
    return Landings(ordering.empty_turns(particles), stay, total, numbered, number)


@jit
def clear(memory: Landings) -> Noted:
    """Discard all landings."""
    for j in range(memory.total.size):
        memory.total[j] = 0
    for place in range(memory.number.size):
        memory.number[place] = 0
    return Noted(np.inf, np.inf, 0, False, ordering.no_order(memory.turns))


@jit
def _displaced(memory: Landings, mine: int) -> bool:
    """Return whether landing number `mine` displaces a number that a particle has yet to reach."""
    there = memory.number[mine % memory.number.size]
    if there in (0, mine):
        return False
    least = there
    for total in memory.total:
        least = min(least, total)
    return bool(least < there)


@jit
def lacks_memory(memory: Landings, who: int, seen: bool) -> bool:
    """Return whether the next landing of particle `who` needs more memory.

    Results do not depend on the initial memory, which grows up to `MOST_INDICES`; beyond that the
    separation is undetermined.
    """
    return seen and memory.number.size < MOST_INDICES and _displaced(memory, memory.total[who] + 1)


@jit
def _numbered(memory: Landings, landing: Listed, mine: int, gap: float) -> float:
    """Compare landing number `mine` of a particle with the previous landing of that number.

    Returns the smallest separation so far; NaN, from then on, if a landing is no longer remembered.
    Independent particles are simulated number by number (`vibrosweep.kernels.separation`), which
    needs no memory of other numbers.  Coupled particles land in the order of time, so that a number
    is remembered until all particles have reached it.
    """
    place, numbered = mine % memory.number.size, memory.numbered
    if memory.number[place] == mine:
        before = Listed(numbered[0, place], numbered[1, place], 0.0, numbered[2, place])
        gap, _ = ordering.neighbours(before, landing, gap, 0)
    elif _displaced(memory, mine):
        return np.nan
    numbered[0, place], numbered[1, place] = landing.whole, landing.phase
    numbered[2, place], memory.number[place] = landing.who, mine
    return gap


@jit
def _last_of(memory: Landings, j: int) -> Listed:
    """Return the last landing of particle j, in the window or before."""
    last = memory.turns.last
    return Listed(last[0, j], last[1, j], memory.stay[j], float(j))


@jit
def _occupants(memory: Landings, begin: Instant) -> tuple[Listed, int]:
    """Return a particle that is on the base as the window begins, and whether there is another."""
    before, shared = ordering.no_landing(), 0
    for j in range(memory.total.size):
        if ordering.has_landed(memory.turns, j):
            occupant = ordering.in_window(_last_of(memory, j), begin)
            if occupant.whole < np.inf:
                _, shared = ordering.neighbours(before, occupant, np.inf, shared)
                before = occupant
    return before, shared


@jit
def close(memory: Landings, noted: Noted, begin: Instant) -> Noted:
    """Note the end of the window; without a landing in it, the base may still be shared."""
    gap, same, shared, seen, order = noted
    if not seen:
        _, shared = _occupants(memory, begin)
    return Noted(gap, same, shared, seen, order)


@jit  # as a `part` it would make the loop that calls it a sixth slower
def note(memory: Landings, noted: Noted, landing: Listed, late: bool, begin: Instant) -> Noted:
    """Note a landing; `late` is True if it is in the last period of the window."""
    seen = landing.who >= 0.0
    who = int(ordering.particle_of(landing.who))
    gap, shared, same = noted.gap, noted.shared, noted.same
    memory.total[who] += 1
    if seen:
        if noted.seen:
            before = _last_of(memory, ordering.latest(memory.turns))
        else:
            before, shared = _occupants(memory, begin)
        gap, shared = ordering.neighbours(before, landing, gap, shared)
        same = _numbered(memory, landing, memory.total[who], same)
    memory.stay[who] = landing.stay
    order = ordering.note_turn(memory.turns, noted.order, landing, late)
    return Noted(gap, same, shared, seen, order)


@jit
def end_stay(state: System, memory: Landings, who: int, least: float) -> None:
    """Note that particle `who` leaves the base, now."""
    last = memory.turns.last
    stayed = (state.now[NOW.N] - last[0, who]) + (state.now[NOW.X] - last[1, who])
    memory.stay[who] = max(stayed, least)


# --- Statistics -----------------------------------------------------------------------------------


NON_FINITE = int(Status.NON_FINITE)


class CoupledStatistics(NamedTuple):
    """Statistics of particles, ordered by realization, and of realizations."""

    particles: Statistics
    realizations: Statistics
    launch_height: Floats  # greatest height after each particle's launch; -inf if after the end
    observer: Observer | None  # called for each landing in the window


def empty_coupled(
    realizations: int, particles: int, kinds: Kinds, observer: Observer | None
) -> CoupledStatistics:
    """Allocate the statistics of a batch."""
    by_particle = empty_statistics(realizations * particles, kinds)
    sums = empty_sums(realizations, kinds)
    return CoupledStatistics(by_particle, sums, unwritten(by_particle.status.size), observer)


class Work(NamedTuple):
    """Scratch memory of one thread."""

    state: System  # state of the realization
    landings: Landings  # those that are remembered
    # Whole periods and phase of the last lift-off of each particle, and the greatest height of the
    # flight that began with it, in g / (8 f^2); shape (3, particle)
    lifted: Floats
    # counts, flies, rides: for each particle, 1 where its last landing is in the window, where its
    # flight counts, and where it has rested since a landing up to the end
    counts: Integers
    flies: Integers
    rides: Integers


def work_for(particles: int) -> Work:
    """Allocate scratch memory for one thread."""
    counts, flies, rides = (np.zeros(particles, np.int64) for _ in range(3))
    lifted = np.zeros((3, particles))
    return Work(system(particles), landings(particles), lifted, counts, flies, rides)


def more_numbers(work: Work) -> Work:
    """Return scratch memory for twice as many impact numbers."""
    memory = landings(work.counts.size, 2 * work.landings.number.size)
    return work._replace(landings=memory)


@part
def begin_statistics(
    work: Work,
    first: int,
    by_particle: Statistics,
    launch_height: Floats,
    observer: Observer | None,
) -> None:
    """Reset the statistics of the particles in the places from `first` on."""
    for j in range(work.counts.size):
        t = first + j
        work.counts[j] = work.flies[j] = work.rides[j] = 0
        reset(by_particle.kinds, by_particle.totals, t)
        by_particle.at_rest[t] = 0
        launch_height[t] = -np.inf
        if observer is not None:
            observer.totals[t] = observer.initial


@jit
def apex(height: float, speed: float, relative: float) -> float:
    """Return the greatest height of a flight, in g / (8 f^2).

    It begins on a base of this height and speed, in g / (2 f^2) and g / (2 f), with the speed
    `relative` to the base.
    """
    u = speed + relative
    # a particle that falls, or that the base pushes at once, is highest where its flight begins
    rises = u > 0.0 and relative >= 0.0
    return 4.0 * height + (u * u if rises else 0.0)


@jit
def _flight_time(work: Work, j: int) -> float:
    """Return the time since the last lift-off of particle j."""
    whole = work.state.now[NOW.N] - work.lifted[0, j]
    return float(whole + (work.state.now[NOW.X] - work.lifted[1, j]))


@part
def take_off(work: Work, j: int) -> None:
    """Begin the flight of particle j; it counts if the landing before it did."""
    state = work.state
    work.lifted[0, j], work.lifted[1, j] = state.now[NOW.N], state.now[NOW.X]
    speed = state.particle[PARTICLE.SPEED, j]
    work.lifted[2, j] = apex(state.now[NOW.HEIGHT], state.now[NOW.SPEED], speed)
    work.flies[j] = work.counts[j]


@part
def count_landing(
    work: Work, event: Event, seen: bool, t: int, by_particle: Statistics, observer: Observer | None
) -> None:
    """Count a landing, if it is `seen`, and the flight that ends with it, in place t."""
    j, sticks = event.who, event.kind == EVENT.STICK
    time, speed = _flight_time(work, j), work.state.particle[PARTICLE.SPEED, j]
    landing = Landing(work.state.now[NOW.X], time, event.speed, 0.0 if sticks else speed, sticks)
    flight = Counted(time, work.lifted[2, j], 1.0)
    add_event(by_particle.kinds, by_particle.totals, t, landing, flight, seen, work.flies[j] == 1)
    work.flies[j], work.counts[j] = 0, 1 if seen else 0
    if observer is not None and seen:
        observer.function(observer.totals[t], landing)


@jit
def judge(first: int, particles: int, status: int, by_particle: Statistics) -> None:
    """Write the worst status of the particles for all of them, because they are coupled."""
    for t in range(first, first + particles):
        if not np.isfinite(flight_sums(by_particle.kinds, by_particle.totals, t)):
            status = NON_FINITE
    for t in range(first, first + particles):
        by_particle.status[t] = status


# --- The motion of the base -----------------------------------------------------------------------


class EventStates(NamedTuple):
    """Motion of the base after every event, each array of shape (realization, event)."""

    time: Floats  # s; NaN past the last event
    # deviation, beyond: deviation from the forced oscillation under the present load, in
    # g / (2 f^2), and its velocity beyond that of slow decay, in g / (2 f)
    deviation: Floats
    beyond: Floats
    riders: Integers  # how many particles ride
    side: Floats  # of the drive


class MotionRecord(NamedTuple):
    """Record of every landing and of the motion of the base, as far as its arrays reach."""

    record: Record
    track: EventStates
    units: Units


def empty_track(realizations: int, events: int) -> EventStates:
    """Allocate the motion up to so many events of each realization."""
    time, deviation, beyond, side = (np.full((realizations, events), np.nan) for _ in range(4))
    return EventStates(time, deviation, beyond, unwritten((realizations, events), np.int64), side)


@part
def write_base(
    state: System, load: Load, scale: Scale, i: int, event: int, out: EventStates
) -> None:
    """Write the motion of the base after an event of realization i."""
    if event < out.time.shape[1]:
        out.time[i, event] = record.seconds(scale, state.now[NOW.N], state.now[NOW.X])
        out.deviation[i, event], out.beyond[i, event] = state.now[NOW.D], state.now[NOW.B]
        out.riders[i, event], out.side[i, event] = load.riders, sprung.side_of(load.drive)


@uncounted
def trace(
    problem: Dimensionless,
    mounts: Mounts,
    scale: Scale,
    i: int,
    track: EventStates,
    times: Floats,
    out: Floats,
) -> None:
    """Write the height and velocity of the base of realization i at increasing times.

    Times in s, none before the first event; `out` is of shape (2, time), in g / (2 f^2) and
    g / (2 f).
    """
    fixed, event = sprung.mount(problem, mounts, i), 0
    for k in range(times.size):
        while event + 1 < track.time.shape[1] and track.time[i, event + 1] <= times[k]:
            event += 1
        load = sprung.loaded(fixed, track.riders[i, event], track.side[i, event])
        turns = scale.frequency * track.time[i, event] + scale.phase
        at = sprung.phase_of(turns - np.rint(turns))
        d, b = track.deviation[i, event], track.beyond[i, event]
        passed = scale.frequency * (times[k] - track.time[i, event])
        motion, forced = sprung.move(load, at, d, b, passed), sprung.forced_motion(load.drive, at)
        speed = forced.speed + sprung.velocity(load, d, b)
        out[0, k] = (forced.height + load.level + d) + speed * passed + motion.rise
        out[1, k] = speed + motion.gain


COMPLETED = int(Status.COMPLETED)
BUDGET_EXCEEDED = int(Status.BUDGET_EXCEEDED)
AFTER_THE_END = 100_000  # events after the end within which counted flights must land
# Periods after the end within which resting particles are simulated until they lift off: if the
# base lifts them without further impacts, it does so within one period
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
    separations, order = empty_separations(realizations), ordering.empty_orders(realizations)
    return PerRealization(separations, order, unwritten(realizations, np.int64))


@jit
def _listed(state: System, event: Event, begin: Instant, least: float) -> Listed:
    """List a landing that happens now; the stay of a particle that rests is infinite so far."""
    n, x = state.now[NOW.N], state.now[NOW.X]
    seen = begin.whole - n <= x - begin.phase
    stay = np.inf if event.kind == EVENT.STICK else least
    return Listed(n, x, stay, float(event.who) if seen else ordering.before_window(event.who))


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
    record.write_landing(out, first + event.who, k, scale, now[NOW.N], now[NOW.X], sticks)
    if not sticks:
        _write_lift_off(work, event.who, first, scale, out)


@part
def _write_lift_off(work: Work, j: int, first: int, scale: Scale, out: Record) -> None:
    """Write the lift-off of particle j after its last landing."""
    now = work.state.now
    speed = now[NOW.SPEED] + work.state.particle[PARTICLE.SPEED, j]
    k = work.landings.total[j] - 1
    record.write_lift_off(out, first + j, k, scale, now[NOW.N], now[NOW.X], speed)


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
    ordering.write_order(out.order, i, work.landings.turns, noted.order, complete)
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
    calm = load.riders == 0 or not weighs or sprung.until_corner(load.drive, 0.0) == np.inf
    stays = calm and sprung.bounds(load, motion.d, motion.b).pull <= 2.0
    if stays and (load.riders == work.rides.size or not weighs):
        for j in range(work.rides.size):
            found.at_rest[first + j] = work.rides[j]
            work.rides[j] = 0  # do not wait for a lift-off


@uncounted
def advance_coupled(
    first: int,
    last: int,
    batch: Coupled,
    budget: int,
    work: Work,
    statistics: CoupledStatistics,
    per_realization: PerRealization,
    written: MotionRecord,
) -> int:
    """Simulate realizations first ... last - 1 to the end of their windows.

    They are continued until counted flights have ended, and until particles at rest at the
    end have left the base or have rested for another `PATIENCE`.  A particle may land `budget`
    times; `work` is not shared between threads, and only the slots of these realizations are
    written.  Returns `last`, or the realization that must be repeated with a larger `work`.
    """
    problem, mounts, launches = batch
    found, sums, launch_height, observer = statistics
    state, memory, particles = work.state, work.landings, work.counts.size
    for i in range(first, last):
        fixed, place = sprung.mount(problem, mounts, i), i * particles
        load = begin(state, fixed, problem, launches, i)
        begin_statistics(work, place, found, launch_height, observer)
        record.no_landings(written.record, place, place + particles)
        noted = clear(memory)
        opening = Instant(problem.begin_count[i] - problem.end_count[i], problem.begin_phase[i])
        scale, speed = record.scale_of(problem, written.units, i), problem.launch_flight[i]
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


# Machine code for an observer that only this process has is not saved on disk
advance_coupled_uncached = uncached(advance_coupled)
