"""Statistics of landings and flights: what is counted, how totals combine, and observers."""

from __future__ import annotations

import functools
import textwrap
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final, NamedTuple

import numba
import numpy as np
from numba import njit, types
from numpy.typing import NDArray

from vibrosweep.kernels._jit import (
    OPTIONS,
    Flags,
    Floats,
    Integers,
    compiled_anew,
    fma,
    generic,
    implements,
    jit,
    kind_named,
    overloaded,
    prefetch,
    require_compilable,
    uncounted,
)
from vibrosweep.kernels.bases import Base, Counted
from vibrosweep.kernels.memory import ROW, ROWS, STRIDE, aligned, unwritten
from vibrosweep.model.observables import Landing, Observable

# --- Kinds of statistics --------------------------------------------------------------------------
# A statistic is a number for each landing, or for each flight, and a way to combine the numbers.
# It is declared once, below.  The choice is a tuple of empty named tuples, whose types decide what
# is compiled, so that the machine code of each choice can be saved on disk.


# How the numbers of landings combine.  A count counts landings whose number, a flag, is true; the
# numbers of a sum of products are pairs of factors, whose product is fused with the sum.
COUNT, SUM, PRODUCTS, MAX, MIN = "count", "sum", "sum of products", "max", "min"
START: Final = {COUNT: 0.0, SUM: 0.0, PRODUCTS: 0.0, MAX: -np.inf, MIN: np.inf}

Kinds = tuple[Any, ...]  # empty named tuples, whose types say which statistics are requested


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
    """Declare a statistic; return its marker, an empty named tuple of a unique type.

    A COUNT of flights is right only over a coupled base: elsewhere it includes rests that no flight
    follows, as flights of no time and height.

    The name of a statistic from outside the package must contain a digest of its code, because
    saved machine code is identified by the names of types.
    """
    marker = kind_named(name)
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
def _impact_speed(landing: Landing) -> float:
    return landing.impact_speed


# The first two are always present: cycles and orbits need them.
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
IMPACT_SPEED: Final = declare("impact_speed", _impact_speed, MAX)
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


# --- Totals ---------------------------------------------------------------------------------------
# The chosen statistics are composed into the code of each kernel: the loop over the lanes, the
# totals of a cycle, and the loop over the events of a coupled base.  Each function takes a tuple of
# kinds. For each such tuple it is compiled once, from a text that names every statistic: there is
# no loop over statistics, and nothing is chosen at run time.  In a block of lanes each statistic k
# has three rows behind those of `kernels.memory`:
#
#     ROWS + k            the total; of a sum, the part since the last check of the lanes
#     ROWS + n + k        of a sum, the part before the last check
#     ROWS + 2 n + 1 + k  of the cycle that the lane has entered; ROWS + 2 n holds its periods


Cycle = tuple[float, ...]  # periods of a cycle, then the totals of its statistics
Writer = Callable[[Sequence[Statistic]], Iterator[str]]

LINE = 8  # numbers in a cache line
OF_LANDINGS, OF_RESTS = (ROWS + LANDINGS) * STRIDE, (ROWS + RESTS) * STRIDE
CYCLE_LANDINGS, CYCLE_RESTS = 1 + LANDINGS, 1 + RESTS  # places in a `Cycle`


def scratch(kinds: Kinds = KINDS) -> Floats:
    """Scratch memory of one caller of `vibrosweep.kernels.advance.advance`."""
    return aligned((ROWS + 3 * len(kinds) + 1) * STRIDE)


def _composed(parameters: str) -> Callable[[Writer], Any]:
    """Turn a writer of the lines of a function, for given statistics, into that function.

    The function takes a tuple of kinds, by the name `kinds`, and these parameters.
    """

    def decorate(write: Writer) -> Any:
        @functools.cache
        def composed(kinds: tuple[type, ...]) -> Any:
            statistics = [statistic_of(kind) for kind in kinds]
            names: dict[str, Any] = {f"number_{k}": s.number for k, s in enumerate(statistics)}
            names |= {"fma": fma, "prefetch": prefetch, "nan": float("nan"), "inf": float("inf")}
            names["__name__"] = __name__
            body = textwrap.indent("\n".join(write(statistics)), "    ")
            exec(f"def {write.__name__}(kinds, {parameters}):\n{body}\n", names)
            return names[write.__name__]

        def call(kinds: Kinds, *arguments: Any) -> Any:
            return composed(tuple(map(type, kinds)))(kinds, *arguments)

        def code(kinds: Any, *arguments: Any) -> Any:
            return composed(tuple(kind.instance_class for kind in kinds))

        return overloaded(write, call, code)

    return decorate


