"""Designs: the parameters of a sweep's realizations, chunk by chunk, in bounded memory.

The values of a realization depend on the spec and on its index alone: any chunking gives the same
bits.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.errors import TableError
from vibrosweep.mistakes import Key
from vibrosweep.spec.columns import Label
from vibrosweep.spec.rules import Axis, Range
from vibrosweep.spec.sweep import SweepSpec
from vibrosweep.spec.table import read_table

# (start, stop) -> one array of shape (stop - start,) for each sampled parameter
Columns = Callable[[int, int], Sequence[Array]]

# A Latin hypercube permutes all rows at once: 160 MB, and four times that while it is drawn.
MAX_LATIN_VALUES: Final = 20_000_000
# Points are multiples of 2**-32 of the range; scipy cannot skip points of more bits (1.11 to 1.17).
_SOBOL_BITS: Final = 32


@dataclass(frozen=True)
class Design:
    """The realizations of a sweep."""

    realizations: int
    # Names of the sampled parameters, in the order of `vibrosweep.model.forcing.INPUTS`
    sampled: tuple[str, ...]
    _columns: Columns
    # Other columns of a table, which are copied to the result only
    labels: Mapping[str, Label] = field(default_factory=dict)

    def take(self, start: int, stop: int) -> dict[str, Array]:
        """Return the sampled parameters of the realizations start, ..., stop - 1, in their units.

        Thread-safe; fastest for increasing `start`.  An IndexError unless 0 <= start <= stop <=
        realizations.
        """
        if not 0 <= start <= stop <= self.realizations:
            raise IndexError(f"no realizations {start} to {stop} among {self.realizations}")
        return dict(zip(self.sampled, self._columns(start, stop), strict=True))


def open_design(spec: SweepSpec) -> Design:
    """Open the design of a sweep.

    ``uniform`` draws independent values; ``latin`` puts one value of each parameter into each of as
    many equal slices as there are realizations; ``sobol`` is a scrambled low-discrepancy sequence,
    balanced best when the number of realizations is a power of two; ``grid`` takes all
    combinations, the last parameter varying fastest; ``table`` reads them.  Raises a TableError
    where the table cannot be used, and a SpecError for more realizations than a Sobol' sequence has
    points, or than a Latin hypercube in memory.
    """
    if spec.design == "table":
        return _open_table(spec)
    names = tuple(spec.sampled)
    count = spec.realizations or 1
    if not names:
        return Design(count, names, lambda start, stop: ())
    if spec.design == "grid":
        axes = [s.values for s in spec.sampled.values() if isinstance(s, Axis)]
        return Design(count, names, _grid(axes))
    ranges = [s for s in spec.sampled.values() if isinstance(s, Range)]
    rows = {"uniform": _uniform, "sobol": _sobol, "latin": _latin}[spec.design](spec)
    return Design(count, names, _scaled(rows, ranges))


def chosen(design: Design, rows: Sequence[int]) -> Design:
    """Return the design of some realizations of another, given by their growing indices."""
    places = np.asarray(rows, dtype=np.int64)

    def columns(start: int, stop: int) -> list[Array]:
        wanted = places[start:stop]
        spans = np.split(wanted, np.flatnonzero(np.diff(wanted) > 1) + 1) if wanted.size else []
        found = [design.take(int(span[0]), int(span[-1]) + 1) for span in spans]
        return [np.concatenate([np.empty(0), *(f[n] for f in found)]) for n in design.sampled]

    return Design(places.size, design.sampled, columns)


def _scaled(rows: Callable[[int, int], Array], ranges: Sequence[Range]) -> Columns:
    """Map points of the unit cube, of shape (stop - start, sampled), onto the ranges."""

    def columns(start: int, stop: int) -> list[Array]:
        unit = rows(start, stop)
        # clipped, because low + u (high - low) may round to just above high
        return [
            np.minimum(r.low + unit[:, j] * (r.high - r.low), r.high) for j, r in enumerate(ranges)
        ]

    return columns


def _uniform(spec: SweepSpec) -> Callable[[int, int], Array]:
    width = len(spec.sampled)

    def rows(start: int, stop: int) -> Array:
        # one float64 takes one step of the generator, so a chunk can skip to its place
        bits = np.random.PCG64(spec.seed).advance(start * width)
        return np.random.Generator(bits).random((stop - start, width))

    return rows


def _sobol(spec: SweepSpec) -> Callable[[int, int], Array]:
    if (spec.realizations or 1) > 2**_SOBOL_BITS:
        raise spec.refusal(
            (
                Key("sample.realizations"),
                f" = {spec.realizations} is more than the {2**_SOBOL_BITS} points of a Sobol' "
                f'sequence; lower it, or use design = "uniform"',
            )
        )
    from scipy.stats import qmc

    engine = _seeded(qmc.Sobol, spec, bits=_SOBOL_BITS)
    lock = threading.Lock()

    def rows(start: int, stop: int) -> Array:
        parts = [np.empty((0, len(spec.sampled)))]
        with lock:
            if start < engine.num_generated:
                engine.reset()
            if start > engine.num_generated:
                engine.fast_forward(start - engine.num_generated)
            elif start == 0 and stop > 0:
                # the first point separately: scipy warns of lost balance if the first draw is not a
                # power of two, which does not matter for a chunk
                parts.append(engine.random(1))
            rest = stop - start - (len(parts) - 1)
            if rest > 0:
                parts.append(engine.random(rest))
        return np.concatenate(parts)

    return rows


def _latin(spec: SweepSpec) -> Callable[[int, int], Array]:
    count = spec.realizations or 1
    values = count * len(spec.sampled)
    if values > MAX_LATIN_VALUES:
        raise spec.refusal(
            (
                Key("sample.realizations"),
                f" = {count} makes a Latin hypercube of {values} values, which must be held in "
                f"memory; at most {MAX_LATIN_VALUES} are allowed: lower it, or use "
                f'design = "sobol" or "uniform"',
            )
        )
    from scipy.stats import qmc

    cube = _seeded(qmc.LatinHypercube, spec).random(count)
    return lambda start, stop: cube[start:stop]


def _seeded(engine: Callable[..., Any], spec: SweepSpec, **options: int) -> Any:
    generator = np.random.default_rng(spec.seed)
    try:
        return engine(len(spec.sampled), rng=generator, **options)
    except TypeError:  # the keyword's name before scipy 1.15
        return engine(len(spec.sampled), seed=generator, **options)


def _grid(axes: Sequence[tuple[float, ...]]) -> Columns:
    values = [np.array(axis, dtype=np.float64) for axis in axes]
    shape = [len(axis) for axis in axes]

    def columns(start: int, stop: int) -> list[Array]:
        places = np.unravel_index(np.arange(start, stop), shape)
        return [axis[place] for axis, place in zip(values, places, strict=True)]

    return columns


def _open_table(spec: SweepSpec) -> Design:
    table = read_table(spec)
    count = len(next(iter(table.parameters.values())))
    if spec.realizations not in (None, count):
        asks = f"realizations = {spec.realizations}"
        key = f"sample.{asks} in {spec.source}" if spec.source else asks
        raise TableError(f"{spec.table}: holds {count} rows, but {key}; leave that out")
    return Design(count, tuple(table.parameters), _slices(table.parameters), table.labels)


def _slices(table: Mapping[str, Array]) -> Columns:
    return lambda start, stop: [values[start:stop].copy() for values in table.values()]
