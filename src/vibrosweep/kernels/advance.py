"""Trajectories through time with running statistics; no landing is stored.

The inner loop runs over a block of lanes (see `lanes`) without a branch and becomes vector code;
every `CHECK` impacts the lanes whose next landing lies past the end are written out and their
places are filled again.
"""

from __future__ import annotations

import numpy as np

from vibrosweep.kernels._jit import Floats, Integers, fma, jit, kernel
from vibrosweep.kernels.cycles import (
    FIRST_ANCHOR,
    Cycles,
    Rests,
    close_cycle,
    forget_anchor,
    has_returned,
    no_cycle,
    saves_work,
)
from vibrosweep.kernels.impact import land, launch, lift_off, rebound, scene
from vibrosweep.kernels.lanes import (
    AGE,
    C_IMPACTS,
    DONE,
    ENDED,
    GOES_ON,
    LANDINGS,
    LANE,
    LANES,
    LARGEST,
    N_ANCHOR,
    N_BEGIN,
    NEW_SQUARES,
    NEW_SUM,
    NEXT_ANCHOR,
    RESTS,
    RESTS_ANCHOR,
    RETURNED,
    ROWS,
    SPENT,
    SQUARES,
    STRIDE,
    SUM,
    U_ANCHOR,
    U_LIFT,
    VECTOR,
    X_ANCHOR,
    X_BEGIN,
    X_END,
    X_LIFT,
    A,
    E,
    N,
    R,
    U,
    X,
)
from vibrosweep.kernels.statistics import Statistics, expect, write
from vibrosweep.scene import Dimensionless, Launches

__all__ = ["CHECK", "advance"]

CHECK = 6  # impacts between two looks at what is done

# of a realization: its scene, first flight, and count and phase of the end and of the begin
Constants = tuple[float, float, float, float, float, float, float, float, float, float, float]


@jit
def _step(s: Floats, lanes: int, reflect: int | None, window: int | None) -> None:
    """One impact of every lane; a lane past its end goes on harmlessly and counts nothing."""
    for j in range(lanes):
        x, passed = land(s[X + j], s[U + j])
        n = s[N + j] + passed
        w = rebound(x, s[U + j], s[E + j], s[A + j], reflect)
        seen = n <= s[X_END + j] - x
        # a rest for good leaves no phase, and what has none is never again before any end
        x_lift = s[X_LIFT + j]
        if window is not None:  # after the end it is not observed
            x_lift = 0.0 if n > s[X_END + j] - x else x_lift
        n_off, x_off, u, leaves = lift_off(n, x, w, s[R + j], x_lift, 0.0, s[U_LIFT + j])
        if window is not None:
            seen = seen & (s[N_BEGIN + j] - n <= x - s[X_BEGIN + j])
        counted = u if seen else 0.0
        s[N + j] = n_off
        s[X + j] = x_off
        s[U + j] = u
        s[LANDINGS + j] = s[LANDINGS + j] + 1.0 if seen else s[LANDINGS + j]
        s[RESTS + j] += 0.0 if leaves else (1.0 if seen else 0.0)
        s[NEW_SUM + j] += counted
        s[NEW_SQUARES + j] = fma(counted, counted, s[NEW_SQUARES + j])
        s[LARGEST + j] = counted if counted > s[LARGEST + j] else s[LARGEST + j]


@jit
def _mark(s: Floats, lanes: int, budget: int, cycles: Cycles | None) -> None:
    """Mark the lanes that have ended, returned or spent their budget; move anchors that are due."""
    for j in range(lanes):
        s[AGE + j] += CHECK
        # sums of sums, which over a long orbit are rounded a sixth as often
        s[SUM + j] += s[NEW_SUM + j]
        s[SQUARES + j] += s[NEW_SQUARES + j]
        s[NEW_SUM + j] = s[NEW_SQUARES + j] = 0.0
        why = SPENT if s[AGE + j] >= budget else GOES_ON
        if cycles is not None:
            # the same bits again: from here on the orbit repeats, later by whole periods
            again = (s[X + j] == s[X_ANCHOR + j]) & (s[U + j] == s[U_ANCHOR + j])
            why = RETURNED if again else why
            if (s[AGE + j] >= s[NEXT_ANCHOR + j]) & (not again):
                s[X_ANCHOR + j] = s[X + j]
                s[N_ANCHOR + j] = s[N + j]
                s[U_ANCHOR + j] = s[U + j]
                s[RESTS_ANCHOR + j] = s[RESTS + j]
                s[NEXT_ANCHOR + j] = 2.0 * s[AGE + j]
        s[DONE + j] = why if s[N + j] <= s[X_END + j] - s[X + j] else ENDED


@jit
def _find_done(s: Floats, lanes: int, places: Integers) -> int:
    """List the places of the lanes that are marked; return their number."""
    done = 0
    for j in range(lanes):  # without a branch, which no processor could predict
        places[done] = j
        done += 1 if s[DONE + j] != GOES_ON else 0
    return done


@jit
def _constants(problem: Dimensionless, i: int) -> Constants:
    """What the trajectories of realization i have in common."""
    return (
        *scene(problem, i),
        problem.launch_flight[i],
        problem.end_count[i],
        problem.end_phase[i],
        problem.begin_count[i],
        problem.begin_phase[i],
    )


