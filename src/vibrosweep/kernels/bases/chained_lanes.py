"""The base of parabolas in the vector kernel: a pass solves one quadratic equation per lane."""

from __future__ import annotations

from vibrosweep.kernels import bases
from vibrosweep.kernels._jit import Floats, implements, wide_vectors
from vibrosweep.kernels.bases import Counted
from vibrosweep.kernels.bases.chained import Chained, ChainedConstants, first_guess, try_stretch
from vibrosweep.kernels.lanes import ROW, STRIDE
from vibrosweep.kernels.noise import SILENT, drawn_in

__all__: list[str] = []


@implements(bases.take, Chained)
def take_chained(base: Chained, s: Floats, j: int) -> ChainedConstants:
    row = ROW.CONSTANTS + j
    e, alpha, r = s[row], s[row + STRIDE], s[row + 2 * STRIDE]
    draw, scale = drawn_in(base.noise, s, j), s[ROW.SCALE + j]
    return ChainedConstants(base, e, alpha, r, scale, s[row + 3 * STRIDE], SILENT, draw)


@implements(bases.prepare, Chained)
def prepare_chained(base: Chained, s: Floats, lanes: int) -> None:
    wide_vectors()
    for j in range(lanes):
        alpha, x, y = s[ROW.CONSTANTS + STRIDE + j], s[ROW.X + j], s[ROW.U + j]
        guess, following = first_guess(alpha, x, y), s[ROW.NEXT + j]
        reached = guess.begin if following < 0.0 else following
        time, v, lands, clear = try_stretch(alpha, x, y, guess, reached)
        s[ROW.TIME + j] = time
        s[ROW.SPEED + j] = v
        s[ROW.LANDED + j] = 1.0 if lands else 0.0
        s[ROW.CLEAR + j] = clear


@implements(bases.counted_now, ChainedConstants)
def counted_now_chained(
    fixed: ChainedConstants, s: Floats, j: int, time: float, u_off: float
) -> Counted:
    return Counted(time, first_guess(fixed.alpha, s[ROW.X + j], s[ROW.U + j]).apex, 1.0)
