"""Events of particles on a base of finite mass, in the order of time."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, Integers, fma, jit, part
from vibrosweep.kernels.bases import sprung
from vibrosweep.kernels.bases.sprung import Bounds, Load, Motion, Mount, Phase
from vibrosweep.kernels.impact import land, launch
from vibrosweep.kernels.noise import draw_of, noisy_rebound, noisy_restitution
from vibrosweep.kernels.restitution import ratio
from vibrosweep.model.parameters import Dimensionless, Launches

# --- State ----------------------------------------------------------------------------------------
# Heights above the base and speeds relative to it keep their relative accuracy while a particle
# chatters.  Whole periods and phase are stored separately, as everywhere.


class Particle(NamedTuple):
    """Rows of the quantities of a particle."""

    HEIGHT: int  # above the base
    SPEED: int  # relative to it
    SAFE: int  # lower bound of the time from now to its landing or launch; infinite for a rider
    ABOVE: int  # time from now at which it falls to the greatest height of the base
    SCALE: int  # speed relative to the base at its lift-off
    N: int  # whole periods and phase of its launch, then of its last lift-off
    X: int
    IMPACTS: int  # so far


class Now(NamedTuple):
    """Places of the quantities of the realization."""

    N: int  # whole periods and phase
    X: int
    SINE: int  # of the phase
    COSINE: int
    D: int  # deviation of the base from its forced oscillation
    B: int  # velocity of the deviation beyond that of slow decay
    HEIGHT: int  # of the base, and its velocity
    SPEED: int
    HIGHEST: int  # upper bound of the height of the base
    LIFT: int  # lower bound of the time from now to the lift-off of the riders
    WAITING: int  # number of particles not launched yet
    UNDECIDED: int  # number of decisions that rounding may have changed


class Mode(NamedTuple):
    """Modes of a particle."""

    WAITING: int
    FLYING: int
    RIDING: int


class EventKinds(NamedTuple):
    """Kinds of events."""

    NONE: int  # no event up to the given time
    FINISHED: int  # no event ever: all particles rest for good
    LOST: int  # the search was abandoned
    LAUNCH: int
    BOUNCE: int
    STICK: int
    LIFT: int  # all riders leave
    CORNER: int  # the drive passes a corner of its velocity


PARTICLE = Particle(*range(len(Particle._fields)))
NOW = Now(*range(len(Now._fields)))
MODE = Mode(*range(len(Mode._fields)))
EVENT = EventKinds(*range(len(EventKinds._fields)))


class System(NamedTuple):
    """State of a realization."""

    particle: Floats  # shape (row of `PARTICLE`, particle)
    now: Floats  # numbers of the realization, by `NOW`
    mode: Integers  # one of `MODE` for each particle


class Event(NamedTuple):
    """The next event."""

    kind: int  # one of `EVENT`
    who: int  # the particle; -1 for all riders, or where no particle takes part
    time: float  # since the previous event, in forcing periods
    speed: float  # approach speed of a landing
    dropped: bool  # True if its recoil made the riders leave


def system(particles: int) -> System:
    """Allocate the state of a realization."""
    return System(
        np.zeros((len(Particle._fields), particles)),
        np.zeros(len(Now._fields)),
        np.zeros(particles, np.int64),
    )


@part
def begin(state: System, fixed: Mount, problem: Dimensionless, launches: Launches, i: int) -> Load:
    """Set realization i to its first launch; whole periods count from the end of the window.

    Returns the base without riders.
    """
    particle, now, mode = state
    first = 0
    for j in range(mode.size):
        n, x = launch(launches, i, j, problem.phase[i])
        particle[PARTICLE.N, j], particle[PARTICLE.X, j] = n - problem.end_count[i], x
        mode[j] = MODE.WAITING
        for row in (PARTICLE.HEIGHT, PARTICLE.SPEED, PARTICLE.ABOVE, PARTICLE.SCALE):
            particle[row, j] = 0.0
        particle[PARTICLE.IMPACTS, j] = 0.0
        if _between(particle, j, first) < 0.0:
            first = j
    for k in range(now.size):
        now[k] = 0.0
    now[NOW.N], now[NOW.X] = particle[PARTICLE.N, first], particle[PARTICLE.X, first]
    now[NOW.LIFT], now[NOW.WAITING] = np.inf, mode.size
    for j in range(mode.size):
        particle[PARTICLE.SAFE, j] = _between(particle, j, first)
    load = sprung.loaded(fixed, 0, sprung.side_at(fixed.waveform, now[NOW.X]))
    locate(state, load)
    return load


@jit
def _between(particle: Floats, j: int, first: int) -> float:
    """Return the time from the instant of one particle to that of another."""
    whole = particle[PARTICLE.N, j] - particle[PARTICLE.N, first]
    return float(whole + (particle[PARTICLE.X, j] - particle[PARTICLE.X, first]))


@jit
def locate(state: System, load: Load) -> None:
    """Find height and velocity of the base from its phase and deviation."""
    now = state.now
    at = sprung.phase_of(now[NOW.X])
    now[NOW.SINE], now[NOW.COSINE] = at.sine, at.cosine
    forced = sprung.forced_motion(load.drive, at)
    now[NOW.HEIGHT] = forced.height + load.level + now[NOW.D]
    now[NOW.SPEED] = forced.speed + sprung.velocity(load, now[NOW.D], now[NOW.B])


@jit
def phase_now(state: System) -> Phase:
    """Return the phase now."""
    return Phase(state.now[NOW.X], state.now[NOW.SINE], state.now[NOW.COSINE])


@part
def motion_after(state: System, load: Load, t: float) -> Motion:
    """Return the motion of the base after the time t from now."""
    now = state.now
    return sprung.move(load, phase_now(state), now[NOW.D], now[NOW.B], t)


@jit
def acceleration(state: System, load: Load) -> tuple[float, float]:
    """Return the acceleration of the base now, and its rate."""
    forced = sprung.forced_motion(load.drive, phase_now(state))
    free, rate = sprung.free_pull(load, state.now[NOW.D], state.now[NOW.B])
    return free + forced.pull, rate + forced.jerk


@part
def let_pass(state: System, load: Load, t: float) -> Motion:
    """Advance by the time t without an event; return the motion of the base."""
    particle, now, mode = state
    motion = motion_after(state, load, t)
    now[NOW.X], passed = land(now[NOW.X], t)
    now[NOW.N] += passed
    now[NOW.D], now[NOW.B] = motion.d, motion.b
    now[NOW.LIFT] -= t
    locate(state, load)
    for j in range(mode.size):  # also if not flying: height and speed are set again at the lift-off
        w = particle[PARTICLE.SPEED, j]
        particle[PARTICLE.HEIGHT, j] = fma(t, w - t, particle[PARTICLE.HEIGHT, j]) - motion.rise
        particle[PARTICLE.SPEED, j] = w - 2.0 * t - motion.gain
        particle[PARTICLE.SAFE, j] -= t
        particle[PARTICLE.ABOVE, j] -= t
    if now[NOW.WAITING] > 0.0:
        for j in range(mode.size):
            if mode[j] == MODE.WAITING:
                particle[PARTICLE.SAFE, j] = since_now(state, j)
    return motion


@jit
def since_now(state: System, j: int) -> float:
    """Return the time from now to the launch of particle j, or to its last lift-off."""
    whole = state.particle[PARTICLE.N, j] - state.now[NOW.N]
    return float(whole + (state.particle[PARTICLE.X, j] - state.now[NOW.X]))


@part
def under(state: System, fixed: Mount, count: int, side: float) -> Load:
    """Change the load or the side of the drive; the base keeps its height and velocity."""
    changed, now = sprung.loaded(fixed, count, side), state.now
    forced = sprung.forced_motion(changed.drive, phase_now(state))
    now[NOW.D] = now[NOW.HEIGHT] - (forced.height + changed.level)
    now[NOW.B] = now[NOW.SPEED] - forced.speed + changed.slow * now[NOW.D]
    return changed


# --- Search for the next landing ------------------------------------------------------------------
# Every impact moves the base and so changes all later landings.  For each particle a lower bound of
# the time of its landing is stored, and only the particle with the earliest bound is examined.
# Three facts give these bounds:
#
# - The step (F' + sqrt(F'^2 + 2 K F)) / K from a clearance F passes no root, because F'' >= -K with
#   a bound K from the energy of the free oscillation, which does not grow between impacts.
# - An impact pushes the base down.  For half a free oscillation the base is nowhere higher than it
#   would have been, so that a bound found before the impact remains valid.
# - The base stays below a height that follows from its energy.  The time at which a particle falls
#   to that height remains a bound, whatever the other particles do, until the energy exceeds the
#   one assumed.
#
# If F' < 0 and 4 K F <= F'^2, the next root is unique within the step, and Newton's iteration with
# the next two derivatives finds it, or with only the next one while a recoil that decays at once
# makes the cubic useless.


NEAR = 2.0**-50  # relative error that ends Newton's iteration
ROUNDING = 2.0**-40  # relative margin of speeds and clearances within which rounding may decide

STEPS = 50  # of the search for a lift-off before particles are examined again


@jit
def _to_root(f: float, f1: float, f2: float) -> float:
    """Return the step to the root of the parabola with these derivatives, f1 < 0."""
    inside = f1 * f1 - 2.0 * f * f2
    return 2.0 * f / (math.sqrt(inside if inside > 0.0 else 0.0) - f1)


@jit
def _ahead(f: float, f1: float, k: float) -> float:
    """Return a step that passes no root of a function with this value and slope, and f'' >= -k."""
    if f1 >= 0.0:
        return (f1 + math.sqrt(f1 * f1 + 2.0 * k * f)) / k if k > 0.0 else np.inf
    return _to_root(f, f1, -k)


@jit
def _step(f: float, f1: float, f2: float, f3: float, k: float) -> float:
    """Return the step to the root of the cubic with these derivatives, f1 < 0, to third order.

    It is the step to the root of the parabola if f3 would change f2 by more than its bound k.
    """
    step = _to_root(f, f1, f2)
    slope = f1 + f2 * step
    return (
        step - f3 * step * step * step / (6.0 * slope)
        if slope < 0.0 and abs(f3 * step) <= k
        else step
    )


@jit
def _clearance(state: System, j: int, motion: Motion, t: float) -> tuple[float, float]:
    """Return the height of particle j above the base and its rate after time t."""
    h, w = state.particle[PARTICLE.HEIGHT, j], state.particle[PARTICLE.SPEED, j]
    return fma(t, w - t, h) - motion.rise, w - 2.0 * t - motion.gain


@jit
def crossings(left: float, u: float) -> tuple[float, float]:
    """Return when a particle of speed u rises to the height `left` above it, and falls back to it.

    Infinity and 0 if it does not reach that height.
    """
    spare = 0.25 * u * u - left
    if not spare > 0.0:
        return np.inf, 0.0
    return 0.5 * u - math.sqrt(spare), 0.5 * u + math.sqrt(spare)


class First(NamedTuple):
    """The particle that may be the next to land or to be launched, and the one after it."""

    # who, time: the particle, -1 if there is none, and its time
    who: int
    time: float
    # other, then: the same for the one after it
    other: int
    then: float


@part
def earliest(state: System) -> First:
    """Return the earliest particles; of equal times, the particle of the lower number is first."""
    who, time, other, then = -1, np.inf, -1, np.inf
    for j in range(state.mode.size):
        safe = state.particle[PARTICLE.SAFE, j]
        if safe < then:
            if safe < time:
                who, time, other, then = j, safe, who, time
            else:
                other, then = j, safe
    return First(who, time, other, then)


@jit
def is_first(state: System, first: First) -> bool:
    """Return whether the earliest particle still is the earliest, after its time has moved."""
    time = state.particle[PARTICLE.SAFE, first.who]
    return time < first.then or (time == first.then and first.who < first.other)


@part
def look(state: System, load: Load, limit: Bounds, j: int) -> bool:
    """Advance the time before which particle j does not land; return whether it lands then."""
    t = state.particle[PARTICLE.SAFE, j]
    motion = motion_after(state, load, t)
    f, f1 = _clearance(state, j, motion, t)
    scale, k = state.particle[PARTICLE.SCALE, j], 2.0 + limit.pull  # F'' = -2 - Y'' >= -k
    if f <= 0.0:
        if f1 <= 0.0:
            return True
        f = 0.0
    if f1 < 0.0 and 4.0 * k * f <= f1 * f1:
        state.particle[PARTICLE.SAFE, j] = _landing(state, load, limit, j, motion)
        return True
    if t > 0.0 and f1 >= 0.0 and f <= ROUNDING * scale * scale:
        state.now[NOW.UNDECIDED] += 1.0
    ahead = t + _ahead(f, f1, k)
    if state.now[NOW.HEIGHT] + state.now[NOW.SPEED] * t + motion.rise + f > state.now[NOW.HIGHEST]:
        ahead = max(ahead, state.particle[PARTICLE.ABOVE, j])
    state.particle[PARTICLE.SAFE, j] = ahead
    return not ahead > t


@part
def _landing(state: System, load: Load, limit: Bounds, j: int, motion: Motion) -> float:
    """Return when particle j lands, if its clearance has a single root within the next step.

    `motion` is that of the base up to the time before which the particle does not land.
    """
    t, last, k = state.particle[PARTICLE.SAFE, j], np.inf, 2.0 + limit.pull
    for _ in range(20):
        f, f1 = _clearance(state, j, motion, t)
        step = _step(f, f1, -2.0 - motion.pull, -motion.jerk, k)
        t = max(t + step, 0.0)
        # ends where the error of the cubic is negligible, or rounding keeps steps from shrinking
        square = step * step
        if limit.snap * square * square <= -f1 * NEAR * t or abs(step) >= 0.5 * last:
            break
        last = abs(step)
        motion = motion_after(state, load, t)
    return float(t)


@part
def lift(state: System, load: Load, until: float) -> bool:
    """Advance the time before which the riders do not leave; return whether they leave then.

    At most `STEPS` steps are taken; if the time is still not after `until`, nothing is known yet.
    """
    now = state.now
    jumps = sprung.until_corner(load.drive, 0.0) < np.inf
    for _ in range(STEPS):
        t = now[NOW.LIFT]
        if t > until:
            break
        motion = motion_after(state, load, t)
        limit = sprung.bounds(load, motion.d, motion.b)
        if limit.pull <= 2.0:
            now[NOW.LIFT] = np.inf
            return False
        g = motion.pull + 2.0
        if g <= 0.0 and (motion.jerk <= 0.0 or jumps):
            return True
        ahead = t + _ahead(max(g, 0.0), motion.jerk, limit.snap)
        if not ahead > t:
            return True
        now[NOW.LIFT] = ahead
    return False


# --- Events: launches, impacts, and the lift-off of riders ----------------------------------------
# A particle sticks if its relative rebound speed is at most r and the base presses against it; both
# then have the common velocity that conserves momentum.  Riders lift off together when the base
# begins to fall faster than gravity, a condition that does not depend on their number.  A particle
# that bounces while others ride collides with the base alone, because nothing pulls riders down:
# they keep their velocity and fly.  But if their speed relative to the base would be at most r,
# they take part in the impact as one body with the base.


TRIES = 20000  # steps after which the search for the next event is abandoned
SLACK = 1.25  # factor that enlarges the bound of the height of the base: it is seldom exceeded


@part
def next_event(
    state: System, fixed: Mount, load: Load, launch_speed: float, until: float
) -> tuple[Event, Load]:
    """Advance to the next event within the time `until` from now, and carry it out.

    Without an event, only bounds of future times change.  Returns the event and the load of the
    base after it.
    """
    limit = sprung.bounds(load, state.now[NOW.D], state.now[NOW.B])
    first, corner = earliest(state), sprung.until_corner(load.drive, state.now[NOW.X])
    horizon, smooth = min(until, corner), corner == np.inf
    for _ in range(TRIES):
        time = min(first.time, horizon)
        if load.riders > 0 and lift(state, load, time):
            return _drop(state, fixed, load)
        if state.now[NOW.LIFT] <= time:
            continue
        if first.who < 0 and state.now[NOW.LIFT] == np.inf and (smooth or load.riders == 0):
            return Event(EVENT.FINISHED, -1, np.inf, 0.0, False), load
        if first.time > horizon:
            if corner <= until:
                return _turn(state, fixed, load, corner)
            return Event(EVENT.NONE, -1, until, 0.0, False), load
        if state.mode[first.who] == MODE.WAITING:
            return _launch(state, load, first.who, launch_speed)
        lands = look(state, load, limit, first.who)
        if not is_first(state, first):
            first = earliest(state)
            continue
        time = state.particle[PARTICLE.SAFE, first.who]
        if lands and time <= horizon and not time > state.now[NOW.LIFT]:
            return _land(state, fixed, load, first.who)
        first = First(first.who, time, first.other, first.then)
    return Event(EVENT.LOST, first.who, first.time, 0.0, False), load


@part
def _turn(state: System, fixed: Mount, load: Load, t: float) -> tuple[Event, Load]:
    """Advance to the corner of the drive after the time t, and renew the bounds of all flights."""
    side = sprung.side_of(load.drive)
    let_pass(state, load, t)
    state.now[NOW.X] = math.copysign(0.25, side)  # the corner, without rounding
    locate(state, load)
    after = under(state, fixed, load.riders, -side)
    _expect(state, after, 0.0, False)
    return Event(EVENT.CORNER, -1, t, 0.0, False), after


@part
def _leave(state: System, j: int, w: float, wait: float) -> None:
    """Let particle j leave the base with the relative speed w; it does not land before `wait`."""
    particle, now = state.particle, state.now
    state.mode[j] = MODE.FLYING
    particle[PARTICLE.HEIGHT, j] = 0.0
    particle[PARTICLE.SPEED, j] = particle[PARTICLE.SCALE, j] = w
    particle[PARTICLE.N, j], particle[PARTICLE.X, j] = now[NOW.N], now[NOW.X]
    rises, falls = crossings(now[NOW.HIGHEST] - now[NOW.HEIGHT], now[NOW.SPEED] + w)
    particle[PARTICLE.ABOVE, j] = falls
    particle[PARTICLE.SAFE, j] = max(wait, falls) if rises <= wait else wait


@jit
def _wait(state: System, load: Load, w: float) -> float:
    """Return a time within which a particle that leaves with relative speed w >= 0 cannot land."""
    limit = sprung.bounds(load, state.now[NOW.D], state.now[NOW.B])
    pull, _ = acceleration(state, load)
    falls = -2.0 - pull  # how much faster than gravity the base falls
    # F >= w s - (2 + pull) s^2 / 2, and F >= falls s^2 / 2 - jerk s^3 / 6
    wait = max(2.0 * w / (2.0 + limit.pull), 3.0 * falls / limit.jerk if falls > 0.0 else 0.0)
    return min(wait, sprung.until_corner(load.drive, state.now[NOW.X]))


@part
def _expect(state: System, load: Load, kick: float, same: bool) -> None:
    """Correct relative speeds and bounds of future times after the base has lost the speed `kick`.

    `same` is True if the load of the base has not changed.
    """
    particle, now = state.particle, state.now
    height = sprung.bounds(load, now[NOW.D], now[NOW.B]).height
    y, v = now[NOW.HEIGHT], now[NOW.SPEED]
    now[NOW.LIFT] = 0.0 if load.riders > 0 else np.inf
    if height > now[NOW.HIGHEST]:
        now[NOW.HIGHEST] = height + (SLACK - 1.0) * abs(height)
        for j in range(state.mode.size):
            left = now[NOW.HIGHEST] - (y + particle[PARTICLE.HEIGHT, j])
            _, falls = crossings(left, v + particle[PARTICLE.SPEED, j] + kick)
            particle[PARTICLE.ABOVE, j] = falls
    highest, keeps = now[NOW.HIGHEST], load.keeps if same else 0.0
    for j in range(state.mode.size):
        particle[PARTICLE.SPEED, j] += kick
        far = y + particle[PARTICLE.HEIGHT, j] > highest
        above = max(particle[PARTICLE.ABOVE, j], 0.0) if far else 0.0
        safe = particle[PARTICLE.SAFE, j]
        kept = min(safe, max(above, keeps)) if same else above
        particle[PARTICLE.SAFE, j] = kept if state.mode[j] == MODE.FLYING else safe


@jit
def _push(state: System, kick: float) -> None:
    """Reduce the speed of the base by `kick`."""
    state.now[NOW.B] -= kick
    state.now[NOW.SPEED] -= kick


@part
def _drop(state: System, fixed: Mount, load: Load) -> tuple[Event, Load]:
    """Let all riders leave the base, which begins to fall faster than gravity."""
    t = state.now[NOW.LIFT]
    let_pass(state, load, t)
    bare = under(state, fixed, 0, sprung.side_of(load.drive))
    _expect(state, bare, 0.0, False)
    limit = sprung.bounds(bare, state.now[NOW.D], state.now[NOW.B])
    # F'' = 0 now, F''' = -jerk: F >= -jerk s^3 / 6 - snap s^4 / 24
    _, jerk = acceleration(state, bare)
    wait = max(-4.0 * jerk / limit.snap, 0.0) if limit.snap > 0.0 else 0.0
    corner = sprung.until_corner(bare.drive, state.now[NOW.X])
    if corner < np.inf:  # the acceleration may have jumped
        wait = max(min(wait, corner), _wait(state, bare, 0.0))
    _release(state, 0.0, wait)
    return Event(EVENT.LIFT, -1, t, 0.0, False), bare


@part
def _release(state: System, w: float, wait: float) -> None:
    """Let all riders leave the base with the relative speed w; none lands before `wait`."""
    for j in range(state.mode.size):
        if state.mode[j] == MODE.RIDING:
            _leave(state, j, w, wait)


@part
def _launch(state: System, load: Load, who: int, launch_speed: float) -> tuple[Event, Load]:
    """Launch a particle from the base; one that is slower than the base lands at once."""
    now, t = state.now, max(state.particle[PARTICLE.SAFE, who], 0.0)
    let_pass(state, load, t)
    now[NOW.WAITING] -= 1.0
    height = sprung.bounds(load, now[NOW.D], now[NOW.B]).height
    if height > now[NOW.HIGHEST]:  # at the first launch only
        now[NOW.HIGHEST] = height + (SLACK - 1.0) * abs(height)
    w = launch_speed - now[NOW.SPEED]
    _leave(state, who, w, _wait(state, load, w) if w >= 0.0 else 0.0)
    return Event(EVENT.LAUNCH, who, t, 0.0, False), load


@part
def _land(state: System, fixed: Mount, load: Load, who: int) -> tuple[Event, Load]:
    """Let a particle land, and bounce or stick."""
    particle = state.particle
    t = max(particle[PARTICLE.SAFE, who], 0.0)
    motion = let_pass(state, load, t)
    c = max(-particle[PARTICLE.SPEED, who], 0.0)
    share, number = ratio(fixed.law, fixed.e, fixed.scale, c), particle[PARTICLE.IMPACTS, who]
    draw = draw_of(fixed.noise, fixed.source, who, number, 0.0)
    w = noisy_rebound(
        fixed.noise, noisy_restitution(fixed.noise, share, draw.restitution) * c, draw.kick
    )
    particle[PARTICLE.IMPACTS, who] += 1.0
    scale = max(particle[PARTICLE.SCALE, who], fixed.r)
    if abs(w - fixed.r) <= ROUNDING * scale or c <= math.sqrt(ROUNDING) * scale:
        state.now[NOW.UNDECIDED] += 1.0
    kick = sprung.recoil(fixed, load.riders, c, True)
    presses = motion.pull + 2.0 + 2.0 * load.drag * kick > 0.0  # at the common velocity
    if w <= fixed.r and presses:
        state.mode[who] = MODE.RIDING
        particle[PARTICLE.SAFE, who] = np.inf
        _push(state, kick)
        after = under(state, fixed, load.riders + 1, sprung.side_of(load.drive))
        _expect(state, after, kick, False)
        return Event(EVENT.STICK, who, t, c, False), after
    alone = sprung.recoil_from(fixed.noise, fixed, 0, c, w)
    # nothing pulls riders down with the base; they ride on only below the threshold of rest
    dropped = load.riders > 0 and alone > fixed.r
    kick = alone if dropped else sprung.recoil_from(fixed.noise, fixed, load.riders, c, w)
    _push(state, kick)
    after = under(state, fixed, 0, sprung.side_of(load.drive)) if dropped else load
    _expect(state, after, kick, not dropped)
    _leave(state, who, w, _wait(state, after, w))
    if dropped:
        _release(state, alone, _wait(state, after, alone))
    return Event(EVENT.BOUNCE, who, t, c, dropped), after
