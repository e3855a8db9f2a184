"""Comparison of the landings of one realization with their neighbours in time.

The closest pair of landings of different particles consists of neighbours: any landing between them
would be closer to one of the two.  Similarly, a landing on an occupied base directly follows the
landing of its occupant, or another landing during that stay.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, jit, part, wide_vectors
from vibrosweep.kernels.bases import Constants, Instant, constants, contact_time
from vibrosweep.kernels.impact import Batch, impact, launch, launch_speed
from vibrosweep.kernels.lanes import LANES
from vibrosweep.kernels.ordering import LIST, ORDERED, STATE, Workspace


class Window(NamedTuple):
    """The window in which landings count, or a part of it that gives the same results."""

    late: bool  # True if a particle is launched before it begins
    begin: Instant
    end: Instant


class Listed(NamedTuple):
    """A landing in a list."""

    # whole, phase: of the instant; an infinite count stands for no landing
    whole: float
    phase: float
    stay: float  # periods on the base, at least the contact time
    who: float  # particle p, or -1 - p of one that landed before the window


@jit
def listed_at(listed: Floats, first: int, q: int) -> Listed:
    """Landing q of a list whose rows begin with `first`: 0 as found, `ORDERED` in order."""
    return Listed(
        listed[first + LIST.WHOLE, q],
        listed[first + LIST.PHASE, q],
        listed[first + LIST.STAY, q],
        listed[first + LIST.WHO, q],
    )


@jit
def nobody() -> Listed:
    """No landing."""
    return Listed(np.inf, 0.0, 0.0, 0.0)


@jit
def in_window(landing: Listed, begin: Instant) -> Listed:
    """Return a landing as it counts in a window: unchanged if it is inside.

    A particle that lands before the window and is still on the base when the window begins counts
    as an occupant, not as a landing.  It is listed with a negative name, one period before the
    beginning, where it separates no two landings, and with a stay that ends at its lift-off.  A
    particle that leaves before the window is dropped.
    """
    early = (begin.whole - landing.whole) + (begin.phase - landing.phase)
    if not early > 0.0:
        return landing
    if landing.stay < early:
        return nobody()
    return Listed(begin.whole - 1.0, begin.phase, (landing.stay - early) + 1.0, -1.0 - landing.who)


@jit
def neighbours(latest: Listed, landing: Listed, gap: float, shared: int) -> tuple[float, int]:
    """Compare a landing with the one before it, in the order of time.

    Returns the smallest gap so far of landings of different particles in the window, and whether
    the base was shared.
    """
    who, other = latest.who, landing.who
    if latest.whole < np.inf and (other if other >= 0 else -1 - other) != (
        who if who >= 0 else -1 - who
    ):
        apart = abs((landing.whole - latest.whole) + (landing.phase - latest.phase))
        if apart <= latest.stay:
            shared = 1
        if who >= 0 and other >= 0 and apart < gap:
            gap = apart
    return gap, shared


@jit
def start(work: Workspace, batch: Batch, i: int) -> Window:
    """Put all particles of realization i at their launch; return its window.

    Whole periods are counted from the end of the window.
    """
    problem, launches = batch.problem, batch.launches
    fixed = constants(batch.base, problem, i)
    begin = Instant(problem.begin_count[i] - problem.end_count[i], problem.begin_phase[i])
    late = False
    particles = launches.whole.shape[1]
    for p in range(particles):
        s, j = work.state[p // LANES], p % LANES
        n, x = launch(launches, i, p, problem.phase[i])
        s[STATE.X + j] = x
        s[STATE.N + j] = n - problem.end_count[i]
        s[STATE.U + j] = launch_speed(fixed, problem, i, x)
        s[STATE.NUMBER + j] = 0.0
        s[STATE.WHO + j] = p
        late |= (begin.whole - s[STATE.N + j]) + (begin.phase - x) > 0.0
    for block in range(work.lanes.size):
        work.lanes[block] = min(LANES, particles - block * LANES)
    return Window(late, begin, Instant(0.0, problem.end_phase[i]))


@part
def next_landings(s: Floats, lanes: int, fixed: Constants, stop: Instant) -> None:
    """Find the next landing of each lane; take those up to the stop and leave the others be."""
    n_stop, x_stop = stop
    wide_vectors()
    shortest, origin = contact_time(fixed), fixed.source.end
    for j in range(lanes):
        n, x, u = s[STATE.N + j], s[STATE.X + j], s[STATE.U + j]
        hit = impact(fixed, n, x, u, s[STATE.WHO + j], s[STATE.NUMBER + j], origin)
        due = hit.n - n_stop <= x_stop - hit.x
        rest = 0.0 if hit.leaves else (hit.n_off - hit.n) + (hit.x_off - hit.x)
        rest = np.inf if hit.n_off == np.inf else rest  # the phase of a rest for good is NaN
        s[STATE.X_LAND + j] = hit.x
        s[STATE.N_LAND + j] = hit.n
        s[STATE.STAY + j] = rest if rest > shortest else shortest
        s[STATE.N_REST + j] = np.inf if hit.leaves else hit.n_off
        s[STATE.DUE + j] = 1.0 if due else 0.0
        s[STATE.X + j] = hit.x_off if due else s[STATE.X + j]
        s[STATE.N + j] = hit.n_off if due else s[STATE.N + j]
        s[STATE.U + j] = hit.u if due else s[STATE.U + j]
        s[STATE.NUMBER + j] += 1.0 if due else 0.0


@part
def append_due(s: Floats, lanes: int, listed: Floats, k: int) -> int:
    """Append the landings that were due to a list of k; return its length."""
    for j in range(lanes):  # each lane is written, and overwritten unless it was due
        listed[LIST.WHOLE, k], listed[LIST.PHASE, k] = s[STATE.N_LAND + j], s[STATE.X_LAND + j]
        listed[LIST.STAY, k], listed[LIST.WHO, k] = s[STATE.STAY + j], s[STATE.WHO + j]
        k += int(s[STATE.DUE + j])
    return k


@part
def due_first(s: Floats, lanes: int) -> int:
    """Move the lanes that were due to the front of their block; return how many there are."""
    front = 0
    for j in range(lanes):
        if s[STATE.DUE + j] != 0.0:
            if j > front:
                for row in (STATE.X, STATE.N, STATE.U, STATE.NUMBER, STATE.WHO):
                    kept = s[row + front]
                    s[row + front] = s[row + j]
                    s[row + j] = kept
            front += 1
    return front


@part
def compare(
    listed: Floats, k: int, latest: Listed, gap: float, shared: int
) -> tuple[Listed, float, int]:
    """Compare k ordered landings with their neighbours; `latest` is the last one before them.

    Returns the new `latest`, the smallest gap and whether the base was shared.
    """
    for i in range(k):
        landing = listed_at(listed, ORDERED, i)
        gap, shared = neighbours(latest, landing, gap, shared)
        latest = landing
    return latest, gap, shared
