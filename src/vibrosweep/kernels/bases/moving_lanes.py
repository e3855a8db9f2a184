"""The moving base in the vector kernel: a pass makes one step of each lane's search.

The loops are many and short, because a processor works on several lanes at once only if their
chains of dependent operations are short.
"""

from __future__ import annotations

from vibrosweep.kernels import bases
from vibrosweep.kernels._jit import Floats, implements, jit, wide_vectors
from vibrosweep.kernels.bases import Base, Constants, Counted, Flight
from vibrosweep.kernels.bases.landing_search import (
    Begin,
    Clearance,
    Guess,
    Terms,
    apex,
    begin_at,
    clearance,
    first_guess,
    first_try,
    rough_clearance,
    series_terms,
    try_landing,
    turn,
)
from vibrosweep.kernels.bases.moving import ANY, ANY_BASE, SINGLE, TRIES, Moving, MovingConstants
from vibrosweep.kernels.lanes import ROW, STRIDE
from vibrosweep.kernels.noise import SILENT, drawn_in
from vibrosweep.kernels.sine import cos_turns, sin_turns

FRESH = -1.0  # in place of the next time to be tried: the flight has just begun


@implements(bases.put, *SINGLE)
def put_moving(fixed: MovingConstants, s: Floats, j: int) -> None:
    row = ROW.CONSTANTS + j
    s[row], s[row + STRIDE], s[row + 2 * STRIDE] = fixed.e, fixed.alpha, fixed.r
    s[row + 3 * STRIDE], s[ROW.SCALE + j] = fixed.x_lift, fixed.scale
    s[ROW.NEXT + j], s[ROW.COUNTS + j] = FRESH, 0.0
    s[ROW.TRIES + j], s[ROW.AGE_SEEN + j] = 0.0, 0.0


@implements(bases.take, Moving)
def take_moving(base: Moving, s: Floats, j: int) -> MovingConstants:
    row = ROW.CONSTANTS + j
    e, alpha, r = s[row], s[row + STRIDE], s[row + 2 * STRIDE]
    draw, scale = drawn_in(base.noise, s, j), s[ROW.SCALE + j]
    return MovingConstants(base, e, alpha, r, scale, s[row + 3 * STRIDE], SILENT, draw)


@implements(bases.prepare, Moving)
def prepare_moving(base: Moving, s: Floats, lanes: int) -> None:
    _begin(base, s, lanes)
    _near(base, s, lanes)
    _rough(base, s, lanes)
    _guess(base, s, lanes)
    _turn(base, s, lanes)
    _look(base, s, lanes)
    _try(base, s, lanes)


@jit
def _begin(base: Moving, s: Floats, lanes: int) -> None:
    """Compute sine and cosine where the flight of each lane begins."""
    wide_vectors()
    for j in range(lanes):
        x = s[ROW.X + j]
        s[ROW.SINE + j] = sin_turns(x)
        s[ROW.COSINE + j] = cos_turns(x)


@jit
def _near(base: Moving, s: Floats, lanes: int) -> None:
    """Guess when the flight of each lane ends."""
    wide_vectors()
    for j in range(lanes):
        guess = first_guess(bases.take(base, s, j), begun(s, j), base.arcs)
        s[ROW.SURE + j] = 1.0 if guess.sure else 0.0
        s[ROW.GUESS + j] = guess.time
        s[ROW.RISE + j] = guess.rise


@jit
def _rough(base: Moving, s: Floats, lanes: int) -> None:
    """Compute the clearance of each lane at the guessed time, to about five digits."""
    wide_vectors()
    for j in range(lanes):
        rough = rough_clearance(bases.take(base, s, j), begun(s, j), s[ROW.GUESS + j])
        _keep_clearance(s, j, rough)


@jit
def _guess(base: Moving, s: Floats, lanes: int) -> None:
    """Compute the time to be tried first in a flight that has just begun."""
    wide_vectors()
    for j in range(lanes):
        fixed, begin = bases.take(base, s, j), begun(s, j)
        tried = first_try(fixed, begin, _guessed(s, j), _cleared(s, j), base.arcs)
        following = s[ROW.NEXT + j]
        s[ROW.REACHED + j] = tried if following < 0.0 else following


@jit
def _turn(base: Moving, s: Floats, lanes: int) -> None:
    """Compute how far the base turns until the time that is to be tried."""
    wide_vectors()
    for j in range(lanes):
        s[ROW.TURNED + j], s[ROW.LAG + j], s[ROW.VERSINE + j] = turn(s[ROW.REACHED + j])


