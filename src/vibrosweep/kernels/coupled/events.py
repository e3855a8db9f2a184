"""What happens on a base of finite mass: launches, impacts, and the lift-off of riders.

A particle sticks where its relative rebound speed is at most r and the base presses it, with the
common velocity that momentum gives.  Riders leave together where the base begins to fall faster
than gravity, which does not depend on their number.  An impact of another particle is one with the
base alone, as nothing pulls riders down with it: they go on with their velocity and fly, unless
their speed above the base would be at most r; then they take part as one body with it.
"""

from __future__ import annotations

import math

import numpy as np

from vibrosweep.kernels._jit import kernel
from vibrosweep.kernels.bases.sprung import Load, Mount, bounds, loaded, recoil
from vibrosweep.kernels.coupled.search import ROUNDING, crossings, earliest, is_next, lift, look
from vibrosweep.kernels.coupled.state import (
    EVENT,
    MODE,
    NOW,
    PARTICLE,
    Event,
    System,
    Turned,
    base_height,
    base_speed,
    here,
    let_pass,
    push,
    riders,
    under,
)
from vibrosweep.kernels.sine import cos_turns, sin_turns

__all__ = ["next_event"]

TRIES = 20000  # looks at particles after which the next event is given up
SLACK = 1.25  # of the height that bounds the base, so that it is seldom exceeded


@kernel
def next_event(of: System, fixed: Mount, launch_speed: float, until: float) -> Event:
    """Go on to the next event within the time `until` from now, and let it happen.

    Without one, nothing is changed but what is known of the times to come.
    """
    load = loaded(fixed, riders(of))
    x = of.now[NOW.X]
    turned = sin_turns(x), cos_turns(x)
    limit = bounds(load, of.now[NOW.D], of.now[NOW.V])
    who, time = -1, np.inf
    for _ in range(TRIES):
        who, time = earliest(of)
        if load.riders > 0 and lift(of, load, turned, min(time, until)):
            return _drop(of, fixed, load, turned)
        if of.now[NOW.LIFT] <= min(time, until):
            continue
        if who < 0 and of.now[NOW.LIFT] == np.inf:
            return Event(EVENT.FINISHED, -1, np.inf, 0.0, False)
        if time > until:
            return Event(EVENT.NONE, -1, until, 0.0, False)
        if of.mode[who] == MODE.WAITING:
            return _launch(of, fixed, load, turned, who, launch_speed)
        if look(of, load, turned, limit, who) and is_next(of, who, until):
            return _land(of, fixed, load, turned, who)
    return Event(EVENT.LOST, who, time, 0.0, False)


@kernel
def _leave(of: System, load: Load, j: int, w: float, wait: float) -> None:
    """Let particle j leave the base with the relative speed w; it does not land before `wait`."""
    particle, now = of.particle, of.now
    of.mode[j] = MODE.FLYING
    particle[PARTICLE.HEIGHT, j] = 0.0
    particle[PARTICLE.SPEED, j] = particle[PARTICLE.SCALE, j] = w
    particle[PARTICLE.N, j], particle[PARTICLE.X, j] = now[NOW.N], now[NOW.X]
    rises, falls = crossings(now[NOW.HIGHEST] - base_height(of, load), base_speed(of, load) + w)
    particle[PARTICLE.ABOVE, j] = falls
    particle[PARTICLE.SAFE, j] = max(wait, falls) if rises <= wait else wait


@kernel
def _wait(of: System, load: Load, w: float) -> float:
    """Return a time within which a particle that leaves now with speed w >= 0 does not land."""
    limit = bounds(load, of.now[NOW.D], of.now[NOW.V])
    falls = -2.0 - here(of, load).pull  # how much faster than gravity the base falls
    # F >= w s - (2 + pull) s^2 / 2, and F >= falls s^2 / 2 - jerk s^3 / 6
    return max(2.0 * w / (2.0 + limit.pull), 3.0 * falls / limit.jerk if falls > 0.0 else 0.0)


