"""Trajectories through time with running statistics; no landing is stored.

The inner loop runs over a block of lanes (see `lanes`) without a branch and becomes vector code;
every `LOOK_AFTER` impacts the lanes whose next landing lies past the end are written out and their
places are filled again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, Integers, fma, jit, kernel, wide_vectors
from vibrosweep.kernels.bases import Base, Scene, fly, lift_off, put, rebound, scene, take
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
from vibrosweep.kernels.impact import Batch, Instant, land, launch
from vibrosweep.kernels.lanes import (
    ENDED,
    GOES_ON,
    LANES,
    RETURNED,
    ROW,
    ROWS,
    SPENT,
    STRIDE,
    VECTOR,
)
from vibrosweep.kernels.statistics import Statistics, expect, write
from vibrosweep.model.parameters import Dimensionless

__all__ = ["LOOK_AFTER", "Options", "advance"]

LOOK_AFTER = 6  # impacts between two looks at what is done


class Options(NamedTuple):
    """How far trajectories are followed.

    Attributes
    ----------
    budget
        Impacts after which a trajectory is given up; a multiple of `LOOK_AFTER`.
    patience
        Forcing periods; where fewer remain at the launch no recurrence is looked for, unless all
        are asked for.
    all_cycles
        1 to look for every cycle, 0 for those only that save work.
    jump
        0 to find cycles and to follow the trajectories nevertheless.
    """

    budget: int
    patience: float = 0.0
    all_cycles: int = 0
    jump: int = 1


class Watch(NamedTuple):
    """What the trajectories of a realization have in common."""

    fixed: Scene
    flight: float
    end: Instant
    begin: Instant


@jit
def _step(s: Floats, lanes: int, base: Base, window: int | None) -> None:
    """One impact of every lane; a lane past its end goes on harmlessly and counts nothing.

    Without a window, None, what looks at its beginning is not compiled.
    """
    wide_vectors()
    for j in range(lanes):
        fixed = take(base, s, j)
        flight, v = fly(fixed, s[ROW.X + j], s[ROW.U + j])
        x, passed = land(s[ROW.X + j], flight)
        n = s[ROW.N + j] + passed
        seen = n <= s[ROW.X_END + j] - x
        # a rest for good leaves no phase, and what has none is never again before any end
        n_off, x_off, u, leaves = lift_off(fixed, n, x, rebound(fixed, x, v))
        if window is not None:
            # after the end it is not observed; at 1/2 nothing is before an end that x is behind
            x_off = 0.5 if n > s[ROW.X_END + j] - x else x_off
            seen = seen & (s[ROW.N_BEGIN + j] - n <= x - s[ROW.X_BEGIN + j])
        counted = u if seen else 0.0
        s[ROW.N + j] = n_off
        s[ROW.X + j] = x_off
        s[ROW.U + j] = u
        s[ROW.LANDINGS + j] = s[ROW.LANDINGS + j] + 1.0 if seen else s[ROW.LANDINGS + j]
        s[ROW.RESTS + j] += 0.0 if leaves else (1.0 if seen else 0.0)
        s[ROW.NEW_SUM + j] += counted
        s[ROW.NEW_SQUARES + j] = fma(counted, counted, s[ROW.NEW_SQUARES + j])
        s[ROW.LARGEST + j] = counted if counted > s[ROW.LARGEST + j] else s[ROW.LARGEST + j]


@jit
def _mark(s: Floats, lanes: int, budget: int, cycles: Cycles | None) -> None:
    """Mark the lanes that have ended, returned or spent their budget; move anchors that are due."""
    wide_vectors()
    for j in range(lanes):
        s[ROW.AGE + j] += LOOK_AFTER
        # sums of sums, which over a long orbit are rounded a sixth as often
        s[ROW.SUM + j] += s[ROW.NEW_SUM + j]
        s[ROW.SQUARES + j] += s[ROW.NEW_SQUARES + j]
        s[ROW.NEW_SUM + j] = s[ROW.NEW_SQUARES + j] = 0.0
        why = SPENT if s[ROW.AGE + j] >= budget else GOES_ON
        if cycles is not None:
            # the same bits again: from here on the orbit repeats, later by whole periods
            again = (s[ROW.X + j] == s[ROW.X_ANCHOR + j]) & (s[ROW.U + j] == s[ROW.U_ANCHOR + j])
            why = RETURNED if again else why
            if (s[ROW.AGE + j] >= s[ROW.NEXT_ANCHOR + j]) & (not again):
                s[ROW.X_ANCHOR + j] = s[ROW.X + j]
                s[ROW.N_ANCHOR + j] = s[ROW.N + j]
                s[ROW.U_ANCHOR + j] = s[ROW.U + j]
                s[ROW.RESTS_ANCHOR + j] = s[ROW.RESTS + j]
                s[ROW.NEXT_ANCHOR + j] = 2.0 * s[ROW.AGE + j]
        s[ROW.DONE + j] = why if s[ROW.N + j] <= s[ROW.X_END + j] - s[ROW.X + j] else ENDED


@jit
def _find_done(s: Floats, lanes: int, places: Integers) -> int:
    """List the places of the lanes that are marked; return their number."""
    done = 0
    for j in range(lanes):  # without a branch, which no processor could predict
        places[done] = j
        done += 1 if s[ROW.DONE + j] != GOES_ON else 0
    return done


@jit
def _watch(base: Base, problem: Dimensionless, i: int) -> Watch:
    return Watch(
        scene(base, problem, i),
        problem.launch_flight[i],
        (problem.end_count[i], problem.end_phase[i]),
        (problem.begin_count[i], problem.begin_phase[i]),
    )


@jit
def _load(
    s: Floats,
    j: int,
    lane: int,
    start: Instant,
    watch: Watch,
    windowed: bool,
    cycles: Cycles | None,
    patience: float,
) -> None:
    """Put trajectory `lane`, which leaves the base at `start`, into place j."""
    n, x = start
    n_end, x_end = watch.end
    s[ROW.X + j] = x
    s[ROW.N + j] = n - n_end
    s[ROW.U + j] = watch.flight
    put(watch.fixed, s, j)
    s[ROW.X_END + j] = x_end
    if windowed:
        n_begin, x_begin = watch.begin
        s[ROW.N_BEGIN + j] = n_begin - n_end
        s[ROW.X_BEGIN + j] = x_begin
    s[ROW.LANDINGS + j] = s[ROW.RESTS + j] = s[ROW.AGE + j] = 0.0
    s[ROW.SUM + j] = s[ROW.SQUARES + j] = s[ROW.LARGEST + j] = 0.0
    s[ROW.LANE + j] = lane
    if cycles is not None:
        s[ROW.X_ANCHOR + j] = np.nan
        s[ROW.CYCLE_IMPACTS + j] = 0.0
        s[ROW.NEXT_ANCHOR + j] = FIRST_ANCHOR if n_end - n > patience else np.inf
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
    span: tuple[int, int, int],
    batch: Batch,
    options: Options,
    windowed: bool,
    s: Floats,
    out: Statistics,
    cycles: Cycles | None,
    rests: Rests | None,
) -> int:
    """Advance trajectories of a batch to the end of their window.

    Those that are under way when there are too few to fill the block stay in it until the next
    call, which therefore takes the same arguments, apart from the span.

    Parameters
    ----------
    span
        Trajectories ``span[0] ... span[1] - 1`` are begun, while ``span[2]`` are under way: 0, or
        what the call before returned.  With none to begin, those that are under way are finished.
    batch : vibrosweep.kernels.impact.Batch
    options : Options
    windowed
        Whether the window may begin after a launch.
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

    Returns
    -------
    int
        Number of trajectories under way.
    """
    base, problem, launches = batch
    first, last, lanes = span
    particles = launches.whole.shape[1]
    i, p = first // particles, first % particles
    watch = _watch(base, problem, min(i, problem.kick.size - 1))
    patience = 0.0 if options.all_cycles == 1 else options.patience
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
            start = launch(launches, i, p, problem.phase[i])
            _load(s, places[q], lane, start, watch, windowed, cycles, patience)
            expect(out, lane)
            p += 1
            if p == particles:
                i, p = i + 1, 0
                watch = _watch(base, problem, min(i, problem.kick.size - 1))
        following += fresh
        lanes = _close_gaps(s, lanes, places, fresh, done)
        if lanes < LANES and first < last:
            return lanes
        # whole vectors only: the places behind the last lane hold stale, harmless numbers
        padded = (lanes + VECTOR - 1) // VECTOR * VECTOR
        for _ in range(LOOK_AFTER):
            if windowed:
                _step(s, padded, base, 1)
            else:
                _step(s, padded, base, None)
        _mark(s, padded, options.budget, cycles)
        done = _find_done(s, lanes, places)
        if cycles is not None and rests is not None:
            # here and not in a function: numba would count references to all arrays that it takes
            listed, done = done, 0
            for q in range(listed):
                j = places[q]
                if s[ROW.DONE + j] == RETURNED:
                    later = has_returned(s, j)
                    if later and (options.all_cycles == 1 or saves_work(s, j, options.jump)):
                        realization = int(s[ROW.LANE + j]) // particles
                        close_cycle(s, j, realization, base, windowed, options.jump, cycles, rests)
                    elif later:
                        forget_anchor(s, j)
                    if s[ROW.AGE + j] < options.budget:
                        continue
                    s[ROW.DONE + j] = SPENT
                places[done] = j
                done += 1
        for q in range(done):
            write(s, places[q], base, windowed, out)
    return 0
