"""Landings of one realization in the order of time: neighbours, and the order of particles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, Integers, jit, part
from vibrosweep.kernels.arithmetic import cos_turns, sin_turns
from vibrosweep.kernels.bases import Instant
from vibrosweep.kernels.memory import unwritten
from vibrosweep.model.measures import UNDETERMINED

# --- Neighbours -----------------------------------------------------------------------------------
# The closest pair of landings of different particles consists of neighbours: any landing between
# them would be closer to one of the two.  Similarly, a landing on an occupied base directly follows
# the landing of its occupant, or another landing during that stay.


class Listed(NamedTuple):
    """A landing in a list."""

    # whole, phase: of the instant; an infinite count stands for no landing
    whole: float
    phase: float
    stay: float  # periods on the base, at least the contact time
    who: float  # particle, or `before_window` of one that landed before the window


@jit
def before_window(particle: float) -> float:
    """Return the number below 0 that a list has for a particle that lands before the window."""
    return -1.0 - particle


@jit
def particle_of(who: float) -> float:
    """Return the particle of a landing in a list, before the window or in it."""
    return who if who >= 0.0 else -1.0 - who


@jit
def no_landing() -> Listed:
    """No landing."""
    return Listed(np.inf, 0.0, 0.0, 0.0)


@jit
def in_window(landing: Listed, begin: Instant) -> Listed:
    """Return a landing as it counts in a window: unchanged if it is inside.

    A particle that lands before the window and is still on the base when the window begins counts
    as an occupant, not as a landing.  It is listed with a negative number, one period before the
    beginning, where it separates no two landings, and with a stay that ends at its lift-off.  A
    particle that leaves before the window is dropped.
    """
    early = (begin.whole - landing.whole) + (begin.phase - landing.phase)
    if not early > 0.0:
        return landing
    if landing.stay < early:
        return no_landing()
    return Listed(
        begin.whole - 1.0, begin.phase, (landing.stay - early) + 1.0, before_window(landing.who)
    )


@jit
def neighbours(latest: Listed, landing: Listed, gap: float, shared: int) -> tuple[float, int]:
    """Compare a landing with the one before it, in the order of time.

    Returns the smallest gap so far of landings of different particles in the window, and whether
    the base was shared.
    """
    who, other = latest.who, landing.who
    if latest.whole < np.inf and particle_of(other) != particle_of(who):
        apart = abs((landing.whole - latest.whole) + (landing.phase - latest.phase))
        if apart <= latest.stay:
            shared = 1
        if who >= 0 and other >= 0 and apart < gap:
            gap = apart
    return gap, shared


# --- Turns ----------------------------------------------------------------------------------------


GAPS = 4096  # of the last period; with more they are left undetermined
# multiples of the forcing frequency at which the phases of the last landings are compared
HARMONICS = (1.0, 2.0, 3.0, 0.5, 1.0 / 3.0)


class Turns(NamedTuple):
    """Particles in the order of their last landings; not shared between threads."""

    last: Floats  # whole periods and phase of the last landing of each; shape (2, particle)
    # The particle that landed next after each, and the one before it.  The place behind the last
    # particle closes the chain: it follows the latest landing and precedes the one longest ago.  A
    # particle that has not landed is its own neighbour.  Shape (particle + 1,)
    after: Integers
    before: Integers
    gaps: Floats  # between neighbouring landings of different particles in the last period


class Order(NamedTuple):
    """Order so far."""

    changes: int  # landings in the window of a particle whose turn it was not
    gaps: int  # how many of `Turns.gaps` are in use


class Orders(NamedTuple):
    """Order of realizations: arrays of shape (realization,) but for `phases`."""

    changes: Integers  # landings out of turn
    # gap_median, gap_least: of the gaps between neighbouring landings of different particles in the
    # last period
    gap_median: Floats
    gap_least: Floats
    phases: Floats  # order parameter of each of `HARMONICS`; shape (harmonic, realization)


def empty_turns(particles: int) -> Turns:
    """Allocate memory of turns."""
    after, before = (np.zeros(particles + 1, np.int64) for _ in range(2))
    return Turns(np.zeros((2, particles)), after, before, np.zeros(GAPS))


def empty_orders(realizations: int) -> Orders:
    """Allocate the order of a batch."""
    median, least = (unwritten(realizations) for _ in range(2))
    phases = unwritten((len(HARMONICS), realizations))
    return Orders(unwritten(realizations, np.int64), median, least, phases)


@jit
def no_order(memory: Turns) -> Order:
    """Discard all landings."""
    for j in range(memory.after.size):
        memory.after[j] = memory.before[j] = j
    return Order(0, 0)


@jit
def has_landed(memory: Turns, j: int) -> bool:
    """Return whether particle j has landed."""
    return bool(memory.after[j] != j)


@jit
def latest(memory: Turns) -> int:
    """Return the particle that landed last; the number of particles where none has."""
    return int(memory.before[memory.before.size - 1])


@part
def note_turn(memory: Turns, order: Order, landing: Listed, late: bool) -> Order:
    """Note a landing; `late` is whether it is in the last period of the window."""
    after, before, end = memory.after, memory.before, memory.after.size - 1
    seen, previous = landing.who >= 0.0, latest(memory)
    who = int(particle_of(landing.who))
    changes, gaps = order
    if late and previous not in (who, end):
        if gaps < GAPS:
            whole, phase = memory.last[0, previous], memory.last[1, previous]
            memory.gaps[gaps] = (landing.whole - whole) + (landing.phase - phase)
        gaps += 1
    if seen and has_landed(memory, who) and after[end] != who:
        changes += 1
    after[before[who]], before[after[who]] = after[who], before[who]
    previous = before[end]
    after[previous] = before[end] = who
    after[who], before[who] = end, previous
    memory.last[0, who], memory.last[1, who] = landing.whole, landing.phase
    return Order(changes, gaps)


@part
def write_order(out: Orders, i: int, memory: Turns, order: Order, known: bool) -> None:
    """Write the order of realization i; `known` is whether all landings up to the end are."""
    out.changes[i] = order.changes if known else UNDETERMINED
    median, least = _of_gaps(memory, order) if known else (np.nan, np.nan)
    out.gap_median[i], out.gap_least[i] = median, least
    for h in range(out.phases.shape[0]):
        out.phases[h, i] = _order_of(memory, HARMONICS[h]) if known else np.nan


@part
def _of_gaps(memory: Turns, order: Order) -> tuple[float, float]:
    """Return the median and the least of the gaps of the last period; NaN if none or too many."""
    gaps, count = memory.gaps, order.gaps
    if not 0 < count <= GAPS:
        return np.nan, np.nan
    step = count
    while step > 1:  # Shell's sort, with steps that shrink by Gonnet's factor
        step = max(1, int(step / 2.2))
        for k in range(step, count):
            gap, place = gaps[k], k
            while place >= step and gaps[place - step] > gap:
                gaps[place] = gaps[place - step]
                place -= step
            gaps[place] = gap
    return 0.5 * (gaps[(count - 1) // 2] + gaps[count // 2]), gaps[0]


@part
def _order_of(memory: Turns, harmonic: float) -> float:
    """Return the modulus of the mean of exp(2 pi i h t) over the last landings.

    NaN where no particle has landed.
    """
    even, odd, count = 0.0, 0.0, 0
    for j in range(memory.last.shape[1]):
        if has_landed(memory, j):
            turns = harmonic * memory.last[0, j]
            turns = (turns - np.rint(turns)) + harmonic * memory.last[1, j]
            turns -= np.rint(turns)
            even += cos_turns(turns)
            odd += sin_turns(turns)
            count += 1
    return np.sqrt(even * even + odd * odd) / count if count > 0 else np.nan