@jit
def _load(
    s: Floats,
    j: int,
    lane: int,
    start: tuple[float, float],
    constants: Constants,
    window: int | None,
    cycles: Cycles | None,
    patience: float,
) -> None:
    """Put trajectory `lane`, which leaves the base at `start`, into place j."""
    e, a, r, x_lift, wait, u_lift, u, n_end, x_end, n_begin, x_begin = constants
    n, x = start
    s[X + j] = x
    s[N + j] = n - n_end
    s[U + j] = u
    s[E + j] = e
    s[A + j] = a
    s[R + j] = r
    s[X_LIFT + j] = x_lift if wait == 0.0 else np.nan
    s[U_LIFT + j] = u_lift
    s[X_END + j] = x_end
    if window is not None:
        s[N_BEGIN + j] = n_begin - n_end
        s[X_BEGIN + j] = x_begin
    s[LANDINGS + j] = s[RESTS + j] = s[AGE + j] = 0.0
    s[SUM + j] = s[SQUARES + j] = s[LARGEST + j] = 0.0
    s[LANE + j] = lane
    if cycles is not None:
        s[X_ANCHOR + j] = np.nan
        s[C_IMPACTS + j] = 0.0
        s[NEXT_ANCHOR + j] = FIRST_ANCHOR if n_end - n > patience else np.inf
        no_cycle(cycles, lane)


@jit
def _close_gaps(s: Floats, lanes: int, places: Integers, fresh: int, done: int) -> int:
    """Move the last lanes to the places that were not filled again; return how many are left."""
    for q in range(done - 1, fresh - 1, -1):  # the last one first
        lanes -= 1
        for row in range(ROWS):
            s[row * STRIDE + places[q]] = s[row * STRIDE + lanes]
    return lanes


@kernel
def advance(
    first: int,
    last: int,
    lanes: int,
    problem: Dimensionless,
    launches: Launches,
    budget: int,
    reflect: int | None,
    window: int | None,
    s: Floats,
    out: Statistics,
    cycles: Cycles | None = None,
    rests: Rests | None = None,
    patience: float = 0.0,
    all_cycles: int = 0,
    jump: int = 1,
) -> int:
    """Advance trajectories of a batch to the end of their window.

    Those that are under way when there are too few to fill the block stay in it until the next
    call, which therefore takes the same arguments, apart from the first three.

    Parameters
    ----------
    first, last
        Trajectories ``first ... last - 1`` are begun; trajectory t is particle t % N of realization
        t // N.  With none to begin, those that are under way are finished.
    lanes
        Number of trajectories that are under way: 0, or what the call before returned.
    problem : vibrosweep.scene.Dimensionless
    launches : vibrosweep.scene.Launches
    budget
        Impacts after which a trajectory is given up; a multiple of `CHECK`.
    reflect, window
        None, or 1 for the `reflect` law and for a window that begins after the launch; chosen at
        compile time.
    s
        From `scratch`; not shared between threads.
    out : Statistics
        Only the slots of trajectories that were begun by this caller are written.
    cycles
        From `empty_cycles`, or None.  Where given, a trajectory whose state returns bit for bit is
        not followed any further: the rest is counted from one cycle.  Sums then differ from those
        of going on by rounding only.
    rests
        From `empty_rests`, or None.  Not shared between threads; given with `cycles`.
    patience
        Forcing periods; where fewer remain at the launch no recurrence is looked for, unless all
        are asked for.
    all_cycles
        1 to look for every cycle, 0 for those only that save work.
    jump
        0 to find cycles and to follow the trajectories nevertheless.

    Returns
    -------
    int
        Number of trajectories under way.
    """
    particles = launches.whole.shape[1]
    i, p = first // particles, first % particles
    constants = _constants(problem, min(i, problem.kick.size - 1))
    if all_cycles:
        patience = 0.0
    following = first
    places = np.arange(lanes, lanes + LANES)
    done = min(LANES - lanes, last - first)
    lanes += done
    while lanes > 0:
        fresh = min(done, last - following)
        for q in range(fresh):
            lane = following + q
            if i < 0 or p < 0 or places[q] < 0:  # never, see `write`
                return 0
            start = launch(problem, launches, i, p)
            _load(s, places[q], lane, start, constants, window, cycles, patience)
            expect(out, lane)
            p += 1
            if p == particles:
                i, p = i + 1, 0
                constants = _constants(problem, min(i, problem.kick.size - 1))
        following += fresh
        lanes = _close_gaps(s, lanes, places, fresh, done)
        if lanes < LANES and first < last:
            return lanes
        # whole vectors only: the places behind the last lane hold stale, harmless numbers
        padded = (lanes + VECTOR - 1) // VECTOR * VECTOR
        for _ in range(CHECK):
            _step(s, padded, reflect, window)
        _mark(s, padded, budget, cycles)
        done = _find_done(s, lanes, places)
        if cycles is not None and rests is not None:
            # here and not in a function: numba would count references to all arrays that it takes
            listed, done = done, 0
            for q in range(listed):
                j = places[q]
                if s[DONE + j] == RETURNED:
                    later = has_returned(s, j)
                    if later and (all_cycles == 1 or saves_work(s, j, jump)):
                        realization = int(s[LANE + j]) // particles
                        close_cycle(s, j, realization, reflect, window, jump, cycles, rests)
                    elif later:
                        forget_anchor(s, j)
                    if s[AGE + j] < budget:
                        continue
                    s[DONE + j] = SPENT
                places[done] = j
                done += 1
        for q in range(done):
            write(s, places[q], window, out)
    return 0
