"""Landings and flights of particles on a base of finite mass, counted as they happen."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, Integers, jit, part
from vibrosweep.kernels.bases import Counted
from vibrosweep.kernels.coupled.noted import Landings, landings
from vibrosweep.kernels.coupled.state import EVENT, NOW, PARTICLE, Event, System, system
from vibrosweep.kernels.observer import Observer
from vibrosweep.kernels.statistics import Kinds, Statistics, empty_statistics, empty_sums
from vibrosweep.kernels.totals import add_flight, add_landing, flight_sums, forget
from vibrosweep.kernels.unwritten import unwritten
from vibrosweep.model.measures import Status
from vibrosweep.model.observables import Landing

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
        forget(by_particle.kinds, by_particle.totals, t)
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
    time = _flight_time(work, j)
    if work.flies[j] == 1:
        add_flight(by_particle.kinds, by_particle.totals, t, Counted(time, work.lifted[2, j], 1.0))
        work.flies[j] = 0
    work.counts[j] = 1 if seen else 0
    if seen:
        speed = 0.0 if sticks else work.state.particle[PARTICLE.SPEED, j]
        landing = Landing(work.state.now[NOW.X], time, event.speed, speed, sticks)
        add_landing(by_particle.kinds, by_particle.totals, t, landing)
        if observer is not None:
            observer.function(observer.totals[t], landing)


@jit
def judge(first: int, particles: int, status: int, by_particle: Statistics) -> None:
    """Write the worst status of the particles for all of them, because they are coupled."""
    for t in range(first, first + particles):
        if not np.isfinite(flight_sums(by_particle.kinds, by_particle.totals, t)):
            status = NON_FINITE
    for t in range(first, first + particles):
        by_particle.status[t] = status
