"""Realizations of a sweep: their parameters, chunk by chunk, in bounded memory.

The parameters of a realization depend only on the sweep and on its index, so that any division
into chunks gives the same bits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vibrosweep.abilities import refusal
from vibrosweep.arrays import Array
from vibrosweep.errors import TableError
from vibrosweep.mistakes import Mistake
from vibrosweep.model.measures import MEASURES
from vibrosweep.model.parameters import STREAM
from vibrosweep.scene.columns import Label
from vibrosweep.scene.design import DESIGNS, GRID, TABLE, Design
from vibrosweep.scene.sweep import Sweep

# (start, stop) -> one array of shape (stop - start,) for each sampled parameter
Columns = Callable[[int, int], Sequence[Array]]


@dataclass(frozen=True)
class Realizations:
    """The realizations of a sweep."""

    realizations: int
    # Names of the sampled parameters, in the order of `vibrosweep.model.forcing.INPUTS`; with noise
    # also `STREAM`
    sampled: tuple[str, ...]
    columns: Columns  # fastest for increasing starts
    # Other columns of a table, which are only copied to the result
    labels: Mapping[str, Label] = field(default_factory=dict)

    def take(self, start: int, stop: int) -> dict[str, Array]:
        """Return the sampled parameters of the realizations start, ..., stop - 1, in their units.

        Thread-safe; fastest for increasing `start`.  Raises an IndexError unless 0 <= start <= stop
        <= realizations.
        """
        if not 0 <= start <= stop <= self.realizations:
            raise IndexError(f"no realizations {start} to {stop} among {self.realizations}")
        return dict(zip(self.sampled, self.columns(start, stop), strict=True))


def open_design(sweep: Sweep) -> Realizations:
    """Open the design of a sweep.

    ``uniform`` draws independent values; ``latin`` puts one value of each parameter into each of as
    many equal slices as there are realizations; ``sobol`` is a scrambled low-discrepancy sequence,
    balanced best when the number of realizations is a power of two; ``grid`` takes all
    combinations, the last parameter varying fastest; ``table`` takes them from a table.  Raises a
    TableError if the table cannot be used, and a SpecError for more realizations than a Sobol'
    sequence has points, or than a Latin hypercube can hold in memory.
    """
    opened = _opened(sweep)
    noise = sweep.scene.noise(opened.sampled)
    if not noise:
        return opened
    if sweep.design.name == TABLE:  # its columns may have been unknown until now
        _require_random(sweep, noise)

    def columns(start: int, stop: int) -> list[Array]:
        return [*opened.columns(start, stop), np.arange(start, stop, dtype=np.float64)]

    return replace(opened, sampled=(*opened.sampled, STREAM), columns=columns)


def _require_random(sweep: Sweep, noise: tuple[str, ...]) -> None:
    """Raise a TableError if the base, or a measure, does not support the noise of a table."""
    measures = sweep.scene.measures
    for key in ("", *(key for key in MEASURES if getattr(measures, key))):
        if wrong := refusal(sweep.scene.base, measure=key, noise=noise):
            text = f"{key} {wrong}".lstrip()
            raise TableError(f"{sweep.design.table}: {', '.join(noise)}: {text}")


def _opened(sweep: Sweep) -> Realizations:
    """Open the design of a sweep, without the random streams."""
    design = sweep.design
    if design.name == TABLE:
        return _open_table(sweep)
    names, count = tuple(design.sampled), design.realizations or 1
    if not names:
        return Realizations(count, names, lambda start, stop: ())
    if design.name == GRID:
        return Realizations(count, names, _grid([*design.axes.values()]))
    try:
        return Realizations(count, names, _drawn(design, count))
    except ValueError as error:
        raise sweep.refusal(Mistake("sample.realizations", error.args, count)) from error


def chosen(design: Realizations, rows: Sequence[int]) -> Realizations:
    """Return some of the realizations of a design, selected by increasing indices."""
    places = np.asarray(rows, dtype=np.int64)

    def columns(start: int, stop: int) -> list[Array]:
        wanted = places[start:stop]
        spans = np.split(wanted, np.flatnonzero(np.diff(wanted) > 1) + 1) if wanted.size else []
        found = [design.take(int(span[0]), int(span[-1]) + 1) for span in spans]
        return [np.concatenate([np.empty(0), *(f[n] for f in found)]) for n in design.sampled]

    return Realizations(places.size, design.sampled, columns)


def _drawn(design: Design, count: int) -> Columns:
    kind, ends = DESIGNS[design.name], [spread.ends for spread in design.sampled.values()]
    rows = kind.points(count, len(ends), design.seed)

    def columns(start: int, stop: int) -> list[Array]:
        unit = rows(start, stop)
        return [kind.place(unit[:, j], low, high) for j, (low, high) in enumerate(ends)]

    return columns


def _grid(axes: Sequence[tuple[float, ...]]) -> Columns:
    values = [np.array(axis, dtype=np.float64) for axis in axes]
    shape = [len(axis) for axis in axes]

    def columns(start: int, stop: int) -> list[Array]:
        places = np.unravel_index(np.arange(start, stop), shape)
        return [axis[place] for axis, place in zip(values, places, strict=True)]

    return columns


def _open_table(sweep: Sweep) -> Realizations:
    from vibrosweep.scene.table import read_table  # few sweeps have a table

    design = sweep.design
    parameters, labels = read_table(sweep)
    count = len(next(iter(parameters.values())))
    if design.realizations not in (None, count):
        stated = f"realizations = {design.realizations}"
        key = f"sample.{stated} in {sweep.source}" if sweep.source else stated
        raise TableError(f"{design.table}: holds {count} rows, but {key}; leave that out")

    def columns(start: int, stop: int) -> list[Array]:
        return [values[start:stop].copy() for values in parameters.values()]

    return Realizations(count, tuple(parameters), columns, labels)
