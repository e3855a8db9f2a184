"""Laws of rebound: the speed after an impact, from the arrival speed and the kick.

A law is an empty named tuple: numba selects its functions by type, at compile time.  To add a law,
write a class with its two functions here, and add its name here and in
`vibrosweep.model.parameters.LAWS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from vibrosweep.kernels._jit import answer, fma, question

__all__ = ["LAW_OF", "Law", "Reflect", "Rest", "slopes", "speed_after"]

Law = Any


@question
def speed_after(law: Law, e: float, v: float, kick: float) -> float:
    """Speed after an impact at speed v; a particle rests where it does not exceed the threshold."""
    raise NotImplementedError


@question
def slopes(law: Law, e: float, v: float, kick: float) -> tuple[float, float]:
    """Derivatives of the speed after an impact by v and by the kick."""
    raise NotImplementedError


class Rest(NamedTuple):
    """A particle that is pushed into the base stays on it (Eq. 7 of the study, iterated)."""


@answer(speed_after, Rest)
def _(law: Law, e: float, v: float, kick: float) -> float:
    return fma(e, v, kick)


@answer(slopes, Rest)
def _(law: Law, e: float, v: float, kick: float) -> tuple[float, float]:
    return e, 1.0


class Reflect(NamedTuple):
    """A particle that is pushed into the base is turned back, as in the Fermi accelerator."""


@answer(speed_after, Reflect)
def _(law: Law, e: float, v: float, kick: float) -> float:
    return abs(fma(e, v, kick))


@answer(slopes, Reflect)
def _(law: Law, e: float, v: float, kick: float) -> tuple[float, float]:
    sign = -1.0 if fma(e, v, kick) < 0.0 else 1.0
    return sign * e, sign


LAW_OF: Final[Mapping[str, Law]] = {"rest": Rest(), "reflect": Reflect()}