@kernel
def _expect(of: System, load: Load, same: bool) -> None:
    """Mend what is known of times to come after the base was pushed down, or its load changed."""
    particle, now = of.particle, of.now
    height = bounds(load, now[NOW.D], now[NOW.V]).height
    y, v = base_height(of, load), base_speed(of, load)
    higher = height > now[NOW.HIGHEST]
    if higher:
        now[NOW.HIGHEST] = height + (SLACK - 1.0) * abs(height)
    now[NOW.LIFT] = 0.0 if load.riders > 0 else np.inf
    for j in range(of.mode.size):
        if of.mode[j] == MODE.FLYING:
            left = now[NOW.HIGHEST] - (y + particle[PARTICLE.HEIGHT, j])
            if higher:
                _, falls = crossings(left, v + particle[PARTICLE.SPEED, j])
                particle[PARTICLE.ABOVE, j] = falls
            above = max(particle[PARTICLE.ABOVE, j], 0.0) if left < 0.0 else 0.0
            kept = min(particle[PARTICLE.SAFE, j], max(above, load.keeps))
            particle[PARTICLE.SAFE, j] = kept if same else above


@kernel
def _drop(of: System, fixed: Mount, load: Load, turned: Turned) -> Event:
    """Let all riders leave the base, which begins to fall faster than gravity."""
    t = of.now[NOW.LIFT]
    let_pass(of, load, turned, t)
    bare = under(of, fixed, load, 0)
    _expect(of, bare, False)
    limit = bounds(bare, of.now[NOW.D], of.now[NOW.V])
    # F'' = 0 now, F''' = -jerk: F >= -jerk s^3 / 6 - snap s^4 / 24
    wait = max(-4.0 * here(of, bare).jerk / limit.snap, 0.0)
    for j in range(of.mode.size):
        if of.mode[j] == MODE.RIDING:
            _leave(of, bare, j, 0.0, wait)
    return Event(EVENT.LIFT, -1, t, 0.0, False)


@kernel
def _launch(
    of: System, fixed: Mount, load: Load, turned: Turned, who: int, launch_speed: float
) -> Event:
    """Launch a particle from the base; one that is slower than the base lands at once."""
    t = max(of.particle[PARTICLE.SAFE, who], 0.0)
    let_pass(of, load, turned, t)
    height = bounds(load, of.now[NOW.D], of.now[NOW.V]).height
    if height > of.now[NOW.HIGHEST]:  # nobody has been launched before
        of.now[NOW.HIGHEST] = height + (SLACK - 1.0) * abs(height)
    w = launch_speed - base_speed(of, load)
    _leave(of, load, who, w, _wait(of, load, w) if w >= 0.0 else 0.0)
    return Event(EVENT.LAUNCH, who, t, 0.0, False)


@kernel
def _land(of: System, fixed: Mount, load: Load, turned: Turned, who: int) -> Event:
    """Let a particle land, and bounce or stick."""
    particle = of.particle
    t = max(particle[PARTICLE.SAFE, who], 0.0)
    motion = let_pass(of, load, turned, t)
    c = max(-particle[PARTICLE.SPEED, who], 0.0)
    w = fixed.e * c
    scale = max(particle[PARTICLE.SCALE, who], fixed.r)
    if abs(w - fixed.r) <= ROUNDING * scale or c <= math.sqrt(ROUNDING) * scale:
        of.now[NOW.UNDECIDED] += 1.0
    kick = recoil(fixed, load.riders, c, True)
    presses = motion.pull + 2.0 + 2.0 * load.drag * kick > 0.0  # at the common velocity
    if w <= fixed.r and presses:
        of.mode[who] = MODE.RIDING
        push(of, kick)
        _expect(of, under(of, fixed, load, load.riders + 1), False)
        return Event(EVENT.STICK, who, t, c, False)
    alone = recoil(fixed, 0, c, False)
    # nothing pulls riders down with the base; less than the threshold of rest leaves them on it
    dropped = load.riders > 0 and alone > fixed.r
    push(of, alone if dropped else recoil(fixed, load.riders, c, False))
    after = under(of, fixed, load, 0) if dropped else load
    _expect(of, after, not dropped)
    _leave(of, after, who, w, _wait(of, after, w))
    if dropped:
        for j in range(of.mode.size):
            if of.mode[j] == MODE.RIDING:
                _leave(of, after, j, alone, _wait(of, after, alone))
    return Event(EVENT.BOUNCE, who, t, c, dropped)