@jit
def _look(base: Moving, s: Floats, lanes: int) -> None:
    """Compute the clearance of each lane at the time that is to be tried, and its series."""
    wide_vectors()
    for j in range(lanes):
        fixed, reached = bases.take(base, s, j), s[ROW.REACHED + j]
        turned, lag, c = s[ROW.TURNED + j], s[ROW.LAG + j], s[ROW.VERSINE + j]
        clear = clearance(fixed, begun(s, j), reached, turned, lag, c)
        _keep_clearance(s, j, clear)
        terms = series_terms(fixed, clear)
        s[ROW.NEWTON + j] = terms.newton
        s[ROW.Q + j] = terms.q
        s[ROW.Q3 + j] = terms.q3
        s[ROW.Q4 + j] = terms.q4


@jit
def _try(base: Moving, s: Floats, lanes: int) -> None:
    """Find the landing of each lane, or the time to be tried next, from the clearance."""
    wide_vectors()
    for j in range(lanes):
        fixed, begin, guess = bases.take(base, s, j), begun(s, j), _guessed(s, j)
        clear, reached = _cleared(s, j), s[ROW.REACHED + j]
        terms = Terms(s[ROW.NEWTON + j], s[ROW.Q + j], s[ROW.Q3 + j], s[ROW.Q4 + j])
        time, v, landed = try_landing(fixed, begin, guess, reached, clear, terms, base.arcs)
        s[ROW.TIME + j] = time
        s[ROW.SPEED + j] = v
        s[ROW.LANDED + j] = 1.0 if landed else 0.0


@jit
def begun(s: Floats, j: int) -> Begin:
    """Return the beginning of the flight of lane j, as `prepare` left it."""
    return Begin(s[ROW.X + j], s[ROW.U + j], s[ROW.SINE + j], s[ROW.COSINE + j])


@jit
def _guessed(s: Floats, j: int) -> Guess:
    """Return the guess of lane j, as `prepare` left it."""
    return Guess(s[ROW.SURE + j] != 0.0, s[ROW.GUESS + j], s[ROW.RISE + j])


@jit
def _keep_clearance(s: Floats, j: int, clear: Clearance) -> None:
    s[ROW.CLEAR + j] = clear.f
    s[ROW.CLEAR_SLOPE + j] = clear.f1
    s[ROW.SINE_THEN + j] = clear.sine
    s[ROW.COSINE_THEN + j] = clear.cosine


@jit
def _cleared(s: Floats, j: int) -> Clearance:
    """Return the clearance of lane j that has been kept."""
    return Clearance(
        s[ROW.CLEAR + j],
        s[ROW.CLEAR_SLOPE + j],
        s[ROW.SINE_THEN + j],
        s[ROW.COSINE_THEN + j],
    )


@implements(bases.approach, *ANY)
def approach_moving(fixed: Constants, s: Floats, j: int) -> tuple[float, float, bool]:
    return s[ROW.TIME + j], s[ROW.SPEED + j], s[ROW.LANDED + j] != 0.0


@implements(bases.may_land, *ANY)
def may_land_moving(fixed: Constants, s: Floats, j: int, budget: float) -> bool:
    return bool(s[ROW.AGE + j] < budget)


@implements(bases.keep, *ANY)
def keep_moving(fixed: Constants, s: Floats, j: int, time: float, landed: bool, seen: bool) -> bool:
    counts = s[ROW.COUNTS + j] != 0.0
    s[ROW.AGE + j] += 1.0 if landed else 0.0
    s[ROW.COUNTS + j] = (1.0 if seen else 0.0) + (0.0 if landed else s[ROW.COUNTS + j])
    s[ROW.NEXT + j] = FRESH if landed else time
    return bool(landed & counts)


@implements(bases.gives_up, *ANY_BASE)
def gives_up_moving(base: Base, s: Floats, j: int, passes: int) -> bool:
    stays = s[ROW.AGE + j] == s[ROW.AGE_SEEN + j]
    s[ROW.AGE_SEEN + j] = s[ROW.AGE + j]
    s[ROW.TRIES + j] = s[ROW.TRIES + j] + passes if stays else 0.0
    clear = s[ROW.CLEAR + j]
    lost = (clear != clear) & (abs(s[ROW.X + j]) <= 0.5)  # a particle at rest for good is not lost
    return bool((s[ROW.TRIES + j] >= TRIES) | lost)


@implements(bases.pending, *ANY_BASE)
def pending_moving(base: Base, s: Floats, j: int) -> bool:
    # after a rest for good no flight follows, and the phase is NaN
    return bool((s[ROW.COUNTS + j] != 0.0) & (abs(s[ROW.X + j]) <= 0.5))


@implements(bases.counted, MovingConstants)
def counted_moving(fixed: MovingConstants, flight: Flight, u_off: float) -> Counted:
    return Counted(flight.time, apex(fixed, begin_at(flight.x, flight.u)), 1.0)


@implements(bases.counted_now, MovingConstants)
def counted_now_moving(
    fixed: MovingConstants, s: Floats, j: int, time: float, u_off: float
) -> Counted:
    return Counted(time, apex(fixed, begun(s, j)), 1.0)


@implements(bases.common_age, *ANY_BASE)
def common_age_moving(base: Base) -> float:
    return 0.0
