"""Laws of rebound: the speed after an impact, from the arrival speed and the kick.

A law is an empty named tuple, whose type numba knows when it compiles.  A new one is a class here
with its implementations, and its name, here and in `vibrosweep.model.parameters.LAWS_OF`.

Speeds are the durations of the flights that they begin, in forcing periods.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from vibrosweep.kernels._jit import fma, generic, implements
from vibrosweep.kernels.rounding import HALF_ULP, SMALLEST

Law = Any


@generic
def speed_after(law: Law, e: float, v: float, kick: float) -> float:
    """Speed after an impact at speed v; a particle rests where it does not exceed the threshold."""


@generic
def slopes(law: Law, e: float, v: float, kick: float) -> tuple[float, float]:
    """Derivatives of the speed after an impact by v and by the kick."""


@generic
def curvature(law: Law, e: float) -> float:
    """Bound of half the second derivative of the speed after an impact by v."""


@generic
def speed_rounding(law: Law, e: float, v: float, w: float) -> float:
    """Bound of the rounding error of the speed w after an impact at speed v, for an exact kick."""


@generic
def kick_to_repeat(law: Law, e: float, v: float, sign: float) -> float:
    """Kick with which an impact at speed v ends with speed v; `sign` is -1 if it is turned back."""


class Rest(NamedTuple):
    """A particle that is pushed into the base stays on it (Eq. 7 of the study, iterated)."""


@implements(speed_after, Rest)
def speed_after_rest(law: Law, e: float, v: float, kick: float) -> float:
    return fma(e, v, kick)


@implements(slopes, Rest)
def slopes_rest(law: Law, e: float, v: float, kick: float) -> tuple[float, float]:
    return e, 1.0


class Reflect(NamedTuple):
    """A particle that is pushed into the base is turned back, as in the Fermi accelerator."""


@implements(speed_after, Reflect)
def speed_after_reflect(law: Law, e: float, v: float, kick: float) -> float:
    return abs(fma(e, v, kick))


@implements(slopes, Reflect)
def slopes_reflect(law: Law, e: float, v: float, kick: float) -> tuple[float, float]:
    sign = -1.0 if fma(e, v, kick) < 0.0 else 1.0
    return sign * e, sign


@implements(curvature, Rest, Reflect)
def curvature_linear(law: Law, e: float) -> float:
    return 0.0


@implements(speed_rounding, Rest, Reflect)
def speed_rounding_linear(law: Law, e: float, v: float, w: float) -> float:
    return HALF_ULP * abs(w) + SMALLEST


@implements(kick_to_repeat, Rest, Reflect)
def kick_to_repeat_linear(law: Law, e: float, v: float, sign: float) -> float:
    # not as the difference of the speeds, of which 1 - e would be lost in rounding near 1
    return (sign - e) * v


LAW_OF: Final[Mapping[str, Law]] = {"rest": Rest(), "reflect": Reflect()}
