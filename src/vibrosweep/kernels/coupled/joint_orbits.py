"""The orbit on which the joint state of all particles and their base settles, and its exponent.

The state recurs when all of it returns bit for bit, apart from whole periods.  At landings it is
compared with a stored state, which is renewed after 1, 2, 4, ... landings (Brent 1980).  Every
landing advances the states of all particles, with rounding, so that the bits of an orbit of one
period may return only after three.  A cycle that consists of several rounds which differ by
rounding only is therefore reported as one such round.  Particles that move as one may land
in any order, so that no state is stored between their landings.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from vibrosweep.kernels import arithmetic
from vibrosweep.kernels._jit import Floats, Integers, jit, part, uncounted
from vibrosweep.kernels.arithmetic import cos_turns, sin_turns
from vibrosweep.kernels.bases import sprung
from vibrosweep.kernels.bases.sprung import Load, Mount
from vibrosweep.kernels.coupled.events import (
    EVENT,
    MODE,
    NOW,
    PARTICLE,
    Event,
    System,
    acceleration,
    begin,
    next_event,
    phase_now,
    system,
)
from vibrosweep.kernels.coupled.realizations import Coupled
from vibrosweep.kernels.memory import unwritten
from vibrosweep.kernels.restitution import ratio, slope

# --- Small deviations from the joint state --------------------------------------------------------
# The rows of a deviation are the height of each particle, the velocity of each particle, and height
# and velocity of the base.  Between impacts it follows the linear flow.  An impact changes it by
# the saltation matrix (Aizerman & Gantmakher 1958): the impact is delayed by (dy - dY) / c, where c
# is the speed of approach.  Riders have the deviation of the base.  When all riders lift off
# together, accelerations are continuous and the deviation does not change; neither does it at a
# corner of the drive, whose time does not deviate.


@part
def _ride(mode: Integers, deviations: Floats) -> None:
    """Set the deviations of the riders to that of the base."""
    particles = mode.size
    for j in range(particles):
        if mode[j] == MODE.RIDING:
            for column in range(deviations.shape[1]):
                deviations[j, column] = deviations[2 * particles, column]
                deviations[particles + j, column] = deviations[2 * particles + 1, column]


@part
def propagate(load: Load, t: float, mode: Integers, deviations: Floats) -> None:
    """Propagate deviations for the time t, during which particles have this `mode`."""
    particles = mode.size
    rise, gain, _, _ = sprung.free_motion(load, 1.0, load.slow, t)
    rise_v, gain_v, _, _ = sprung.free_motion(load, 0.0, 1.0, t)
    for column in range(deviations.shape[1]):
        deviation = deviations[:, column]
        for j in range(particles):
            deviation[j] += t * deviation[particles + j]
        y, v = deviation[2 * particles], deviation[2 * particles + 1]
        deviation[2 * particles] = y * (1.0 + rise) + v * (t + rise_v)
        deviation[2 * particles + 1] = y * gain + v * (1.0 + gain_v)
    _ride(mode, deviations)


@jit
def _pull(state: System, fixed: Mount, load: Load, speed: float) -> float:
    """Acceleration of the base now, at this velocity and under a load."""
    bare, count = sprung.loaded(fixed, 0, sprung.side_of(load.drive)), load.riders
    driven = sprung.forcing(bare.drive, phase_now(state), bare.stiffness, bare.drag)
    free = driven - 2.0 * bare.drag * speed - bare.stiffness * state.now[NOW.HEIGHT]
    return float((free - 2.0 * count * fixed.mu) / (1.0 + count * fixed.mu))


@part
def _impact(
    state: System,
    fixed: Mount,
    before: Load,
    after: Load,
    event: Event,
    rode: Integers,
    deviations: Floats,
) -> None:
    """Change deviations by an impact that has happened.

    `before`, `after`, `rode`: the base before and after it, and the modes before it.
    """
    particles, j, c = state.mode.size, event.who, event.speed
    count, speed = before.riders, state.now[NOW.SPEED]
    (pulls, _), sticks = acceleration(state, after), event.kind == EVENT.STICK
    taking = 0 if event.dropped else count
    q = slope(fixed.law, fixed.e, fixed.scale, c)
    retained = ratio(fixed.law, fixed.e, fixed.scale, c)
    share = sprung.recoil_share(fixed, taking, q, sticks)  # of a change of c that the base loses
    gain = 1.0 - share if sticks else 1.0 + q - share  # and that the particle gains
    kick = sprung.recoil_share(fixed, taking, retained, sticks) * c
    was = speed + kick  # velocity of the base before the impact; that of the particle was c less
    pulled = _pull(state, fixed, before, was)
    for column in range(deviations.shape[1]):
        deviation = deviations[:, column]
        dy, dv = deviation[j], deviation[particles + j]
        base_y, base_v = deviation[2 * particles], deviation[2 * particles + 1]
        delay = (dy - base_y) / c if c > 0.0 else 0.0
        y = base_y + was * delay  # both are at this height at the moment of the impact
        v, w = dv - 2.0 * delay, base_v + pulled * delay
        approach = w - v
        for i in range(particles):
            if event.dropped and rode[i] == MODE.RIDING:  # it keeps its velocity
                deviation[particles + i] = w + 2.0 * delay
        leaves = speed if sticks else speed + retained * c
        deviation[j] = y - leaves * delay
        deviation[particles + j] = v + gain * approach + 2.0 * delay
        deviation[2 * particles] = y - speed * delay
        deviation[2 * particles + 1] = w - share * approach - pulls * delay


@part
def advance_event(
    state: System,
    fixed: Mount,
    load: Load,
    launch_speed: float,
    until: float,
    rode: Integers,
    deviations: Floats,
) -> tuple[Event, Load]:
    """Advance the state to its next event, and deviations with it; see `next_event`.

    Without an event, only bounds of future times change.  `rode` is overwritten with the modes
    before the event.
    """
    particles = state.mode.size
    for j in range(particles):
        rode[j] = state.mode[j]
    event, after = next_event(state, fixed, load, launch_speed, until)
    if event.kind <= EVENT.LOST:
        return event, after
    propagate(load, event.time, rode, deviations)
    if event.kind == EVENT.LAUNCH:
        for column in range(deviations.shape[1]):
            deviations[event.who, column] = deviations[2 * particles, column]
            deviations[particles + event.who, column] = 0.0
    elif event.kind == EVENT.BOUNCE or event.kind == EVENT.STICK:
        _impact(state, fixed, load, after, event, rode, deviations)
    _ride(state.mode, deviations)
    return event, after


# Largest difference between states that counts as rounding, which grows along a cycle before it
# decays.  An orbit of doubled period with two states that close takes some 10**17 impacts to recur.
ALIKE: Final = 2.0**-30
BLOCKS: Final = 16  # of equal time; without an event in one of them there is no exponent
# Waves sin 2 pi j x and (cos 2 pi j x - cos 2 pi (j + 1) x) / sqrt 2 over the window 0 < x < 1;
# their products with the growth give the error of the exponent
SINES: Final = (1.0, 2.0, 3.0, 4.0)
COSINES: Final = (1.0, 3.0)
WAVES: Final = len(SINES) + len(COSINES)


class JointOrbit(NamedTuple):
    """Orbits of joint states; each array of shape (realization,) unless stated otherwise."""

    # impacts, periods, rests: landings of all particles, forcing periods and landings that stick in
    # a cycle; 0 where no recurrence was found
    impacts: Integers
    periods: Integers
    rests: Integers
    since: Floats  # forcing periods after which the state was on the cycle at the latest
    landings: Integers  # in the window
    # Logarithm of the growth of a deviation in each block of the window, NaN if it has no event;
    # shape (realization, block)
    growth: Floats
    waves: Floats  # sums of the growth at each event times a wave; shape (realization, wave)
    at_rest: Integers  # 1 where all particles rest for good


def empty_joint(realizations: int) -> JointOrbit:
    """Allocate the orbits of a batch."""
    counts = (unwritten(realizations, np.int64) for _ in range(5))
    impacts, periods, rests, landings, at_rest = counts
    growth, waves = unwritten((realizations, BLOCKS)), unwritten((realizations, WAVES))
    since = unwritten(realizations)
    return JointOrbit(impacts, periods, rests, since, landings, growth, waves, at_rest)


@jit
def _write_nothing(i: int, out: JointOrbit) -> None:
    """Write realization i as undetermined."""
    out.impacts[i] = out.periods[i] = out.rests[i] = out.landings[i] = out.at_rest[i] = 0
    out.since[i] = np.nan
    for block in range(BLOCKS):
        out.growth[i, block] = np.nan
    for wave in range(WAVES):
        out.waves[i, wave] = 0.0


class Round(NamedTuple):
    """Counts from a state to its return; 0 impacts if no return is known."""

    # impacts, periods, rests: as in `JointOrbit`
    impacts: int
    periods: int
    rests: int


class Notes(NamedTuple):
    """Scratch memory of one thread."""

    # state, stored: state of the realization, and the stored state that it is compared with
    state: System
    stored: System
    rode: Integers  # modes before an event
    deviation: Floats  # shape (2 * particle + 2, 1)


def notes(particles: int) -> Notes:
    """Allocate scratch memory for one thread."""
    rode, deviation = np.zeros(particles, np.int64), np.zeros((2 * particles + 2, 1))
    return Notes(system(particles), system(particles), rode, deviation)


@jit
def _alike(a: System, b: System, within: float) -> bool:
    """Return whether two states differ by whole periods and at most by `within` in all else."""
    turned = a.now[NOW.X] - b.now[NOW.X]
    off = abs(turned - np.rint(turned))
    off = max(off, abs(a.now[NOW.D] - b.now[NOW.D]), abs(a.now[NOW.B] - b.now[NOW.B]))
    for j in range(a.mode.size):
        if off > within or a.mode[j] != b.mode[j] or a.mode[j] == MODE.WAITING:
            return False
        if a.mode[j] == MODE.FLYING:
            scale = max(abs(a.particle[PARTICLE.SCALE, j]), 1.0)
            for row, unit in ((PARTICLE.HEIGHT, scale * scale), (PARTICLE.SPEED, scale)):
                off = max(off, abs(a.particle[row, j] - b.particle[row, j]) / unit)
    return bool(off <= within)


@jit
def _amid(state: System) -> bool:
    """Return whether another particle lands at this instant, to within rounding."""
    for j in range(state.mode.size):
        speed = state.particle[PARTICLE.SPEED, j]
        lands = speed < 0.0 and state.particle[PARTICLE.HEIGHT, j] <= ALIKE * -speed
        if state.mode[j] == MODE.FLYING and lands:
            return True
    return False


@jit
def _since(state: System, stored: System, landings: int, rests: int) -> Round:
    """Return the counts since a state was stored."""
    whole = state.now[NOW.N] - stored.now[NOW.N]
    return Round(landings, int(np.rint(whole + (state.now[NOW.X] - stored.now[NOW.X]))), rests)


@jit
def _shortest(full: Round, first: Round) -> Round:
    """Return `first`, the first round that is alike, if `full` repeats it; else `full`."""
    times = full.impacts // first.impacts if first.impacts > 0 else 0
    whole = times * first.impacts == full.impacts and times * first.periods == full.periods
    return first if whole and times * first.rests == full.rests else full


@jit
def _store(state: System, stored: System) -> None:
    """Copy a state."""
    for j in range(state.mode.size):
        stored.mode[j] = state.mode[j]
        for row in range(state.particle.shape[0]):
            stored.particle[row, j] = state.particle[row, j]
    for place in range(state.now.size):
        stored.now[place] = state.now[place]


@jit
def _shrink(deviation: Floats) -> float:
    """Scale a deviation to length 1; return the logarithm of its length before."""
    square = 0.0
    for row in range(deviation.shape[0]):
        square += deviation[row, 0] * deviation[row, 0]
    length = math.sqrt(square)
    if not 0.0 < length < np.inf:
        return -np.inf if length == 0.0 else np.nan
    for row in range(deviation.shape[0]):
        deviation[row, 0] /= length
    return arithmetic.log(length)


@jit
def _add_waves(growth: float, x: float, waves: Floats) -> None:
    """Add the growth at the place x of the window times each wave to the sums."""
    for k in range(len(SINES)):
        waves[k] += growth * sin_turns(SINES[k] * x - np.rint(SINES[k] * x))
    for k in range(len(COSINES)):
        slow, fast = COSINES[k] * x, (COSINES[k] + 1.0) * x
        wave = cos_turns(slow - np.rint(slow)) - cos_turns(fast - np.rint(fast))
        waves[len(SINES) + k] += growth * wave / math.sqrt(2.0)


@part
def _settle(
    fixed: Mount, batch: Coupled, i: int, budget: int, work: Notes, out: JointOrbit
) -> None:
    """Simulate realization i to the end of its window."""
    state, stored, rode, deviation = work
    problem = batch.problem
    load = begin(state, fixed, problem, batch.launches, i)
    start = (problem.begin_count[i] - problem.end_count[i]) + problem.begin_phase[i]
    length = problem.end_phase[i] - start
    for row in range(deviation.shape[0]):
        deviation[row, 0] = 1.0
    growth, landed, rests, mark, seen_at, rested = 0.0, 0, 0, 1, 0, 0
    nothing = Round(0, 0, 0)
    first = nothing
    _store(state, stored)
    while landed <= budget:  # one more event may show that all rest for good
        until = (problem.end_phase[i] - state.now[NOW.X]) - state.now[NOW.N]
        event, load = advance_event(
            state, fixed, load, problem.launch_flight[i], until, rode, deviation
        )
        if event.kind == EVENT.FINISHED:
            out.at_rest[i] = 1
        if event.kind <= EVENT.LOST:
            break
        if event.kind == EVENT.CORNER:
            continue
        growth = _shrink(deviation)
        passed = state.now[NOW.N] + state.now[NOW.X] - start
        place = math.floor(BLOCKS * passed / length)
        if 0 <= place < BLOCKS:
            _add_waves(growth, passed / length, out.waves[i])
            before = out.growth[i, place]
            out.growth[i, place] = growth if np.isnan(before) else before + growth
        if not np.isfinite(growth):
            break
        if event.kind != EVENT.BOUNCE and event.kind != EVENT.STICK:
            continue
        landed += 1
        rests += 1 if event.kind == EVENT.STICK else 0
        out.landings[i] += 1 if place >= 0 else 0
        if out.impacts[i] == 0 and _alike(state, stored, ALIKE):
            full = _since(state, stored, landed - seen_at, rests - rested)
            first = full if first.impacts == 0 else first
            if _alike(state, stored, 0.0):
                out.impacts[i], out.periods[i], out.rests[i] = _shortest(full, first)
                out.since[i] = (
                    stored.now[NOW.N]
                    + problem.end_count[i]
                    + (stored.now[NOW.X] - problem.phase[i])
                )
        if landed >= mark and not _amid(state):
            _store(state, stored)
            first = nothing
            mark, seen_at, rested = 2 * landed, landed, rests


@uncounted
def settle_jointly(
    first: int, last: int, batch: Coupled, budget: int, work: Notes, out: JointOrbit
) -> None:
    """Find the orbits of realizations first ... last - 1 until the end of their windows.

    The search ends after `budget` landings of all particles of a realization; `work` is not shared
    between threads, and only the slots of these realizations are written.
    """
    for i in range(first, last):
        _write_nothing(i, out)
        fixed = sprung.mount(batch.problem, batch.mounts, i)
        if np.isfinite(fixed.alpha):
            _settle(fixed, batch, i, budget, work, out)
