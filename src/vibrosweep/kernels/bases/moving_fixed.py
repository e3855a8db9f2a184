"""Orbits that land on a moving base every k periods.

Such an orbit meets the base with c, where c + E(c) = 2 k, at a phase x at which the base rises with
c - k.  With the slope q of E at c, e = E(c) / c and the acceleration G(x) of the base in units of
gravity, its multipliers are the roots of z^2 - (1 + q e + (1 + q)(1 + e) G) z + q e.
"""

from __future__ import annotations

from vibrosweep.kernels import bases
from vibrosweep.kernels._jit import implements
from vibrosweep.kernels.bases import Constants
from vibrosweep.kernels.bases.chained import ChainedConstants
from vibrosweep.kernels.bases.moving import MovingConstants
from vibrosweep.kernels.bases.shaped import ShapedConstants
from vibrosweep.kernels.restitution import (
    arrival_to_repeat,
    leaving_to_repeat,
    ratio,
    rise_to_repeat,
    slope,
)
from vibrosweep.kernels.waveforms import kick_slope, velocity

__all__: list[str] = []

AT_LANDING = 2.0**-20  # periods; a landing on the way is farther than that from the end of a flight


@implements(bases.fixed_residual, MovingConstants, ShapedConstants, ChainedConstants)
def fixed_residual_moving(
    fixed: Constants, x: float, k: float, sign: float
) -> tuple[float, float, float]:
    a, shape = fixed.alpha * (1.0 + fixed.e), fixed.base.waveform
    need = rise_to_repeat(fixed.base.restitution, fixed.e, fixed.scale, k)
    return a * velocity(shape, x) - need, kick_slope(shape, a, x), a


@implements(bases.fixed_attracts, MovingConstants, ShapedConstants, ChainedConstants)
def fixed_attracts_moving(fixed: Constants, x: float, k: float) -> bool:
    # both multipliers are inside the unit circle
    law = fixed.base.restitution
    c = arrival_to_repeat(law, fixed.e, fixed.scale, k)
    q, e = slope(law, fixed.e, fixed.scale, c), ratio(law, fixed.e, fixed.scale, c)
    s = -kick_slope(fixed.base.waveform, 0.5 * fixed.alpha, x)
    return q * e < 1.0 and 0.0 < s < 2.0 * (1.0 + q * e) / ((1.0 + q) * (1.0 + e))


@implements(bases.fixed_holds, MovingConstants, ShapedConstants, ChainedConstants)
def fixed_holds_moving(fixed: Constants, x: float, k: float) -> bool:
    y = leaving_to_repeat(fixed.base.restitution, fixed.e, fixed.scale, k)
    time, _ = bases.fly(fixed, x, y)
    return abs(time - k) <= AT_LANDING and bases.lift_off(fixed, 0.0, x, y).leaves
