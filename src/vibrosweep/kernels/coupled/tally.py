"""Statistics of particles on a base of finite mass, over the window."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Flags, Floats, Integers, jit, part
from vibrosweep.kernels.coupled.neighbours import Landings, landings
from vibrosweep.kernels.coupled.state import NOW, PARTICLE, System, system


class Each(NamedTuple):
    """Statistics of particles over the window, each array of shape (realization * particle,)."""

    # landings, rests, flights: numbers of landings, of those after which the particle rested, and
    # of the flights that follow on them and begin up to a period after the end
    landings: Integers
    rests: Integers
    flights: Integers
    # flight_sum, height_sum, height_max: of these flights: sum of the flight times in forcing
    # periods, sum and maximum of the greatest heights in g / (2 f^2)
    flight_sum: Floats
    height_sum: Floats
    height_max: Floats
    launch_height: Floats  # greatest height of the launch, -inf of one after the end
    # 1 if it came to rest for good; of a realization, the number of such particles
    at_rest: Integers
    status: Flags  # `vibrosweep.model.status.Status`


class Room(NamedTuple):
    """Scratch memory of one thread."""

    of: System  # state of the realization
    landings: Landings  # what is remembered of landings
    # Whole periods and phase of the last lift-off of each particle; shape (2, particle)
    lifted: Floats
    # counts, flies, rides: for each particle, 1 where its last landing is in the window, where its
    # flight counts, and where it rests since a landing up to the end
    counts: Integers
    flies: Integers
    rides: Integers


def room(particles: int) -> Room:
    """Allocate scratch memory for one thread."""
    counts, flies, rides = (np.zeros(particles, np.int64) for _ in range(3))
    lifted = np.zeros((2, particles))
    return Room(system(particles), landings(particles), lifted, counts, flies, rides)


def roomier(work: Room) -> Room:
    """Return scratch memory of twice as many impact numbers."""
    memory = landings(work.counts.size, 2 * work.landings.number.size)
    return work._replace(landings=memory)


def empty_each(particles: int) -> Each:
    """Allocate statistics of so many particles, of all realizations."""
    landed, rests, flights, at_rest = (np.zeros(particles, np.int64) for _ in range(4))
    time, height, highest = (np.zeros(particles) for _ in range(3))
    launch_height, status = np.full(particles, -np.inf), np.zeros(particles, np.int8)
    return Each(landed, rests, flights, time, height, highest, launch_height, at_rest, status)


@part
def forget(work: Room, first: int, each: Each) -> None:
    """Begin with no landings of the particles in the places from `first` on."""
    for j in range(work.counts.size):
        t = first + j
        work.counts[j] = work.flies[j] = work.rides[j] = 0
        each.landings[t] = each.rests[t] = each.flights[t] = each.at_rest[t] = 0
        each.flight_sum[t] = each.height_sum[t] = each.height_max[t] = 0.0
        each.launch_height[t] = -np.inf


@jit
def apex(height: float, speed: float, relative: float) -> float:
    """Return the greatest height of a flight.

    From the base at this height and speed, with a speed relative to it.
    """
    u = speed + relative
    # a particle that falls, or that the base pushes at once, is highest at its beginning
    rises = u > 0.0 and relative >= 0.0
    return height + (0.25 * u * u if rises else 0.0)


@part
def count_flight(work: Room, t: int, j: int, each: Each) -> None:
    """Count the flight on which particle j, in place t, sets out now."""
    of = work.of
    work.lifted[0, j], work.lifted[1, j] = of.now[NOW.N], of.now[NOW.X]
    if work.counts[j] == 0:
        return
    height = apex(of.now[NOW.HEIGHT], of.now[NOW.SPEED], of.particle[PARTICLE.SPEED, j])
    each.height_max[t] = max(each.height_max[t], height) if each.flights[t] > 0 else height
    each.height_sum[t] += height
    each.flights[t] += 1
    work.flies[j] = 1


@jit
def end_flight(work: Room, t: int, j: int, each: Each) -> None:
    """Count the time of the flight of particle j, in place t, that ends now."""
    if work.flies[j] == 1:
        whole = work.of.now[NOW.N] - work.lifted[0, j]
        each.flight_sum[t] += whole + (work.of.now[NOW.X] - work.lifted[1, j])
        work.flies[j] = 0


@part
def add_up(i: int, particles: int, each: Each, out: Each) -> None:
    """Add up the particles of realization i, always in the same order."""
    for t in range(i * particles, (i + 1) * particles):
        out.landings[i] += each.landings[t]
        out.rests[i] += each.rests[t]
        out.flight_sum[i] += each.flight_sum[t]
        out.height_sum[i] += each.height_sum[t]
        if each.flights[t] > 0:
            least = out.height_max[i] if out.flights[i] > 0 else -np.inf
            out.height_max[i] = max(least, each.height_max[t])
        out.flights[i] += each.flights[t]
        out.at_rest[i] += each.at_rest[t]
        out.status[i] = max(out.status[i], each.status[t])
