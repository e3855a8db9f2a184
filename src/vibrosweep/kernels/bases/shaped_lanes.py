"""The base of harmonics in the vector kernel: a pass makes one step of each lane's search.

The loops are short, as in `moving_lanes`.  Rows are used as there, except for those of `Rows`.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from vibrosweep.kernels import bases
from vibrosweep.kernels._jit import Floats, implements, jit, wide_vectors
from vibrosweep.kernels.bases import Counted
from vibrosweep.kernels.bases.moving_lanes import FRESH
from vibrosweep.kernels.bases.shaped import Shaped, ShapedConstants, search
from vibrosweep.kernels.bases.shaped_search import (
    Begin,
    Clear,
    Guess,
    clearance,
    first_guess,
    first_try,
    rough_turn,
    try_landing,
    turn,
)
from vibrosweep.kernels.harmonics import for_each
from vibrosweep.kernels.lanes import OF_PHASES, ROW, STRIDE
from vibrosweep.kernels.noise import SILENT, drawn_in
from vibrosweep.kernels.sine import cos_turns, sin_turns

__all__: list[str] = []


class Rows(NamedTuple):
    """Rows whose use differs from that over the base that moves as a sine."""

    F2: int
    F3: int
    F4: int
    F5: int
    SPEED: int  # absolute, at lift-off
    APEX: int


AT: Final = Rows(ROW.SINE_THEN, ROW.COSINE_THEN, ROW.NEWTON, ROW.Q, ROW.Q3, ROW.Q4)
PRESSES: Final = ROW.PHASES + OF_PHASES // 2 * STRIDE
_falls = for_each("dip", f"s[{ROW.PHASES} + {{row}} + j]")
_presses = for_each("dip", f"s[{PRESSES} + {{row}} + j]")


@implements(bases.put, ShapedConstants)
def put_shaped(fixed: ShapedConstants, s: Floats, j: int) -> None:
    row = ROW.CONSTANTS + j
    s[row], s[row + STRIDE], s[row + 2 * STRIDE] = fixed.e, fixed.alpha, fixed.r
    s[ROW.SCALE + j] = fixed.scale
    for k in range(len(fixed.falls)):
        s[ROW.PHASES + k * STRIDE + j] = fixed.falls[k]
        s[PRESSES + k * STRIDE + j] = fixed.presses[k]
    s[ROW.NEXT + j], s[ROW.COUNTS + j] = FRESH, 0.0
    s[ROW.TRIES + j], s[ROW.AGE_SEEN + j] = 0.0, 0.0


@implements(bases.take, Shaped)
def take_shaped(base: Shaped, s: Floats, j: int) -> ShapedConstants:
    row, shape = ROW.CONSTANTS + j, base.waveform
    e, alpha, r = s[row], s[row + STRIDE], s[row + 2 * STRIDE]
    falls, presses = _falls(shape, 0.0, 0.0, s, j), _presses(shape, 0.0, 0.0, s, j)
    draw, scale = drawn_in(base.noise, s, j), s[ROW.SCALE + j]
    return ShapedConstants(base, e, alpha, r, scale, falls, presses, SILENT, draw)


@implements(bases.prepare, Shaped)
def prepare_shaped(base: Shaped, s: Floats, lanes: int) -> None:
    _near(base, s, lanes)
    _guess(base, s, lanes)
    _turn(base, s, lanes)
    _look(base, s, lanes)
    _try(base, s, lanes)


@jit
def _near(base: Shaped, s: Floats, lanes: int) -> None:
    """Guess when the flight of each lane ends."""
    wide_vectors()
    for j in range(lanes):
        x = s[ROW.X + j]
        s[ROW.SINE + j] = sin_turns(x)
        s[ROW.COSINE + j] = cos_turns(x)
        guess = first_guess(search(bases.take(base, s, j)), _begun(s, j))
        s[ROW.SURE + j] = 1.0 if guess.sure else 0.0
        s[ROW.GUESS + j] = guess.time
        s[ROW.RISE + j] = guess.rise
        s[AT.SPEED + j] = guess.u
        s[AT.APEX + j] = guess.apex


@jit
def _guess(base: Shaped, s: Floats, lanes: int) -> None:
    """Compute the time to be tried first in a flight that has just begun."""
    wide_vectors()
    for j in range(lanes):
        known, begin, guess = search(bases.take(base, s, j)), _begun(s, j), s[ROW.GUESS + j]
        rough = clearance(known, begin, guess, *rough_turn(guess))
        tried = first_try(known, begin, s[ROW.SURE + j] != 0.0, guess, rough)
        following = s[ROW.NEXT + j]
        s[ROW.REACHED + j] = tried if following < 0.0 else following


@jit
def _turn(base: Shaped, s: Floats, lanes: int) -> None:
    """Compute how far the base turns until the time that is to be tried."""
    wide_vectors()
    for j in range(lanes):
        s[ROW.TURNED + j], s[ROW.LAG + j], s[ROW.VERSINE + j] = turn(s[ROW.REACHED + j])


@jit
def _look(base: Shaped, s: Floats, lanes: int) -> None:
    """Compute the clearance of each lane at the time that is to be tried."""
    wide_vectors()
    for j in range(lanes):
        turned, lag, c = s[ROW.TURNED + j], s[ROW.LAG + j], s[ROW.VERSINE + j]
        known = search(bases.take(base, s, j))
        clear = clearance(known, _begun(s, j), s[ROW.REACHED + j], turned, lag, c)
        s[ROW.CLEAR + j], s[ROW.CLEAR_SLOPE + j] = clear.f, clear.f1
        s[AT.F2 + j], s[AT.F3 + j] = clear.f2, clear.f3
        s[AT.F4 + j], s[AT.F5 + j] = clear.f4, clear.f5


@jit
def _try(base: Shaped, s: Floats, lanes: int) -> None:
    """Find from the clearance the landing of each lane, or the time to be tried next."""
    wide_vectors()
    for j in range(lanes):
        clear = Clear(
            s[ROW.CLEAR + j],
            s[ROW.CLEAR_SLOPE + j],
            s[AT.F2 + j],
            s[AT.F3 + j],
            s[AT.F4 + j],
            s[AT.F5 + j],
        )
        sure, rise, u = s[ROW.SURE + j] != 0.0, s[ROW.RISE + j], s[AT.SPEED + j]
        guess = Guess(sure, s[ROW.GUESS + j], rise, u, s[AT.APEX + j])
        known = search(bases.take(base, s, j))
        time, v, landed = try_landing(known, _begun(s, j), guess, s[ROW.REACHED + j], clear)
        s[ROW.TIME + j] = time
        s[ROW.SPEED + j] = v
        s[ROW.LANDED + j] = 1.0 if landed else 0.0


@jit
def _begun(s: Floats, j: int) -> Begin:
    """Return the beginning of the flight of lane j, as `prepare` left it."""
    return Begin(s[ROW.X + j], s[ROW.U + j], s[ROW.SINE + j], s[ROW.COSINE + j])


@implements(bases.counted_now, ShapedConstants)
def counted_now_shaped(
    fixed: ShapedConstants, s: Floats, j: int, time: float, u_off: float
) -> Counted:
    return Counted(time, s[AT.APEX + j], 1.0)
