"""Laws of rebound: the speed after an impact, from the arrival speed and the kick.

A law is an empty named tuple, whose type numba knows when it compiles.  A new one is a class here
with its implementations, and its name, here and in `vibrosweep.model.parameters.LAWS_OF`; or a
`vibrosweep.model.outside_laws.Law`.

Speeds are the durations of the flights that they begin, in forcing periods.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from vibrosweep.kernels._jit import compiled_anew, fma, generic, implements, jit
from vibrosweep.kernels.markers import kind
from vibrosweep.kernels.rounding import HALF_ULP, SMALLEST
from vibrosweep.model.outside_laws import OUTSIDE
from vibrosweep.model.outside_laws import Law as OutsideLaw

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


def law_of(name: str) -> Law:
    """Return a law by its name, one from outside the package with the code of this moment."""
    return LAW_OF[name] if name in LAW_OF else _from_outside(OUTSIDE[name].code, OUTSIDE[name])


@functools.cache
def _from_outside(code: str, law: OutsideLaw) -> Law:
    """Implement a law from outside the package."""
    marker = kind(f"{law.name}_{code}")
    kept, slope, bend = (compiled_anew(f, jit) for f in (law.kept, law.slope, law.bend))
    rounding = law.roundings * HALF_ULP

    @implements(speed_after, marker)
    def speed_after_outside(law: Law, e: float, v: float, kick: float) -> float:
        return kept(e, v) + kick  # type: ignore[no-any-return]

    @implements(slopes, marker)
    def slopes_outside(law: Law, e: float, v: float, kick: float) -> tuple[float, float]:
        return slope(e, v), 1.0

    @implements(curvature, marker)
    def curvature_outside(law: Law, e: float) -> float:
        return 0.5 * bend(e)  # type: ignore[no-any-return]

    @implements(speed_rounding, marker)
    def speed_rounding_outside(law: Law, e: float, v: float, w: float) -> float:
        return HALF_ULP * abs(w) + rounding * abs(kept(e, v)) + SMALLEST  # type: ignore[no-any-return]

    @implements(kick_to_repeat, marker)
    def kick_to_repeat_outside(law: Law, e: float, v: float, sign: float) -> float:
        return sign * v - kept(e, v)  # type: ignore[no-any-return]

    return marker()
