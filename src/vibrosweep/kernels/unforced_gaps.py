"""Separations without excitation: every landing from a closed form, nothing iterated.

All particles of a realization make the same geometric series of flights.  Landing n is
e^n u / (1 - e) before the limit of the series, which is u / (1 - e) after the launch; that limit is
common to all, so that what rounding does to it is in no difference.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels._jit import Floats, jit, kernel
from vibrosweep.kernels.impact import launch, scene
from vibrosweep.kernels.lanes import LANES
from vibrosweep.kernels.ordering import (
    DUE,
    LASTS,
    N_REST,
    ORDERED,
    PHASE,
    WHO,
    WHO_LANDS,
    WHOLE,
    N,
    U,
    Workspace,
    X,
    put_in_order,
)
from vibrosweep.kernels.separation import Separations
from vibrosweep.kernels.slabs import UNKNOWN, all_landings
from vibrosweep.kernels.unforced import landings_seen, whole_series
from vibrosweep.scene import Dimensionless, Launches

__all__ = ["separate_unforced"]


@jit
def _before_limit(e: float, u: float, last: int) -> Floats:
    """Whole periods and phase from landings 0 ... last to the limit, shape (2, last + 1)."""
    found = np.empty((2, last + 1))
    for number in range(last + 1):
        left = e ** float(number) * u / (1.0 - e)
        found[0, number] = np.rint(left)
        found[1, number] = left - found[0, number]
    return found


@jit
def _start(
    work: Workspace, problem: Dimensionless, launches: Launches, i: int
) -> tuple[int, float]:
    """Place all particles; return the number of the last landing and the period of the first."""
    limit = problem.launch_flight[i] / (1.0 - problem.restitution[i])
    whole = np.rint(limit)
    final, total = whole_series(problem, i)
    latest, first = 0.0, np.inf
    particles = launches.whole.shape[1]
    for block in range(work.lanes.size):
        s = work.state[block]
        work.lanes[block] = min(LANES, particles - block * LANES)
        for j in range(work.lanes[block]):
            p = block * LANES + j
            n, x = launch(problem, launches, i, p)
            before, by = landings_seen(problem, i, (n, x), final, total)
            latest = max(latest, by)
            n -= problem.end_count[i]
            first = min(first, n)
            work.listed[WHOLE, p], work.listed[PHASE, p] = n, x
            work.listed[LASTS, p], work.listed[WHO_LANDS, p] = before, by
            s[N + j], s[X + j] = n + whole, x + (limit - whole)
            s[WHO + j], s[DUE + j], s[N_REST + j] = p, before, by
            s[U + j] = max(1.0, before)  # the last one before the window may lie on the base
    return int(latest), first


@jit
def _same_number(work: Workspace, particles: int) -> float:
    """Smallest gap between landings of equal number: that of launches one after the other."""
    listed = work.listed
    n, x, span = listed[WHOLE, 0], listed[PHASE, 0], 0.0
    for p in range(particles):
        span = max(span, abs((listed[WHOLE, p] - n) + (listed[PHASE, p] - x)))
    put_in_order(listed, work.cells, particles, n, x - span, 2.0 * span)
    gap = np.inf
    for p in range(1, particles):
        apart = (listed[ORDERED + WHOLE, p] - listed[ORDERED + WHOLE, p - 1]) + (
            listed[ORDERED + PHASE, p] - listed[ORDERED + PHASE, p - 1]
        )
        before = max(listed[ORDERED + LASTS, p], listed[ORDERED + LASTS, p - 1])
        by = min(listed[ORDERED + WHO_LANDS, p], listed[ORDERED + WHO_LANDS, p - 1])
        gap = apart if before < by and apart < gap else gap
    return gap


@kernel
def separate_unforced(
    first: int,
    last: int,
    problem: Dimensionless,
    launches: Launches,
    closed: NDArray[np.bool_],
    window: int | None,
    work: Workspace,
    out: Separations,
) -> None:
    """Measure the separations of realizations first ... last - 1 without excitation.

    Parameters
    ----------
    first, last
        Range of realizations.
    problem : vibrosweep.scene.Dimensionless
    launches : vibrosweep.scene.Launches
    closed
        Shape (realization,): those for which `vibrosweep.kernels.unforced.has_closed_form`; no
        other is measured.
    window
        None, or 1 for a window that begins after the launch; chosen at compile time.
    work : Workspace
        Not shared between threads.
    out : Separations
        Only the slots of these realizations are written.
    """
    particles = launches.whole.shape[1]
    for i in range(first, last):
        if not closed[i]:
            continue
        final, _ = whole_series(problem, i)
        latest, n_first = _start(work, problem, launches, i)
        same = _same_number(work, particles)
        table = _before_limit(problem.restitution[i], problem.launch_flight[i], latest)
        series = (table, problem.rest_flight[i], int(final))
        begin = (problem.begin_count[i] - problem.end_count[i], problem.begin_phase[i])
        # no landing after the end is in any lane: a period more lets rounding leave out none before
        end = (1.0, problem.end_phase[i])
        fixed = scene(problem, i)
        gap, shared = all_landings(fixed, window, begin, end, None, series, n_first, work)
        out.shared[i] = shared
        if shared != UNKNOWN:
            out.gap[i] = gap if gap < np.inf else np.nan
            out.same[i] = same if same < np.inf else np.nan
