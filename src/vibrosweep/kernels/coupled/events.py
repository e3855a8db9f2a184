"""Events on a base of finite mass: launches, impacts, and the lift-off of riders.

A particle sticks if its relative rebound speed is at most r and the base presses against it; both
then have the common velocity that conserves momentum.  Riders lift off together when the base
begins to fall faster than gravity, a condition that does not depend on their number.  A particle
that bounces while others ride collides with the base alone, because nothing pulls riders down: they
keep their velocity and fly.  But if their speed relative to the base would be at most r, they take
part in the impact as one body with the base.
"""

from __future__ import annotations

import math

import numpy as np

from vibrosweep.kernels._jit import jit, part
from vibrosweep.kernels.bases.drives import side_of, until_corner
from vibrosweep.kernels.bases.sprung import Load, Mount, bounds, recoil, recoil_from
from vibrosweep.kernels.coupled.search import (
    ROUNDING,
    First,
    crossings,
    earliest,
    is_first,
    lift,
    look,
)
from vibrosweep.kernels.coupled.state import (
    EVENT,
    MODE,
    NOW,
    PARTICLE,
    Event,
    System,
    acceleration,
    let_pass,
    locate,
    under,
)
from vibrosweep.kernels.noise import draw_of, slipped, thrown
from vibrosweep.kernels.restitution import ratio

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
    limit = bounds(load, state.now[NOW.D], state.now[NOW.B])
    first, corner = earliest(state), until_corner(load.drive, state.now[NOW.X])
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
    """Let the drive pass the corner after the time t, and renew the bounds of all flights."""
    side = side_of(load.drive)
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
    limit = bounds(load, state.now[NOW.D], state.now[NOW.B])
    pull, _ = acceleration(state, load)
    falls = -2.0 - pull  # how much faster than gravity the base falls
    # F >= w s - (2 + pull) s^2 / 2, and F >= falls s^2 / 2 - jerk s^3 / 6
    wait = max(2.0 * w / (2.0 + limit.pull), 3.0 * falls / limit.jerk if falls > 0.0 else 0.0)
    return min(wait, until_corner(load.drive, state.now[NOW.X]))


@part
def _expect(state: System, load: Load, kick: float, same: bool) -> None:
    """Correct relative speeds and bounds of future times after the base has lost the speed `kick`.

    `same` is True if the load of the base has not changed.
    """
    particle, now = state.particle, state.now
    height = bounds(load, now[NOW.D], now[NOW.B]).height
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
    """Take the speed `kick` from the base."""
    state.now[NOW.B] -= kick
    state.now[NOW.SPEED] -= kick


@part
def _drop(state: System, fixed: Mount, load: Load) -> tuple[Event, Load]:
    """Let all riders leave the base, which begins to fall faster than gravity."""
    t = state.now[NOW.LIFT]
    let_pass(state, load, t)
    bare = under(state, fixed, 0, side_of(load.drive))
    _expect(state, bare, 0.0, False)
    limit = bounds(bare, state.now[NOW.D], state.now[NOW.B])
    # F'' = 0 now, F''' = -jerk: F >= -jerk s^3 / 6 - snap s^4 / 24
    _, jerk = acceleration(state, bare)
    wait = max(-4.0 * jerk / limit.snap, 0.0) if limit.snap > 0.0 else 0.0
    corner = until_corner(bare.drive, state.now[NOW.X])
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
    height = bounds(load, now[NOW.D], now[NOW.B]).height
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
    w = thrown(fixed.noise, slipped(fixed.noise, share, draw.slip) * c, draw.push)
    particle[PARTICLE.IMPACTS, who] += 1.0
    scale = max(particle[PARTICLE.SCALE, who], fixed.r)
    if abs(w - fixed.r) <= ROUNDING * scale or c <= math.sqrt(ROUNDING) * scale:
        state.now[NOW.UNDECIDED] += 1.0
    kick = recoil(fixed, load.riders, c, True)
    presses = motion.pull + 2.0 + 2.0 * load.drag * kick > 0.0  # at the common velocity
    if w <= fixed.r and presses:
        state.mode[who] = MODE.RIDING
        particle[PARTICLE.SAFE, who] = np.inf
        _push(state, kick)
        after = under(state, fixed, load.riders + 1, side_of(load.drive))
        _expect(state, after, kick, False)
        return Event(EVENT.STICK, who, t, c, False), after
    alone = recoil_from(fixed.noise, fixed, 0, c, w)
    # nothing pulls riders down with the base; they ride on only below the threshold of rest
    dropped = load.riders > 0 and alone > fixed.r
    kick = alone if dropped else recoil_from(fixed.noise, fixed, load.riders, c, w)
    _push(state, kick)
    after = under(state, fixed, 0, side_of(load.drive)) if dropped else load
    _expect(state, after, kick, not dropped)
    _leave(state, who, w, _wait(state, after, w))
    if dropped:
        _release(state, alone, _wait(state, after, alone))
    return Event(EVENT.BOUNCE, who, t, c, dropped), after
