"""Advance trajectories in time with running statistics; landings are not stored.

The inner loop over a block of lanes (see `memory`) has no branches and compiles to vector code.
Every `LOOK_AFTER` passes, lanes are checked: those past the end or out of budget are written out
and refilled with new trajectories.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from vibrosweep.kernels import bases, statistics
from vibrosweep.kernels._jit import Floats, Integers, jit, uncached, uncounted, wide_vectors
from vibrosweep.kernels.bases import Base, Constants, Counted, Flight, Instant
from vibrosweep.kernels.cycles import (
    CYCLE,
    FIRST_ANCHOR,
    Chosen,
    Cycles,
    Rests,
    close_cycle,
    recurs,
    saves_work,
    stop_search,
)
from vibrosweep.kernels.impact import Batch, Start, land, launch
from vibrosweep.kernels.memory import (
    ENDED,
    GOES_ON,
    LANES,
    RETURNED,
    ROW,
    SPENT,
    VECTOR,
    close_gaps,
    find_done,
)
from vibrosweep.kernels.noise import (
    OF_DRIVE,
    OF_KICK,
    OF_RESTITUTION,
    Key,
    Noise,
    Source,
    Word,
    deviate,
    deviates,
    period_of,
)
from vibrosweep.kernels.record import Recorder
from vibrosweep.kernels.statistics import Kinds, Observer, Statistics
from vibrosweep.model.measures import Status
from vibrosweep.model.observables import Landing
from vibrosweep.model.parameters import Dimensionless

# --- Noise: random numbers of the next impact of each lane ----------------------------------------


class NoiseRows(NamedTuple):
    """Rows of one kind of noise: of its strength, and of the deviates of two impacts."""

    purpose: Word
    size: int
    drawn: int
    following: int


RESTITUTIONS: Final = NoiseRows(
    OF_RESTITUTION, ROW.RESTITUTION_SIZE, ROW.RESTITUTION_DRAWN, ROW.RESTITUTION_NEXT
)
KICKS: Final = NoiseRows(OF_KICK, ROW.KICK_SIZE, ROW.KICK_DRAWN, ROW.KICK_NEXT)


@jit
def load_noise(
    noise: Noise | None, source: Source, s: Floats, j: int, particle: float, n_end: float
) -> None:
    """Put the noise of a realization into lane j, for a particle whose counts begin at n_end."""
    if noise is not None:
        s[ROW.STREAM + j], s[ROW.PARTICLE + j] = source.stream, particle
        s[ROW.ORIGIN + j], s[ROW.RESTING + j] = n_end + source.turns, 0.0
        s[ROW.RESTITUTION_SIZE + j], s[ROW.KICK_SIZE + j] = source.restitution, source.kick
        s[ROW.DRIVE_SIZE + j] = source.drive


@jit
def draw_all(noise: Noise | None, s: Floats, lanes: int, since: int, together: float) -> None:
    """Draw the random numbers of the next impact of the first lanes, in pass `since` after a check.

    If `together` is 1, every pass is an impact of each lane, and the number of impacts at the last
    check is even: each pair of deviates serves two successive impacts.  If it is 0, each lane
    counts its own impacts.
    """
    if noise is not None:
        wide_vectors()
        if together == 0.0:
            for j in range(lanes):
                _draw_one(noise.restitution, noise.key, s, j, RESTITUTIONS)
                _draw_one(noise.kick, noise.key, s, j, KICKS)
        elif since % 2 == 0:
            for j in range(lanes):
                _draw_two(noise.restitution, noise.key, s, j, since, RESTITUTIONS)
                _draw_two(noise.kick, noise.key, s, j, since, KICKS)
        else:
            for j in range(lanes):
                _take_second(noise.restitution, s, j, RESTITUTIONS)
                _take_second(noise.kick, s, j, KICKS)
        _draw_drives(noise.drive, noise.key, s, lanes)


@jit
def _draw_one(on: int | None, key: Key, s: Floats, j: int, rows: NoiseRows) -> None:
    if on is not None:
        stream, particle, age = s[ROW.STREAM + j], s[ROW.PARTICLE + j], s[ROW.AGE + j]
        s[rows.drawn + j] = s[rows.size + j] * deviate(key, stream, particle, age, rows.purpose)


@jit
def _draw_two(on: int | None, key: Key, s: Floats, j: int, since: int, rows: NoiseRows) -> None:
    if on is not None:
        stream, particle = s[ROW.STREAM + j], s[ROW.PARTICLE + j]
        pair = 0.5 * (s[ROW.AGE + j] + since)
        first, second = deviates(key, stream, particle, pair, rows.purpose)
        s[rows.drawn + j] = s[rows.size + j] * first
        s[rows.following + j] = s[rows.size + j] * second


@jit
def _take_second(on: int | None, s: Floats, j: int, rows: NoiseRows) -> None:
    if on is not None:
        s[rows.drawn + j] = s[rows.following + j]


@jit
def _draw_drives(on: int | None, key: Key, s: Floats, lanes: int) -> None:
    """Draw the amplitude of the period of the next landing, or of a period that may end a rest."""
    if on is not None:
        wide_vectors()
        for j in range(lanes):
            flown = s[ROW.U + j] if s[ROW.RESTING + j] == 0.0 else 0.0
            x, passed = land(s[ROW.X + j], flown)
            period = period_of(s[ROW.N + j] + passed + s[ROW.ORIGIN + j], x)
            drawn = deviate(key, s[ROW.STREAM + j], 0.0, period, OF_DRIVE)
            s[ROW.DRIVE_DRAWN + j] = s[ROW.DRIVE_SIZE + j] * drawn


@jit
def note_rest(noise: Noise | None, s: Floats, j: int, rests: bool) -> None:
    """Note whether lane j has come to rest, until a forcing period lifts it."""
    if noise is not None and noise.drive is not None:
        waits = s[ROW.RESTING + j]
        s[ROW.RESTING + j] = 1.0 if rests else waits if waits > 0.0 else 0.0


COMPLETED = int(Status.COMPLETED)
BUDGET_EXCEEDED = int(Status.BUDGET_EXCEEDED)
NON_FINITE = int(Status.NON_FINITE)
LOOK_AFTER = 6  # passes between two checks of which lanes are done


class Options(NamedTuple):
    """Limits and cycle detection."""

    budget: int  # largest number of impacts of a trajectory; a multiple of `LOOK_AFTER`
    # Forcing periods: cycles of trajectories shorter than this are not searched for, unless
    # `all_cycles` is 1
    patience: float = 0.0
    all_cycles: int = 0  # 1 to find every cycle, 0 to find only those that save work
    jump: int = 1  # 1 to skip repetitions of cycles, 0 to simulate every impact nevertheless
    # Called for every landing in the window, or None; must be None if `cycles` are given
    observer: Observer | Recorder | None = None


class Share(NamedTuple):
    """The trajectories of one call: those to start, and how many are in progress before it."""

    first: int
    last: int  # the one behind the last
    in_progress: int


class Memory(NamedTuple):
    """Memory of one caller: a block of lanes, and the places in it that are refilled."""

    block: Floats
    places: Integers


def memory_around(block: Floats) -> Memory:
    """Memory for one caller around its block of lanes, such as one from `scratch`."""
    return Memory(block, np.empty(LANES, np.int64))


class Realization(NamedTuple):
    """Data shared by the trajectories of a realization: constants, launch speed and window."""

    fixed: Constants
    speed: float
    end: Instant
    begin: Instant


@jit
def _step(
    s: Floats,
    lanes: int,
    chosen: Chosen,
    budget: float,
    window: int | None,
    observer: Observer | Recorder | None,
    live: int,
    since: int,
) -> None:
    """Make one pass over the first lanes, pass `since` after their last check.

    A lane past its end continues without being counted.  If `window` is None, the code that checks
    the beginning of the window is not compiled; if `observer` is None, neither is the code that
    calls it for the first `live` lanes.
    """
    wide_vectors()
    draw_all(chosen.base.noise, s, lanes, since, bases.common_age(chosen.base))
    bases.prepare(chosen.base, s, lanes)
    for j in range(lanes):
        fixed = bases.take(chosen.base, s, j)
        n_from, x_from, u_from = s[ROW.N + j], s[ROW.X + j], s[ROW.U + j]
        time, v, landed = bases.approach(fixed, s, j)
        x, passed = land(x_from, time)
        n = n_from + passed
        inside = n <= s[ROW.X_END + j] - x
        # the budget does not apply to the first landing after the end, which ends a counted flight
        landed = landed & (bases.may_land(fixed, s, j, budget) | (not inside))
        seen = landed & inside
        # a particle at rest for good has the phase NaN, which is never before the end
        n_off, x_off, u, leaves = bases.lift_off(fixed, n, x, bases.rebound(fixed, x, v))
        if window is not None:
            # a rest that begins after the end must leave no NaN; the phase 1/2 is after the end
            x_off = 0.5 if n > s[ROW.X_END + j] - x else x_off
            seen = seen & (s[ROW.N_BEGIN + j] - n <= x - s[ROW.X_BEGIN + j])
        landing = Landing(x, time, v, u, not leaves)
        if observer is not None:
            statistics.note(s, j, landing, n, seen)
        note_rest(chosen.base.noise, s, j, landed & (not leaves) & (x_off == x_off))
        flight = bases.counted_now(fixed, s, j, time, u)
        ends = bases.end_pass(fixed, s, j, time, landed, seen)
        statistics.count(chosen.kinds, s, j, landing, flight, seen, ends)
        s[ROW.N + j] = n_off if landed else n_from
        s[ROW.X + j] = x_off if landed else x_from
        s[ROW.U + j] = u if landed else u_from
    if observer is not None:
        statistics.observe(observer, s, live, chosen.base)


@jit
def _mark(s: Floats, lanes: int, chosen: Chosen, budget: int, cycles: Cycles | None) -> None:
    """Mark lanes that have ended, recur, or have spent their budget; save anchors that are due."""
    wide_vectors()
    for j in range(lanes):
        s[ROW.AGE + j] += LOOK_AFTER * bases.common_age(chosen.base)
        why = SPENT if s[ROW.AGE + j] >= budget else GOES_ON
        if cycles is not None:
            # the same state, bit for bit: from here on the orbit repeats, shifted by whole periods
            again = (s[ROW.X + j] == s[ROW.X_ANCHOR + j]) & (s[ROW.U + j] == s[ROW.U_ANCHOR + j])
            why = RETURNED if again else why
            if (s[ROW.AGE + j] >= s[ROW.NEXT_ANCHOR + j]) & (not again):
                s[ROW.X_ANCHOR + j] = s[ROW.X + j]
                s[ROW.N_ANCHOR + j] = s[ROW.N + j]
                s[ROW.U_ANCHOR + j] = s[ROW.U + j]
                s[ROW.RESTS_ANCHOR + j] = s[statistics.OF_RESTS + j]
                s[ROW.NEXT_ANCHOR + j] = 2.0 * s[ROW.AGE + j]
        goes_on = s[ROW.N + j] <= s[ROW.X_END + j] - s[ROW.X + j]
        lost = bases.abandons(chosen.base, s, j, LOOK_AFTER)
        statistics.sum_up(chosen.kinds, s, j, lost)
        s[ROW.DONE + j] = why if goes_on & (not lost) else ENDED


@jit
def _realization(base: Base, problem: Dimensionless, i: int) -> Realization:
    return Realization(
        bases.constants(base, problem, i),
        problem.launch_flight[i],
        Instant(problem.end_count[i], problem.end_phase[i]),
        Instant(problem.begin_count[i], problem.begin_phase[i]),
    )


@jit
def _load(
    s: Floats,
    j: int,
    start: Start,
    realization: Realization,
    kinds: Kinds,
    window: int | None,
    cycles: Cycles | None,
    patience: float,
) -> None:
    """Load a trajectory into lane j."""
    n, x = start.at
    n_end, x_end = realization.end
    s[ROW.X + j] = x
    s[ROW.N + j] = n - n_end
    s[ROW.U + j] = bases.leave(realization.fixed, x, realization.speed)
    bases.put(realization.fixed, s, j)
    load_noise(realization.fixed.base.noise, realization.fixed.source, s, j, start.particle, n_end)
    s[ROW.X_END + j] = x_end
    if window is not None:
        n_begin, x_begin = realization.begin
        s[ROW.N_BEGIN + j] = n_begin - n_end
        s[ROW.X_BEGIN + j] = x_begin
    s[ROW.AGE + j] = 0.0
    s[ROW.LANE + j] = start.lane
    statistics.clear(kinds, s, j)
    if cycles is not None:
        s[ROW.X_ANCHOR + j] = np.nan
        s[ROW.NEXT_ANCHOR + j] = FIRST_ANCHOR if n_end - n > patience else np.inf
        cycles[CYCLE.IMPACTS, start.lane] = 0.0  # none is known yet


@jit
def _write(s: Floats, j: int, base: Base, window: int | None, out: Statistics) -> None:
    """Write the statistics of the trajectory in place j to its own slot."""
    # arrays are used last outside branches: otherwise numba counts references at every call
    lane = int(s[ROW.LANE + j]) if j >= 0 else -1
    # Never true.  Here and in `advance` this tells the compiler that no index is negative: without
    # both, short runs took 3 % (12 periods) to 9 % (3 periods) longer to wrap negative indices
    if lane < 0:
        return
    over = False
    fixed = bases.take(base, s, j)
    # the last counted flight has not ended yet, such as one that follows a rest across the end
    waits = bases.pending(base, s, j)
    last = Counted(0.0, 0.0, 0.0)
    if waits or s[ROW.DONE + j] == SPENT:
        x_off, u = s[ROW.X + j], s[ROW.U + j]
        time, v = bases.fly(fixed, x_off, u)
        x, passed = land(x_off, time)
        over = s[ROW.DONE + j] == SPENT and s[ROW.N + j] + passed <= s[ROW.X_END + j] - x
        if waits:
            last = bases.counted(fixed, Flight(x_off, u, time, x, v), 0.0)
    totals, sums = statistics.with_flight(out.kinds, statistics.totals_of(out.kinds, s, j), last)
    for k in range(len(totals)):
        out.totals[k, lane] = totals[k]
    abandoned = s[ROW.AGE + j] == np.inf  # the search for the end of a rest was abandoned
    for_good = np.isnan(s[ROW.X + j]) and not abandoned
    if window is None:  # a rest that was not counted began after the end
        for_good = for_good and totals[statistics.RESTS] > 0.0
    out.at_rest[lane] = 1 if for_good else 0
    out.status[lane] = BUDGET_EXCEEDED if over or abandoned else COMPLETED
    if not np.isfinite(sums):
        out.status[lane] = NON_FINITE


@uncounted
def advance(
    share: Share,
    batch: Batch,
    options: Options,
    window: int | None,
    memory: Memory,
    out: Statistics,
    cycles: Cycles | None,
    rests: Rests | None,
) -> int:
    """Advance trajectories of a batch to the end of their window; return how many are in progress.

    When too few new trajectories are left to fill the block, those in progress stay in it until the
    next call, which must have the same arguments apart from the share.  The share states how many
    are in progress: 0, or the number that the previous call returned.  A share without new
    trajectories finishes those in progress.

    `window` is 1 if the window may begin after a launch, and None otherwise; `memory` is from
    `memory_around` and, like `rests`, not shared between threads.  With `cycles` and `rests`, a
    trajectory is simulated until its state recurs bit for bit; the remaining cycles are added
    exactly, not simulated.  Sums then differ from those of a full simulation by rounding only.
    """
    base, problem, launches = batch
    s, places = memory
    chosen = Chosen(base, out.kinds)
    budget = float(options.budget)
    first, last, lanes = share
    particles = launches.whole.shape[1]
    i, p = first // particles, first % particles
    realization = _realization(base, problem, min(i, problem.kick.size - 1))
    patience = 0.0 if options.all_cycles == 1 else options.patience
    following, done = first, min(LANES - lanes, last - first)
    for q in range(done):
        places[q] = lanes + q
    lanes += done
    while lanes > 0:
        fresh = min(done, last - following)
        for q in range(fresh):
            lane = following + q
            if i < 0 or p < 0 or places[q] < 0:  # never, see `_write`
                return 0
            start = Start(lane, p, launch(launches, i, p, problem.phase[i]))
            _load(s, places[q], start, realization, out.kinds, window, cycles, patience)
            statistics.expect(out.kinds, out, lane)
            p += 1
            if p == particles:
                i, p = i + 1, 0
                realization = _realization(base, problem, min(i, problem.kick.size - 1))
        following += fresh
        lanes = close_gaps(s, lanes, places, fresh, done)
        if lanes < LANES and first < last:
            return lanes
        # whole vectors only: lanes behind the last one contain stale, harmless numbers
        padded = (lanes + VECTOR - 1) // VECTOR * VECTOR
        for since in range(LOOK_AFTER):
            _step(s, padded, chosen, budget, window, options.observer, lanes, since)
        _mark(s, padded, chosen, options.budget, cycles)
        done = find_done(s, lanes, places)
        if cycles is not None and rests is not None:
            # in a separate function numba would count references to all its array arguments
            listed, done = done, 0
            for q in range(listed):
                j = places[q]
                if s[ROW.DONE + j] == RETURNED:
                    later = recurs(s, j)
                    if later and (options.all_cycles == 1 or saves_work(s, j, options.jump)):
                        where = int(s[ROW.LANE + j]) // particles
                        close_cycle(s, j, where, chosen, window, options.jump, cycles, rests)
                    elif later:
                        stop_search(s, j)
                    if s[ROW.AGE + j] < options.budget:
                        continue
                    s[ROW.DONE + j] = SPENT
                places[done] = j
                done += 1
        for q in range(done):
            _write(s, places[q], base, window, out)
    return 0


# Machine code for a function that only this process has is not saved on disk
advance_uncached = uncached(advance)