def _numbers(statistics: Sequence[Statistic]) -> Iterator[tuple[int, Statistic, str]]:
    """Yield each statistic's place, the statistic, and the text of its number.

    In a sum of products, the number of one landing is its rounded product.  A flight of no time,
    which stands for a rest that no flight follows, is excluded from a minimum.
    """
    for k, statistic in enumerate(statistics):
        number = f"number_{k}({'flight' if statistic.of_flights else 'landing'})"
        if statistic.combine == PRODUCTS:
            yield k, statistic, f"{number}[0] * {number}[1]"
        elif statistic.combine == MIN and statistic.of_flights:
            yield k, statistic, f"(1.0 * {number} if flight.time > 0.0 else inf)"
        else:
            yield k, statistic, f"1.0 * {number}"


def _row(statistics: Sequence[Statistic], k: int) -> str:
    """Return the text of the place where the total of statistic k ends up."""
    return f"s[{(ROWS + k + (len(statistics) if statistics[k].summed else 0)) * STRIDE} + j]"


@_composed("s, j")
def clear(statistics: Sequence[Statistic]) -> Iterator[str]:
    """Begin the statistics of the trajectory in place j."""
    for k, statistic in enumerate(statistics):
        yield f"s[{(ROWS + k) * STRIDE} + j] = {START[statistic.combine]}"
        if statistic.summed:
            yield f"{_row(statistics, k)} = 0.0"
    row = ROWS + 2 * len(statistics) + CYCLE_LANDINGS
    yield f"s[{row * STRIDE} + j] = 0.0  # no cycle is known"


@_composed("s, j, landing, flight, seen, ends")
def count(statistics: Sequence[Statistic]) -> Iterator[str]:
    """Count a landing in place j where it is seen, and a flight where it ends."""
    for k, statistic, text in _numbers(statistics):
        row = f"s[{(ROWS + k) * STRIDE} + j]"
        counts = "ends" if statistic.of_flights else "seen"
        number = f"number_{k}({'flight' if statistic.of_flights else 'landing'})"
        if statistic.combine == COUNT:
            yield f"{row} += 1.0 if {number} & {counts} else 0.0"
        elif statistic.combine == SUM:
            yield f"{row} += {number} if {counts} else 0.0"
        elif statistic.combine == PRODUCTS:
            yield f"a, b = {number}"
            yield f"{row} = fma(a if {counts} else 0.0, b if {counts} else 0.0, {row})"
        else:
            # adding 0.0 changes nothing, but keeps the compiler from choosing by a masked store,
            # which takes AMD processors without AVX-512 as long as ten ordinary ones
            yield f"v, w = {text}, {row} + 0.0"
            yield f"{row} = v if (v {'>' if statistic.combine == MAX else '<'} w) & {counts} else w"


@_composed("s, j, lost")
def sum_up(statistics: Sequence[Statistic]) -> Iterator[str]:
    """Add the numbers since the last check to the sums; those of flights are NaN if `lost`."""
    yield "pass"
    for k, statistic in enumerate(statistics):
        if statistic.summed:
            # the total is rounded once for several impacts, which keeps its error small
            row, total = f"s[{(ROWS + k) * STRIDE} + j]", _row(statistics, k)
            both = f"{total} + {row}"
            yield f"{total} = " + (f"nan if lost else {both}" if statistic.of_flights else both)
            yield f"{row} = 0.0"


@_composed("")
def no_impacts(statistics: Sequence[Statistic]) -> Iterator[str]:
    """Totals of no impacts."""
    starts = "".join(f", {START[statistic.combine]}" for statistic in statistics)
    yield f"return (0.0{starts})"


@_composed("to, periods, landing, flight")
def added(statistics: Sequence[Statistic]) -> Iterator[str]:
    """Add an impact to the totals of a cycle, of which so many periods have passed."""
    sums = (
        statistic.joined(f"to[{k + 1}]", number) for k, statistic, number in _numbers(statistics)
    )
    yield f"return (periods, {', '.join(sums)})"


