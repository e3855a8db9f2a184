"""Statistics: a number for each landing, or for each flight, and how the numbers combine.

Separations, cycles, exponents, error bounds and records are computed elsewhere.  A statistic is
declared once, below; `kernels.totals` composes the chosen ones into the loop over the lanes, the
totals of a cycle and the loop over the events of a coupled base.  The choice is a tuple of empty
named tuples, whose types decide what is compiled, so that the machine code of each choice can be
kept on disk.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels._jit import Flags, Floats, Integers, jit
from vibrosweep.kernels.bases import Counted
from vibrosweep.kernels.markers import kind
from vibrosweep.kernels.unwritten import unwritten
from vibrosweep.model.observables import Landing

# How the numbers of landings combine.  A count counts landings whose number, a flag, is true; the
# numbers of a sum of products are pairs of factors, whose product is fused with the sum.
COUNT, SUM, PRODUCTS, MAX, MIN = "count", "sum", "sum of products", "max", "min"
START: Final = {COUNT: 0.0, SUM: 0.0, PRODUCTS: 0.0, MAX: -np.inf, MIN: np.inf}

Kinds = tuple[Any, ...]  # empty named tuples, whose types say which statistics are asked for


class Statistic(NamedTuple):
    """A statistic of the landings in the window, or of the flights that follow them."""

    name: str
    number: Callable[[Any], Any]  # of a `Landing`, or of a flight, which is a `Counted`
    combine: str  # COUNT, SUM, PRODUCTS, MAX or MIN
    of_flights: bool

    @property
    def summed(self) -> bool:
        """Return whether it is a sum that is rounded."""
        return self.combine in (SUM, PRODUCTS)

    def joined(self, one: str, other: str) -> str:
        """Return the source text of two totals combined."""
        if self.combine in (MAX, MIN):
            return f"{self.combine}({one}, {other})"
        return f"{one} + {other}"


_DECLARED: Final[dict[type, Statistic]] = {}


def declare(
    name: str, number: Callable[[Any], Any], combine: str, *, of_flights: bool = False
) -> Any:
    """Declare a statistic; return its marker, an empty named tuple of a type of its own.

    A COUNT of flights is right only over a coupled base: elsewhere it includes rests that no flight
    follows, as flights of no time and height.

    The name of a statistic from outside the package must contain a digest of its code, because
    machine code is kept by the names of types.
    """
    marker = kind(name)
    _DECLARED.setdefault(marker, Statistic(name, number, combine, of_flights))
    return marker()


def statistic_of(marker: type) -> Statistic:
    """Return the statistic that a type stands for."""
    return _DECLARED[marker]


@jit
def _every(event: Landing | Counted) -> bool:
    return True


@jit
def _rest(landing: Landing) -> bool:
    return landing.rests


@jit
def _time(flight: Counted) -> float:
    return flight.time


@jit
def _height_product(flight: Counted) -> tuple[float, float]:
    return flight.height, flight.factor


@jit
def _height(flight: Counted) -> float:
    return flight.height


@jit
def _ended(landing: Landing) -> float:
    return landing.flight_time


@jit
def _arrival(landing: Landing) -> float:
    return landing.arrival


# The first two are always kept: cycles and orbits need them.
KINDS: Final[Kinds] = (
    declare("landings", _every, COUNT),
    declare("rests", _rest, COUNT),
    declare("flight_sum", _time, SUM, of_flights=True),
    declare("height_sum", _height_product, PRODUCTS, of_flights=True),
    declare("height_max", _height, MAX, of_flights=True),
)
LANDINGS, RESTS = 0, 1
UNCOUNTED: Final = 2.0**53  # from here on, adding 1 to a double may not change it
# Of the flights that end with a landing
SHORTEST: Final = declare("flight_min", _ended, MIN)
LONGEST: Final = declare("flight_max", _ended, MAX)
IMPACT_SPEED: Final = declare("impact_speed", _arrival, MAX)
# Over a base that may lift resting particles when others land, flights are counted one by one.
KINDS_COUPLED: Final[Kinds] = (*KINDS, declare("flights", _every, COUNT, of_flights=True))


class Statistics(NamedTuple):
    """Statistics of trajectories, or of realizations, over the window."""

    kinds: Kinds
    # Shape (statistic, trajectory).  Flight times in forcing periods, heights as the base counts
    # them; a particle at rest for good adds nothing
    totals: Floats
    # 1 if the particle came to rest for good before the end; in sums, the number of such particles
    at_rest: Flags | Integers
    status: Flags  # `vibrosweep.model.measures.Status`

    def total(self, name: str) -> Floats:
        """Return the totals of the statistic of that name."""
        names = [statistic_of(type(marker)).name for marker in self.kinds]
        return np.asarray(self.totals[names.index(name)])

    @property
    def landings(self) -> Integers:
        """Number of landings; `UNCOUNTED` where there are as many or more."""
        return np.asarray(np.minimum(self.totals[LANDINGS], UNCOUNTED).astype(np.int64))

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Return where no count has lost a landing: all others are at most as large."""
        return np.asarray(self.totals[LANDINGS] < UNCOUNTED)


def empty_statistics(size: int, kinds: Kinds = KINDS) -> Statistics:
    """Allocate the statistics of trajectories."""
    at_rest, status = unwritten(size, np.int8), unwritten(size, np.int8)
    return Statistics(kinds, unwritten((len(kinds), size)), at_rest, status)


def empty_sums(size: int, kinds: Kinds) -> Statistics:
    """Allocate the statistics of realizations."""
    return empty_statistics(size, kinds)._replace(at_rest=unwritten(size, np.int64))
