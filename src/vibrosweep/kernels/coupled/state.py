"""State of particles on a base of finite mass, relative to the base.

Height and speed above the base lose nothing while a particle chatters.  Whole periods and phase are
kept apart, as everywhere.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, Integers, fma, jit, kernel
from vibrosweep.kernels.bases.sprung import Load, Motion, Mount, loaded, move
from vibrosweep.kernels.impact import land, launch
from vibrosweep.kernels.sine import cos_turns, sin_turns
from vibrosweep.model.parameters import Dimensionless, Launches

__all__ = [
    "EVENT",
    "MODE",
    "NOW",
    "PARTICLE",
    "Event",
    "System",
    "Turned",
    "base_height",
    "base_speed",
    "begin",
    "here",
    "let_pass",
    "motion_after",
    "push",
    "riders",
    "since_now",
    "system",
    "under",
]


class Particle(NamedTuple):
    """Rows of numbers of each particle."""

    HEIGHT: int  # above the base
    SPEED: int  # relative to it
    SAFE: int  # time from now before which it does not land, or is not launched
    ABOVE: int  # time from now for which it is above every height of the base
    SCALE: int  # speed relative to the base at its lift-off
    N: int  # whole periods and phase of its launch, then of its last lift-off
    X: int


class Now(NamedTuple):
    """Places of numbers of the realization."""

    N: int  # whole periods and phase
    X: int
    D: int  # deviation of the base from its forced oscillation, and its velocity
    V: int
    HIGHEST: int  # height above which the base is taken not to come
    LIFT: int  # time from now before which the base does not drop its riders
    UNDECIDED: int  # decisions that rounding may have made


class Mode(NamedTuple):
    """What a particle does."""

    WAITING: int
    FLYING: int
    RIDING: int


class Kinds(NamedTuple):
    """Kinds of events."""

    NONE: int  # none up to the given time
    FINISHED: int  # none ever: all rest for good
    LOST: int  # the search was given up
    LAUNCH: int
    BOUNCE: int
    STICK: int
    LIFT: int  # all riders leave


PARTICLE = Particle(*range(len(Particle._fields)))
NOW = Now(*range(len(Now._fields)))
MODE = Mode(*range(len(Mode._fields)))
EVENT = Kinds(*range(len(Kinds._fields)))


class System(NamedTuple):
    """State of a realization.

    Attributes
    ----------
    particle
        Shape (row of `PARTICLE`, particle).
    now
        Numbers of the realization, by `NOW`.
    mode
        One of `MODE` for each particle.
    """

    particle: Floats
    now: Floats
    mode: Integers


class Event(NamedTuple):
    """What happens next.

    Attributes
    ----------
    kind
        One of `EVENT`.
    who
        The particle; -1 for all riders, or where nobody takes part.
    time
        Time passed since the event before, in forcing periods.
    speed
        Approach speed of a landing.
    dropped
        Whether its recoil made the riders leave.
    """

    kind: int
    who: int
    time: float
    speed: float
    dropped: bool


def system(particles: int) -> System:
    """Allocate the state of a realization."""
    return System(
        np.zeros((len(Particle._fields), particles)),
        np.zeros(len(Now._fields)),
        np.zeros(particles, np.int64),
    )


@kernel
def begin(of: System, problem: Dimensionless, launches: Launches, i: int) -> None:
    """Put realization i before its first launch; counts of periods are relative to the end."""
    particle, now, mode = of
    first = 0
    for j in range(mode.size):
        n, x = launch(launches, i, j, problem.phase[i])
        particle[PARTICLE.N, j], particle[PARTICLE.X, j] = n - problem.end_count[i], x
        mode[j] = MODE.WAITING
        if _between(particle, j, first) < 0.0:
            first = j
    now[:] = 0.0
    now[NOW.N], now[NOW.X] = particle[PARTICLE.N, first], particle[PARTICLE.X, first]
    now[NOW.LIFT] = np.inf
    for j in range(mode.size):
        particle[PARTICLE.SAFE, j] = _between(particle, j, first)


@jit
def _between(particle: Floats, j: int, first: int) -> float:
    """Return the time from the instant of one particle to that of another."""
    whole = particle[PARTICLE.N, j] - particle[PARTICLE.N, first]
    return float(whole + (particle[PARTICLE.X, j] - particle[PARTICLE.X, first]))


@jit
def riders(of: System) -> int:
    """Return how many particles ride the base."""
    number = 0
    for mode in of.mode:
        number += 1 if mode == MODE.RIDING else 0
    return number


@kernel
def base_height(of: System, load: Load) -> float:
    """Return the height of the base."""
    x = of.now[NOW.X]
    return float(load.p * cos_turns(x) + load.q * sin_turns(x) + load.level + of.now[NOW.D])


@kernel
def base_speed(of: System, load: Load) -> float:
    """Return the velocity of the base."""
    x = of.now[NOW.X]
    forced = 2.0 * math.pi * (load.q * cos_turns(x) - load.p * sin_turns(x))
    return float(forced + of.now[NOW.V])


# sine and cosine of the phase of now
Turned = tuple[float, float]


@kernel
def motion_after(of: System, load: Load, turned: Turned, t: float) -> Motion:
    """Return the motion of the base after the time t from now."""
    return move(load, turned[0], turned[1], of.now[NOW.D], of.now[NOW.V], t)


@kernel
def here(of: System, load: Load) -> Motion:
    """Return the motion of the base now."""
    x = of.now[NOW.X]
    return motion_after(of, load, (sin_turns(x), cos_turns(x)), 0.0)


@kernel
def let_pass(of: System, load: Load, turned: Turned, t: float) -> Motion:
    """Let the time t pass, in which nothing happens; return what the base has done."""
    particle, now, mode = of
    motion = motion_after(of, load, turned, t)
    now[NOW.X], passed = land(now[NOW.X], t)
    now[NOW.N] += passed
    now[NOW.D], now[NOW.V] = motion.d, motion.v
    now[NOW.LIFT] -= t
    for j in range(mode.size):
        w = particle[PARTICLE.SPEED, j]
        if mode[j] == MODE.FLYING:
            particle[PARTICLE.HEIGHT, j] = fma(t, w - t, particle[PARTICLE.HEIGHT, j]) - motion.rise
            particle[PARTICLE.SPEED, j] = w - 2.0 * t - motion.gain
            particle[PARTICLE.SAFE, j] -= t
            particle[PARTICLE.ABOVE, j] -= t
        elif mode[j] == MODE.WAITING:
            particle[PARTICLE.SAFE, j] = since_now(of, j)
    return motion


@jit
def since_now(of: System, j: int) -> float:
    """Return the time from now to the launch of particle j, or to its last lift-off."""
    whole = of.particle[PARTICLE.N, j] - of.now[NOW.N]
    return float(whole + (of.particle[PARTICLE.X, j] - of.now[NOW.X]))


@kernel
def push(of: System, kick: float) -> None:
    """Take the speed `kick` from the base."""
    of.now[NOW.V] -= kick
    for j in range(of.mode.size):
        if of.mode[j] == MODE.FLYING:
            of.particle[PARTICLE.SPEED, j] += kick


@kernel
def under(of: System, fixed: Mount, load: Load, count: int) -> Load:
    """Change the load: the same height and velocity of the base are another deviation."""
    height, speed = base_height(of, load), base_speed(of, load)
    changed = loaded(fixed, count)
    of.now[NOW.D] = of.now[NOW.V] = 0.0
    of.now[NOW.D] = height - base_height(of, changed)
    of.now[NOW.V] = speed - base_speed(of, changed)
    return changed