@jit
def set_cycle(kinds: Kinds, s: Floats, j: int, found: Any) -> None:
    """Store the totals of the cycle that lane j has entered: a `Cycle`, or an array."""
    row = (ROWS + 2 * len(kinds)) * STRIDE + j
    for k in range(1 + len(kinds)):
        s[row + k * STRIDE] = found[k]


@jit
def cycle_of(kinds: Kinds, s: Floats, j: int) -> tuple[float, float, float]:
    """Return periods, landings and rests of the cycle of lane j; no landings if none is known."""
    row = (ROWS + 2 * len(kinds)) * STRIDE + j
    return s[row], s[row + CYCLE_LANDINGS * STRIDE], s[row + CYCLE_RESTS * STRIDE]


@_composed("s, j, times")
def repeat(statistics: Sequence[Statistic]) -> Iterator[str]:
    """Count the landings of so many whole cycles in place j."""
    for k, statistic in enumerate(statistics):
        row, cycle = _row(statistics, k), f"s[{(ROWS + 2 * len(statistics) + 1 + k) * STRIDE} + j]"
        if statistic.summed or statistic.combine == COUNT:
            yield f"{row} += times * {cycle}"
        else:
            yield f"v = {cycle} if times > 0.0 else {START[statistic.combine]}"
            yield f"{row} = {statistic.joined(row, 'v')}"


@_composed("s, j")
def totals_of(statistics: Sequence[Statistic]) -> Iterator[str]:
    """Return the totals of place j."""
    yield f"return ({''.join(f'{_row(statistics, k)}, ' for k in range(len(statistics)))})"


@_composed("totals, flight")
def with_flight(statistics: Sequence[Statistic]) -> Iterator[str]:
    """Return totals with a flight added, and a sum that is not finite if a flight is not.

    A flight of no time and height adds nothing, except to a COUNT.
    """
    names = [f"v{k}" for k in range(len(statistics))]
    for k, statistic, number in _numbers(statistics):
        total = f"totals[{k}]"
        yield f"{names[k]} = {statistic.joined(total, number) if statistic.of_flights else total}"
    sums = [
        names[k]
        for k, statistic in enumerate(statistics)
        if statistic.of_flights and statistic.summed
    ]
    yield f"return ({''.join(f'{name}, ' for name in names)}), {' + '.join(sums) or '0.0'}"


@_composed("out, lane")
def expect(statistics: Sequence[Statistic]) -> Iterator[str]:
    """Prefetch the memory of statistics that will be written a block of lanes later."""
    yield f"if lane % {LINE} > 0:  # the previous trajectory has prefetched this cache line"
    yield "    return"
    for k in range(len(statistics)):
        yield f"prefetch(out.totals, {k} * out.status.size + lane)"
    yield "prefetch(out.at_rest, lane)"
    yield "prefetch(out.status, lane)"


@_composed("totals, t")
def reset(statistics: Sequence[Statistic]) -> Iterator[str]:
    """Reset the totals in place t to those of no landings."""
    for k, statistic in enumerate(statistics):
        yield f"totals[{k}, t] = {START[statistic.combine]}"


@_composed("totals, t, landing, flight, seen, ends")
def add_event(statistics: Sequence[Statistic]) -> Iterator[str]:
    """Add a landing to the totals in place t where it is seen, and a flight where it ends."""
    for k, statistic, number in _numbers(statistics):
        total, counts = f"totals[{k}, t]", "ends" if statistic.of_flights else "seen"
        yield f"{total} = {statistic.joined(total, number)} if {counts} else {total}"


@_composed("totals, t")
def flight_sums(statistics: Sequence[Statistic]) -> Iterator[str]:
    """Return a sum that is not finite if a flight of place t is not."""
    sums = (
        f"totals[{k}, t]"
        for k, statistic in enumerate(statistics)
        if statistic.of_flights and statistic.summed
    )
    yield f"return {' + '.join(['0.0', *sums])}"


