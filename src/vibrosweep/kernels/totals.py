"""Totals of the chosen statistics, composed into the code of each kernel.

Each function takes a tuple of kinds of `kernels.statistics`.  For each such tuple it is compiled
once, from a text that names every statistic: there is no loop over statistics, and nothing is
chosen at run time.  In a block of lanes each statistic k has three rows behind those of
`kernels.lanes`:

    ROWS + k            the total; of a sum, the part since the last check of the lanes
    ROWS + n + k        of a sum, the part before the last check
    ROWS + 2 n + 1 + k  of the cycle that the lane has entered; ROWS + 2 n holds its periods
"""

from __future__ import annotations

import functools
import textwrap
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from vibrosweep.kernels._jit import Floats, Piece, fma, prefetch, uncounted
from vibrosweep.kernels.bases import Counted
from vibrosweep.kernels.lanes import ROWS, STRIDE, aligned
from vibrosweep.kernels.statistics import (
    COUNT,
    KINDS,
    LANDINGS,
    MAX,
    MIN,
    PRODUCTS,
    RESTS,
    START,
    SUM,
    Kinds,
    Statistic,
    Statistics,
    statistic_of,
)
from vibrosweep.model.observables import Landing

Cycle = tuple[float, ...]  # periods of a cycle, then the totals of its statistics

LINE = 8  # numbers in a cache line
OF_LANDINGS, OF_RESTS = (ROWS + LANDINGS) * STRIDE, (ROWS + RESTS) * STRIDE
PERIODS, CYCLE_LANDINGS, CYCLE_RESTS = 0, 1 + LANDINGS, 1 + RESTS  # places in a `Cycle`


def scratch(kinds: Kinds = KINDS, more: int = 0) -> Floats:
    """Scratch memory of one caller of `vibrosweep.kernels.advance.advance`, with `more` rows."""
    return aligned((ROWS + 3 * len(kinds) + 1 + more) * STRIDE)


def _composed(write: Callable[..., Iterator[str]]) -> Callable[..., Any]:
    """Turn a writer of the lines of a function into that function.

    It has the parameters of the writer, which is given the statistics as the first one.
    """
    parameters = ", ".join(write.__code__.co_varnames[: write.__code__.co_argcount])
    others = write.__code__.co_argcount - 1

    @functools.cache
    def composed(kinds: tuple[type, ...]) -> Any:
        statistics = [statistic_of(kind) for kind in kinds]
        names: dict[str, Any] = {f"number_{k}": s.number for k, s in enumerate(statistics)}
        names |= {"fma": fma, "prefetch": prefetch, "nan": float("nan"), "inf": float("inf")}
        names["__name__"] = __name__
        body = textwrap.indent("\n".join(write(statistics, *(None,) * others)), "    ")
        exec(f"def {write.__name__}({parameters}):\n{body}\n", names)
        return names[write.__name__]

    def call(kinds: Kinds, *arguments: Any) -> Any:
        return composed(tuple(map(type, kinds)))(kinds, *arguments)

    def code(kinds: Any, *arguments: Any) -> Any:
        return composed(tuple(kind.instance_class for kind in kinds))

    return Piece(write, call, code)


def _numbers(statistics: Sequence[Statistic]) -> Iterator[tuple[int, Statistic, str]]:
    """Yield each statistic's place, the statistic, and the text of its number.

    In a sum of products, the number of one landing is its rounded product.  A flight of no time,
    which stands for a rest that no flight follows, is left out of a minimum.
    """
    for k, kind in enumerate(statistics):
        number = f"number_{k}({'flight' if kind.of_flights else 'landing'})"
        if kind.combine == PRODUCTS:
            yield k, kind, f"{number}[0] * {number}[1]"
        elif kind.combine == MIN and kind.of_flights:
            yield k, kind, f"(1.0 * {number} if flight.time > 0.0 else inf)"
        else:
            yield k, kind, f"1.0 * {number}"


def _row(statistics: Sequence[Statistic], k: int) -> str:
    """Return the text of the place where the total of statistic k ends up."""
    return f"s[{(ROWS + k + (len(statistics) if statistics[k].summed else 0)) * STRIDE} + j]"


