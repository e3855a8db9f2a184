"""Laws of rebound: the speed after an impact, from the share of the arrival speed and the kick.

A law is an empty named tuple, whose type numba knows when it compiles.  A new law needs a class
with its implementations here, and its name here and in `vibrosweep.model.parameters.LAWS_OF`.

Speeds are the durations of the flights that they begin, in forcing periods.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from vibrosweep.kernels._jit import fma, generic, implements

Law = Any


@generic
def speed_after(law: Law, share: float, v: float, kick: float) -> float:
    """Speed after an impact at speed v, of which it keeps a share.

    A particle rests if this speed does not exceed the threshold.
    """


@generic
def direction(law: Law, w: float) -> float:
    """Return -1 if a law reverses the speed w, else 1."""


class Rest(NamedTuple):
    """A particle whose rebound points into the base stays on it."""


implements(speed_after, Rest)(lambda law, share, v, kick: fma(share, v, kick))
implements(direction, Rest)(lambda law, w: 1.0)


class Reflect(NamedTuple):
    """A rebound that points into the base is reversed, as in the Fermi accelerator."""


implements(speed_after, Reflect)(lambda law, share, v, kick: abs(fma(share, v, kick)))
implements(direction, Reflect)(lambda law, w: -1.0 if w < 0.0 else 1.0)


LAW_OF: Final[Mapping[str, Law]] = {"rest": Rest(), "reflect": Reflect()}