@_composed("i, particles, trajectories, out")
def add_up(statistics: Sequence[Statistic]) -> Iterator[str]:
    """Combine the particles of realization i, always in the same order.

    Their totals, the number of particles at rest for good and the worst status are written; an
    unwritten status, which is negative, counts as the worst.
    """
    yield "at_rest, status, least = 0, 0, 0"
    yield from (f"v{k} = {START[statistic.combine]}" for k, statistic in enumerate(statistics))
    yield "for t in range(i * particles, (i + 1) * particles):"
    for k, statistic in enumerate(statistics):
        yield f"    v{k} = {statistic.joined(f'v{k}', f'trajectories.totals[{k}, t]')}"
    yield "    at_rest += trajectories.at_rest[t]"
    yield "    code = trajectories.status[t]"
    yield "    status, least = max(status, code), min(least, code)"
    yield from (f"out.totals[{k}, i] = v{k}" for k in range(len(statistics)))
    yield "out.at_rest[i] = at_rest"
    yield "out.status[i] = status if least >= 0 else least"


@uncounted
def combine(
    first: int, last: int, particles: int, trajectories: Statistics, out: Statistics
) -> None:
    """Combine the particles of realizations first ... last - 1."""
    for i in range(first, last):
        add_up(out.kinds, i, particles, trajectories, out)


# --- Observers ------------------------------------------------------------------------------------
# An observer, such as a user's function, is called for every landing.  The loop over the lanes
# stores the last landing of each lane, without a branch; a second loop then calls the observer for
# lanes that have landed in the window.


@jit
def note(s: Floats, j: int, landing: Landing, n: float, seen: bool) -> None:
    """Store a landing of lane j, after n whole periods, and whether it is in the window."""
    s[ROW.LAST_X + j], s[ROW.LAST_TIME + j] = landing.phase, landing.flight_time
    s[ROW.LAST_SPEED + j], s[ROW.LAST_REBOUND + j] = landing.impact_speed, landing.rebound
    s[ROW.LAST_RESTS + j] = 1.0 if landing.rests else 0.0
    s[ROW.LAST_N + j], s[ROW.LAST_SEEN + j] = n, 1.0 if seen else 0.0


@generic
def observe(observer: Any, s: Floats, lanes: int, base: Base) -> None:
    """Call the observer for those of the first lanes that have just landed in the window."""


class Observer(NamedTuple):
    """A compiled function, and the totals of trajectories, of shape (trajectory, total)."""

    function: Callable[[Any, Any], None]
    totals: Floats
    initial: float  # value with which totals begin


@implements(observe, Observer)
def call_function(observer: Observer, s: Floats, lanes: int, base: Base) -> None:
    for j in range(lanes):
        if s[ROW.LAST_SEEN + j] > 0.0:
            landing = Landing(
                s[ROW.LAST_X + j],
                s[ROW.LAST_TIME + j],
                s[ROW.LAST_SPEED + j],
                s[ROW.LAST_REBOUND + j],
                s[ROW.LAST_RESTS + j] > 0.0,
            )
            observer.function(observer.totals[int(s[ROW.LANE + j])], landing)


# A user's function behaves as in plain Python: its exceptions are raised.
OF_A_USER: Final = OPTIONS | {"error_model": "python", "boundscheck": True}

_compiled: dict[tuple[str, str], Any] = {}  # by code of observables, and how landings combine


def compiled(observable: Observable) -> Any:
    """Compile an observable's function, once in a process.

    Returns the compiled function if it changes totals; an index out of range then raises an
    IndexError.  For a function that returns a number of a landing, returns the marker of its
    statistic.  Raises a ParameterError if numba cannot compile it.
    """
    key = observable.code, observable.landings
    if key not in _compiled:
        _require_compilable(observable)
        _compiled[key] = _made(observable)
    return _compiled[key]


def _made(observable: Observable) -> Any:
    if observable.landings:
        # machine code is identified by the names of types: this one changes with the function
        name = f"{observable.name}_{observable.landings}_{observable.code}"
        return declare(name, compiled_anew(observable.function, jit), observable.landings)
    if numba.config.DISABLE_JIT:
        return observable.function
    return compiled_anew(observable.function, njit(**OF_A_USER))


def _require_compilable(observable: Observable) -> None:
    landing = numba.typeof(Landing(0.0, 0.0, 0.0, 0.0, False))
    takes = (landing,) if observable.landings else (types.float64[::1], landing)
    require_compilable(
        observable.function,
        takes,
        njit(**OF_A_USER),
        f"observable {observable.name!r}: its function",
        real=bool(observable.landings),
    )