@_composed
def clear(kinds: Kinds, s: Floats, j: int) -> Iterator[str]:
    """Begin the statistics of the trajectory in place j."""
    for k, kind in enumerate(kinds):
        yield f"s[{(ROWS + k) * STRIDE} + j] = {START[kind.combine]}"
        if kind.summed:
            yield f"{_row(kinds, k)} = 0.0"
    yield f"s[{(ROWS + 2 * len(kinds) + CYCLE_LANDINGS) * STRIDE} + j] = 0.0  # no cycle is known"


@_composed
def count(
    kinds: Kinds, s: Floats, j: int, landing: Landing, flight: Counted, seen: bool, ends: bool
) -> Iterator[str]:
    """Count a landing in place j where it is seen, and a flight where it ends."""
    for k, kind, text in _numbers(kinds):
        row = f"s[{(ROWS + k) * STRIDE} + j]"
        counts = "ends" if kind.of_flights else "seen"
        number = f"number_{k}({'flight' if kind.of_flights else 'landing'})"
        if kind.combine == COUNT:
            yield f"{row} += 1.0 if {number} & {counts} else 0.0"
        elif kind.combine == SUM:
            yield f"{row} += {number} if {counts} else 0.0"
        elif kind.combine == PRODUCTS:
            yield f"a, b = {number}"
            yield f"{row} = fma(a if {counts} else 0.0, b if {counts} else 0.0, {row})"
        else:
            # adding 0.0 changes nothing, but keeps the compiler from choosing by a masked store,
            # which takes AMD processors without AVX-512 as long as ten ordinary ones
            yield f"v, w = {text}, {row} + 0.0"
            yield f"{row} = v if (v {'>' if kind.combine == MAX else '<'} w) & {counts} else w"


@_composed
def sum_up(kinds: Kinds, s: Floats, j: int, lost: bool) -> Iterator[str]:
    """Add the numbers since the last check to the sums; those of flights are NaN if `lost`."""
    yield "pass"
    for k, kind in enumerate(kinds):
        if kind.summed:
            # the total is rounded once for several impacts, which keeps its error small
            row, total = f"s[{(ROWS + k) * STRIDE} + j]", _row(kinds, k)
            both = f"{total} + {row}"
            yield f"{total} = " + (f"nan if lost else {both}" if kind.of_flights else both)
            yield f"{row} = 0.0"


@_composed
def no_impacts(kinds: Kinds) -> Iterator[str]:
    """Totals of no impacts."""
    starts = "".join(f", {START[kind.combine]}" for kind in kinds)
    yield f"return (0.0{starts})"


@_composed
def added(
    kinds: Kinds, to: Cycle, periods: float, landing: Landing, flight: Counted
) -> Iterator[str]:
    """Add an impact to the totals of a cycle, of which so many periods have passed."""
    sums = (kind.joined(f"to[{k + 1}]", number) for k, kind, number in _numbers(kinds))
    yield f"return (periods, {', '.join(sums)})"


@_composed
def set_cycle(kinds: Kinds, s: Floats, j: int, found: Cycle) -> Iterator[str]:
    """Keep the totals of the cycle that lane j has entered."""
    for k in range(1 + len(kinds)):
        yield f"s[{(ROWS + 2 * len(kinds) + k) * STRIDE} + j] = found[{k}]"


@_composed
def cycle_of(kinds: Kinds, s: Floats, j: int) -> Iterator[str]:
    """Return periods, landings and rests of the cycle of lane j; no landings if none is known."""
    rows = [ROWS + 2 * len(kinds) + k for k in (PERIODS, CYCLE_LANDINGS, CYCLE_RESTS)]
    yield f"return {', '.join(f's[{row * STRIDE} + j]' for row in rows)}"


@_composed
def keep_cycle(kinds: Kinds, rests: Floats, line: int, found: Cycle) -> Iterator[str]:
    """Keep the totals of a cycle in a line of `rests`."""
    for k in range(1 + len(kinds)):
        yield f"rests[line, {1 + k}] = found[{k}]"


@_composed
def kept_cycle(kinds: Kinds, rests: Floats, line: int) -> Iterator[str]:
    """Return the totals of a cycle that were kept in a line of `rests`."""
    yield f"return ({', '.join(f'rests[line, {1 + k}]' for k in range(1 + len(kinds)))})"


