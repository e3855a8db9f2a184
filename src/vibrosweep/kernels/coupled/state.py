"""State of particles on a base of finite mass, relative to the base.

Heights above the base and speeds relative to it keep their relative accuracy while a particle
chatters.  Whole periods and phase are stored separately, as everywhere.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, Integers, fma, jit, part
from vibrosweep.kernels.bases.drives import Motion, Phase, phase_of, place, side_at
from vibrosweep.kernels.bases.sprung import Load, Mount, free_pull, loaded, move, velocity
from vibrosweep.kernels.impact import land, launch
from vibrosweep.model.parameters import Dimensionless, Launches


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


class Kinds(NamedTuple):
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
EVENT = Kinds(*range(len(Kinds._fields)))


class System(NamedTuple):
    """State of a realization."""

    particle: Floats  # shape (row of `PARTICLE`, particle)
    now: Floats  # numbers of the realization, by `NOW`
    mode: Integers  # one of `MODE` for each particle


class Event(NamedTuple):
    """The next event."""

    kind: int  # one of `EVENT`
    who: int  # the particle; -1 for all riders, or where nobody takes part
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
    load = loaded(fixed, 0, side_at(fixed.waveform, now[NOW.X]))
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
    at = phase_of(now[NOW.X])
    now[NOW.SINE], now[NOW.COSINE] = at.sine, at.cosine
    forced = place(load.drive, at)
    now[NOW.HEIGHT] = forced.height + load.level + now[NOW.D]
    now[NOW.SPEED] = forced.speed + velocity(load, now[NOW.D], now[NOW.B])


@jit
def phase_now(state: System) -> Phase:
    """Return the phase now."""
    return Phase(state.now[NOW.X], state.now[NOW.SINE], state.now[NOW.COSINE])


@part
def motion_after(state: System, load: Load, t: float) -> Motion:
    """Return the motion of the base after the time t from now."""
    now = state.now
    return move(load, phase_now(state), now[NOW.D], now[NOW.B], t)


@jit
def acceleration(state: System, load: Load) -> tuple[float, float]:
    """Return the acceleration of the base now, and its rate."""
    forced = place(load.drive, phase_now(state))
    free, rate = free_pull(load, state.now[NOW.D], state.now[NOW.B])
    return free + forced.pull, rate + forced.jerk


@part
def let_pass(state: System, load: Load, t: float) -> Motion:
    """Let the time t pass without an event; return the motion of the base."""
    particle, now, mode = state
    motion = motion_after(state, load, t)
    now[NOW.X], passed = land(now[NOW.X], t)
    now[NOW.N] += passed
    now[NOW.D], now[NOW.B] = motion.d, motion.b
    now[NOW.LIFT] -= t
    locate(state, load)
    for j in range(mode.size):  # also if not flying: height and speed are set anew at the lift-off
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
    changed, now = loaded(fixed, count, side), state.now
    forced = place(changed.drive, phase_now(state))
    now[NOW.D] = now[NOW.HEIGHT] - (forced.height + changed.level)
    now[NOW.B] = now[NOW.SPEED] - forced.speed + changed.slow * now[NOW.D]
    return changed