@_composed
def repeat(kinds: Kinds, s: Floats, j: int, times: float) -> Iterator[str]:
    """Count the landings of so many whole cycles in place j."""
    for k, kind in enumerate(kinds):
        row, cycle = _row(kinds, k), f"s[{(ROWS + 2 * len(kinds) + 1 + k) * STRIDE} + j]"
        if kind.summed or kind.combine == COUNT:
            yield f"{row} += times * {cycle}"
        else:
            yield f"v = {cycle} if times > 0.0 else {START[kind.combine]}"
            yield f"{row} = {kind.joined(row, 'v')}"


@_composed
def totals_of(kinds: Kinds, s: Floats, j: int) -> Iterator[str]:
    """Return the totals of place j."""
    yield f"return ({''.join(f'{_row(kinds, k)}, ' for k in range(len(kinds)))})"


@_composed
def with_flight(kinds: Kinds, totals: tuple[float, ...], flight: Counted) -> Iterator[str]:
    """Return totals with a flight added, and a sum that is not finite if a flight is not.

    A flight of no time and height adds nothing, except to a COUNT.
    """
    names = [f"v{k}" for k in range(len(kinds))]
    for k, kind, number in _numbers(kinds):
        total = f"totals[{k}]"
        yield f"{names[k]} = {kind.joined(total, number) if kind.of_flights else total}"
    sums = [names[k] for k, kind in enumerate(kinds) if kind.of_flights and kind.summed]
    yield f"return ({''.join(f'{name}, ' for name in names)}), {' + '.join(sums) or '0.0'}"


@_composed
def expect(kinds: Kinds, out: Statistics, lane: int) -> Iterator[str]:
    """Prefetch the memory of statistics that will be written a block of lanes later."""
    yield f"if lane % {LINE} > 0:  # the previous trajectory has prefetched this cache line"
    yield "    return"
    for k in range(len(kinds)):
        yield f"prefetch(out.totals, {k} * out.status.size + lane)"
    yield "prefetch(out.at_rest, lane)"
    yield "prefetch(out.status, lane)"


@_composed
def forget(kinds: Kinds, totals: Floats, t: int) -> Iterator[str]:
    """Reset the totals in place t to those of no landings."""
    for k, kind in enumerate(kinds):
        yield f"totals[{k}, t] = {START[kind.combine]}"


@_composed
def add_landing(kinds: Kinds, totals: Floats, t: int, landing: Landing) -> Iterator[str]:
    """Add a landing to the totals in place t."""
    for k, kind, number in _numbers(kinds):
        if not kind.of_flights:
            yield f"totals[{k}, t] = {kind.joined(f'totals[{k}, t]', number)}"


@_composed
def add_flight(kinds: Kinds, totals: Floats, t: int, flight: Counted) -> Iterator[str]:
    """Add a flight to the totals in place t."""
    for k, kind, number in _numbers(kinds):
        if kind.of_flights:
            yield f"totals[{k}, t] = {kind.joined(f'totals[{k}, t]', number)}"


@_composed
def flight_sums(kinds: Kinds, totals: Floats, t: int) -> Iterator[str]:
    """Return a sum that is not finite if a flight of place t is not."""
    sums = (f"totals[{k}, t]" for k, kind in enumerate(kinds) if kind.of_flights and kind.summed)
    yield f"return {' + '.join(['0.0', *sums])}"


@_composed
def add_up(
    kinds: Kinds, i: int, particles: int, trajectories: Statistics, out: Statistics
) -> Iterator[str]:
    """Combine the particles of realization i, always in the same order.

    Their totals, the number of particles at rest for good and the worst status are written; an
    unwritten status, which is negative, counts as the worst.
    """
    yield "at_rest, status, least = 0, 0, 0"
    yield from (f"v{k} = {START[kind.combine]}" for k, kind in enumerate(kinds))
    yield "for t in range(i * particles, (i + 1) * particles):"
    for k, kind in enumerate(kinds):
        yield f"    v{k} = {kind.joined(f'v{k}', f'trajectories.totals[{k}, t]')}"
    yield "    at_rest += trajectories.at_rest[t]"
    yield "    code = trajectories.status[t]"
    yield "    status, least = max(status, code), min(least, code)"
    yield from (f"out.totals[{k}, i] = v{k}" for k in range(len(kinds)))
    yield "out.at_rest[i] = at_rest"
    yield "out.status[i] = status if least >= 0 else least"


@uncounted
def combine(
    first: int, last: int, particles: int, trajectories: Statistics, out: Statistics
) -> None:
    """Combine the particles of realizations first ... last - 1."""
    for i in range(first, last):
        add_up(out.kinds, i, particles, trajectories, out)
