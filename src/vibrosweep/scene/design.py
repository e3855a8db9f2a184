"""Designs: how the realizations of a sweep are drawn, laid out on a grid, or given by a table.

`DESIGNS` holds the designs that draw from ranges.  Each consists of a sequence of points in the
unit cube and a function that maps a coordinate to a value; `register_design` adds one.  The
parameters of a realization depend only on the sweep and on its index, so that any division into
chunks gives the same bits.  A table, from CSV, netCDF or memory, has columns named as the physical
parameters, and labels; all its mistakes are reported at once, each with its column, row and value.
"""

from __future__ import annotations

import csv
import hashlib
import math
import re
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.abilities import refusal
from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError, TableError, refuse
from vibrosweep.mistakes import (
    PYTHON,
    TOML,
    Key,
    Mistake,
    Mistakes,
    Text,
    escaped,
    separator_mistake,
    table,
)
from vibrosweep.model.forcing import FORCINGS, INPUTS, misspelled
from vibrosweep.model.functions import parts
from vibrosweep.model.measures import MEASURES, RESERVED
from vibrosweep.model.parameters import STREAM, mount_mistakes, noise_mistakes, refuse_masked
from vibrosweep.model.restitution_laws import range_mistake, speed_mistakes
from vibrosweep.store.arranged import REALIZATION, UNSTORABLE, flat
from vibrosweep.store.trial import require_readable

if TYPE_CHECKING:
    import xarray as xr

    from vibrosweep.scene.sweep import Sweep

__all__ = ["Realizations", "chosen", "open_design"]

# (start, stop) -> points start, ..., stop - 1 of the unit cube, shape (stop - start, parameters)
Rows = Callable[[int, int], Array]
# (realizations, parameters, seed) -> rows; a ValueError says what is allowed
Points = Callable[[int, int, int], Rows]
# (coordinates in [0, 1], low, high) -> values in [low, high]
Place = Callable[[Array, float, float], Array]

GRID: Final = "grid"
TABLE: Final = "table"
# A Latin hypercube permutes all rows at once: 160 MB, and four times that while it is drawn.
MAX_LATIN_VALUES: Final = 20_000_000
# Points are multiples of 2**-32 of the range; scipy cannot skip points of more bits (1.11 to 1.17).
_SOBOL_BITS: Final = 32


@dataclass(frozen=True)
class Range:
    """The range [low, high], low < high, from which a parameter is drawn, in its unit."""

    low: float
    high: float

    @property
    def ends(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return self.low, self.high


@dataclass(frozen=True)
class GridAxis:
    """The distinct values that a parameter takes along an axis of a grid, in its unit."""

    values: tuple[float, ...]

    @property
    def ends(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return min(self.values), max(self.values)


@dataclass(frozen=True)
class Design:
    """Choice of the realizations of a scene."""

    name: str = "uniform"  # a key of `DESIGNS`, ``"grid"`` or ``"table"``
    # Inputs that vary, in the order of `vibrosweep.model.forcing.INPUTS`: a `Range` where values
    # are drawn, a `GridAxis` under a grid; empty for a table, whose columns are known when it is
    # read
    sampled: Mapping[str, Range | GridAxis] = field(default_factory=dict)
    realizations: int | None = 1  # None for a table whose length the sweep does not state
    seed: int = 0
    table: Path | GivenTable | None = None  # the table, or its path; None for other designs
    # Columns of the table to use, parameters first and then labels; None for all
    columns: tuple[str, ...] | None = None

    @property
    def axes(self) -> dict[str, tuple[float, ...]]:
        """Values along the axes of a grid."""
        return {name: s.values for name, s in self.sampled.items() if isinstance(s, GridAxis)}

    @property
    def source(self) -> str:
        """Code of the functions that draw; empty for those of this package."""
        return DESIGNS[self.name].source if self.name in DESIGNS else ""


class Drawn(NamedTuple):
    """A design that draws values from ranges."""

    points: Points
    place: Place
    source: str = ""  # code of the functions; empty for those of this package


def linear(unit: Array, low: float, high: float) -> Array:
    """Place coordinates evenly in a range."""
    # clipped, because low + u (high - low) may round to just above high
    return np.minimum(low + unit * (high - low), high)


def _uniform(count: int, width: int, seed: int) -> Rows:
    def rows(start: int, stop: int) -> Array:
        # each float64 takes one step of the generator, so the steps of earlier rows can be skipped
        bits = np.random.PCG64(seed).advance(start * width)
        return np.random.Generator(bits).random((stop - start, width))

    return rows


def _sobol(count: int, width: int, seed: int) -> Rows:
    if count > 2**_SOBOL_BITS:
        raise ValueError(
            f"is more than the {2**_SOBOL_BITS} points of a Sobol' sequence; lower it, or use "
            f'design = "uniform"'
        )
    from scipy.stats import qmc

    engine = _seeded(qmc.Sobol, width, seed, bits=_SOBOL_BITS)
    lock = threading.Lock()

    def rows(start: int, stop: int) -> Array:
        found = [np.empty((0, width))]
        with lock:
            if start < engine.num_generated:
                engine.reset()
            if start > engine.num_generated:
                engine.fast_forward(start - engine.num_generated)
            elif start == 0 and stop > 0:
                # the first point separately: scipy warns of lost balance if the first draw is not a
                # power of two, which does not matter for a chunk
                found.append(engine.random(1))
            rest = stop - start - (len(found) - 1)
            if rest > 0:
                found.append(engine.random(rest))
        return np.concatenate(found)

    return rows


def _latin(count: int, width: int, seed: int) -> Rows:
    if count * width > MAX_LATIN_VALUES:
        raise ValueError(
            f"makes a Latin hypercube of {count * width} values, which must be held in memory; at "
            f"most {MAX_LATIN_VALUES} are allowed: lower it, or use "
            f'design = "sobol" or "uniform"'
        )
    from scipy.stats import qmc

    cube = _seeded(qmc.LatinHypercube, width, seed).random(count)
    return lambda start, stop: cube[start:stop]


def _seeded(engine: Callable[..., Any], width: int, seed: int, **options: int) -> Any:
    generator = np.random.default_rng(seed)
    try:
        return engine(width, rng=generator, **options)
    except TypeError:  # the keyword's name before scipy 1.15
        return engine(width, seed=generator, **options)


DESIGNS: Final[dict[str, Drawn]] = {
    "uniform": Drawn(_uniform, linear),
    "latin": Drawn(_latin, linear),
    "sobol": Drawn(_sobol, linear),
}


def begins_alike(name: str) -> bool:
    """Return whether a design begins with the same points, however many realizations it has."""
    return name in DESIGNS and DESIGNS[name].points in (_uniform, _sobol)


def register_design(name: str, place: Place, points: str | Points = "uniform") -> Place:
    """Register a design that draws realizations in its own way.

    Parameters
    ----------
    name
        Value of ``design`` that selects it.
    place
        ``place(unit, low, high)``, which turns coordinates, an array of numbers in [0, 1], into
        values in the range of a parameter.
    points
        Points of the unit cube: those of ``"uniform"``, ``"latin"``, ``"sobol"`` or another design,
        or a function ``points(realizations, parameters, seed)`` that returns a function
        ``rows(start, stop)`` of shape (stop - start, parameters).  A row must not depend on the
        slice in which it is requested.

    Returns
    -------
    function
        The same `place`.

    Raises
    ------
    ParameterError
        The name is taken, `points` is not the name of a design, or an argument has another type.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> def log_uniform(unit, low, high):
    ...     return low * (high / low) ** unit
    >>> registered = vs.register_design("log-uniform", log_uniform)
    >>> found = vs.sweep(amplitude=(0.01, 1.0), design="log-uniform", realizations=100)
    >>> bool(0.05 < found.amplitude.median() < 0.2)
    True
    """
    if not isinstance(name, str) or not name:
        raise ParameterError(f"name = {name!r}: must be the name of a design")
    if not callable(place):
        raise ParameterError(f"design {name!r}: place = {place!r} must be a function")
    if not isinstance(points, str) and not callable(points):
        raise ParameterError(
            f"design {name!r}: points = {points!r} must be the name of a design or a function"
        )
    functions = [place] if isinstance(points, str) else [place, points]
    code = "\n".join(text for one in functions for text in parts(one, f"design {name!r}"))  # type: ignore[arg-type]
    if name in (GRID, TABLE) or (name in DESIGNS and not DESIGNS[name].source):
        raise ParameterError(f"design {name!r}: this name is taken; choose another name")
    if isinstance(points, str) and points not in DESIGNS:
        raise ParameterError(f"points = {points!r}: must be one of {', '.join(DESIGNS)}")
    cube = DESIGNS[points].points if isinstance(points, str) else points
    DESIGNS[name] = Drawn(cube, place, code)
    return place


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


# Attributes of a label that are copied to the result
COPIED: Final = ("units", "long_name", "comment")


@dataclass(frozen=True)
class Label:
    """A column that is not a parameter, shape (realization,): numbers, or strings as objects."""

    values: NDArray[Any]
    attributes: Mapping[str, str] = field(default_factory=dict)
    dims: tuple[str, ...] = (REALIZATION,)


@dataclass(frozen=True)
class GivenTable:
    """A table in memory."""

    columns: Mapping[str, Label] = field(compare=False)  # as given, not yet checked
    digest: str  # of all names and values

    def __str__(self) -> str:
        return "the table in memory"

    @classmethod
    def from_table(cls, table: Any) -> GivenTable:
        """Take a pandas data frame, an xarray dataset or a mapping of columns.

        Raises a TableError for anything else, and a ParameterError for masked values.
        """
        if hasattr(table, "data_vars"):
            columns = columns_of(table)
        elif hasattr(table, "columns") and hasattr(table, "index"):
            columns = _of_frame(table)
        elif isinstance(table, Mapping):
            columns = {str(name): _of_values(str(name), v) for name, v in table.items()}
        else:
            raise TableError(
                f"design: an object of type {type(table).__name__} is not a table; give a "
                f"pandas.DataFrame, an xarray.Dataset or a dict of columns, or the path of a table"
            )
        return cls(columns, _digest(columns))


def columns_of(dataset: xr.Dataset) -> dict[str, Label]:
    """Return the columns of a dataset: parameters, and other variables along their dimension."""
    found = {str(name): variable for name, variable in flat(dataset).variables.items()}
    shared = next((v.dims for name, v in found.items() if name in INPUTS), None)
    return {
        name: Label(
            variable.to_numpy(),
            {key: str(variable.attrs[key]) for key in COPIED if key in variable.attrs},
            tuple(map(str, variable.dims)),
        )
        for name, variable in found.items()
        # the coordinate that numbers the realizations is not a column
        if name in INPUTS or (variable.dims == shared and name != REALIZATION)
    }


def _of_frame(frame: Any) -> dict[str, Label]:
    """Return the columns of a data frame, and its index if that has a name."""
    if any(name is not None for name in frame.index.names):
        frame = frame.reset_index()
    if not frame.columns.is_unique:
        twice = frame.columns[frame.columns.duplicated()][0]
        raise TableError(f'the table in memory: column "{twice}" appears twice; keep one')
    found = {}
    for name in frame.columns:
        values = frame[name].to_numpy()
        if values.dtype.kind not in "iuf":  # a missing text becomes an empty one
            values = frame[name].astype(object).where(frame[name].notna(), "").to_numpy()
        found[str(name)] = Label(values)
    return found


def _of_values(name: str, values: Any) -> Label:
    refuse_masked(name, values)
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise TableError(f'the table in memory: column "{name}" is not a list of values') from error
    dims = (REALIZATION, *(f"axis {k}" for k in range(1, array.ndim)))
    return Label(array, dims=dims[: array.ndim])


def _digest(columns: Mapping[str, Label]) -> str:
    digest = hashlib.blake2b(digest_size=8)
    for name, column in columns.items():
        values = column.values
        plain = values.tobytes() if values.dtype.kind in "iufb" else repr(values.tolist()).encode()
        about = (name, str(values.dtype), values.shape, sorted(column.attributes.items()))
        digest.update(repr(about).encode() + plain)
    return digest.hexdigest()


# Required columns: without them a sweep would silently run at the defaults.
_EXPECTED: Final = ("restitution", "amplitude")
# Largest number of mistakes that are listed.
_LISTED: Final = 20
# HDF5 lists the variables along a dimension in 64 KiB: 4095 at most, measured ones included.
_MOST_LABELS: Final = 3900

COLUMNS: Final = Key("sample.columns")
SCENE: Final = table("scene")


def read_table(sweep: Sweep) -> tuple[dict[str, Array], dict[str, Label]]:
    """Read the whole table of a sweep; return its parameters and its other columns, by name.

    Parameters have the order of `vibrosweep.model.forcing.INPUTS`, the shape (realization,) and
    values within their ranges.

    Raises
    ------
    TableError
        The table cannot be read or contradicts the sweep file; a column is missing, appears twice,
        has an unknown unit, or has almost the name of a parameter or the name of a variable of a
        result; a value is not a finite number or out of range.  All mistakes are listed.
    """
    path = sweep.design.table
    mistakes = Mistakes(str(sweep.design.table), dialect=PYTHON if sweep.source is None else TOML)
    if path is None:
        raise ValueError(f"design {sweep.design.name!r} has no table")
    if isinstance(path, GivenTable):
        columns = dict(path.columns)
    elif not path.is_file():
        reason = "is not a file" if path.exists() else "there is no such table"
        key = f"sample.design in {sweep.source}" if sweep.source else "design"
        raise TableError(f"{path}: {reason}; check {key}{escaped(path)}")
    elif path.suffix.lower() == ".nc":
        columns = _read_netcdf(path)
    else:
        columns = _read_csv(path, mistakes)
    chosen = _chosen(columns, sweep, mistakes)
    if not columns:
        mistakes.add_cell("has no columns; give one for each parameter that it samples")
    elif chosen and not columns[chosen[0]].values.size:
        mistakes.add_cell("has no rows; give one for each realization")
    parameters = {
        name: _numbers(name, columns[name], mistakes) for name in INPUTS if name in chosen
    }
    labels = {name: _label(columns[name]) for name in chosen if name not in INPUTS}
    _judge_labels(labels, mistakes)
    law, restitution = sweep.scene.restitution_law, parameters.get("restitution", np.empty(0))
    if wrong := range_mistake(law, restitution):
        mistakes.add("", wrong)
    refuse(mistakes, TableError, _LISTED)
    return parameters, labels


def _source(sweep: Sweep) -> str:
    return str(sweep.source or "the sweep")


def _read_csv(path: Path, mistakes: Mistakes) -> dict[str, Label]:
    """Return all columns as text, which `float` then rounds correctly."""
    try:
        # utf-8-sig: spreadsheets put a byte order mark first
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = csv.reader(file)
            names = [name.strip() for name in next(lines, [])]
            _judge_header(path, names, mistakes)
            rows = list(_rows(lines, len(names), mistakes))
    except UnicodeDecodeError as error:
        raise TableError(f"{path}: is not UTF-8 text; save it as UTF-8") from error
    except csv.Error as error:
        raise TableError(f"{path}: is not a table of comma-separated values: {error}") from error
    except OSError as error:
        raise TableError(f"{path}: cannot be read: {error.strerror}") from error
    cells = np.array(rows, dtype=object).reshape(-1, len(names))
    return {name: Label(cells[:, k]) for k, name in enumerate(names)}


def _judge_header(path: Path, names: list[str], mistakes: Mistakes) -> None:
    if not names:
        raise TableError(f"{path}: is empty; begin with a line of column names")
    if wrong := separator_mistake(names):
        raise TableError(f"{path}: {wrong}")
    for name in dict.fromkeys(names):
        if names.count(name) > 1:
            mistakes.add_cell("appears twice; keep one", name)


def _rows(lines: Any, width: int, mistakes: Mistakes) -> Iterator[list[str | None]]:
    """Yield the cells of each row that is not empty; all are None if their number is wrong."""
    for number, row in enumerate(filter(None, lines), start=1):
        if len(row) != width:
            rule = f"in line {lines.line_num} has {len(row)} values for {width} columns"
            mistakes.add_cell(rule, row=number, remedy="give one for each")
            yield [None] * width
        else:
            yield [cell.strip() for cell in row]


def _read_netcdf(path: Path) -> dict[str, Label]:
    """Return the columns of a netCDF file."""
    import xarray as xr

    try:
        require_readable(path)
        # times are not decoded: a contact_time in "s" would become a time span
        with xr.open_dataset(
            path, engine="h5netcdf", decode_times=False, phony_dims="access"
        ) as dataset:
            whole = dataset.load()
    except Exception as error:  # the libraries' exceptions for damaged files have no common base
        raise TableError(f"{path}: is not a readable netCDF-4 file: {error}") from error
    return columns_of(whole)


def _chosen(columns: Mapping[str, Label], sweep: Sweep, mistakes: Mistakes) -> list[str]:
    """Return the names of the columns to use; report columns that are missing or contradictory."""
    found = list(columns)
    if sweep.design.columns is not None:
        for name in sweep.design.columns:
            if name not in columns:
                mistakes.add_cell(_lacking(name, found, (COLUMNS, " names it")), name)
        chosen = [name for name in sweep.design.columns if name in columns]
    else:
        for name in found:
            if name in sweep.scene.given:
                rule = f"is also fixed, {name} = {sweep.scene.inputs[name]:g} in {_source(sweep)}"
                mistakes.add_cell(rule, name, remedy="keep one of the two")
        meant = [misspelled(name, sweep.scene.base) for name in found if name not in INPUTS]
        known = {*found, *sweep.scene.given, *meant}
        for name in _EXPECTED:
            same = FORCINGS if name in FORCINGS else (name,)
            if known.isdisjoint(same):
                mistakes.add_cell(_lacking(name, found, f"{_source(sweep)} does not fix it"), name)
        chosen = found
    forcings = [name for name in FORCINGS if name in chosen or name in sweep.scene.given]
    if len(forcings) > 1:
        rule = f"{forcings[0]} and {forcings[1]} both give the forcing, here or in {_source(sweep)}"
        mistakes.add_cell(rule, remedy="keep one of the two")
    given = {*chosen, *sweep.scene.given}
    wrong = mount_mistakes(sweep.scene.base, given)
    wrong |= speed_mistakes(sweep.scene.restitution_law, given) | noise_mistakes(given)
    for name, text in wrong.items():
        fixed = name in sweep.scene.given
        lacks = not fixed and name not in chosen
        remedy = ("add the column, or write it as a number in ", SCENE) if lacks else ""
        rule = f"{name} in {_source(sweep)} {text}" if fixed else text
        mistakes.add_cell(rule, None if fixed else name, remedy=remedy)
    for name in chosen:
        _judge_name(name, sweep, mistakes)
    _judge_shapes({name: columns[name] for name in chosen}, mistakes)
    return chosen


def _judge_name(name: str, sweep: Sweep, mistakes: Mistakes) -> None:
    """Check that the name of a column that is not a parameter can be a label."""
    if name in INPUTS:
        return
    from vibrosweep.scene.keys import SECTIONS  # which imports this module

    elsewhere = ("rename it, or list the columns to use in ", COLUMNS)
    guess = None if sweep.design.columns else misspelled(name, sweep.scene.base)
    if guess:
        rule = f'is not a physical parameter; did you mean "{guess}"?'
        remedy = ("to keep it as a label rename it, to leave it out list the others in ", COLUMNS)
        mistakes.add_cell(f"{rule} Known columns: {', '.join(INPUTS)}", name, remedy=remedy)
    elif name in RESERVED.union(sweep.scene.measures.observable_names):
        mistakes.add_cell("has the name of a variable of a result", name, remedy=elsewhere)
    elif name in {*SECTIONS["scene"], *SECTIONS["measure"]}:
        rule = "has the name of a key that is the same for all realizations"
        mistakes.add_cell(rule, name, remedy=elsewhere)
    elif not name.isidentifier():
        rule = (
            "cannot be a label of a result: names of labels are made of letters, digits and "
            "underscores"
        )
        mistakes.add_cell(rule, name, remedy=elsewhere)


def _judge_shapes(columns: Mapping[str, Label], mistakes: Mistakes) -> None:
    """Check that all columns lie along the same single dimension."""
    shared = next((column.dims for column in columns.values()), ())
    for name, column in columns.items():
        if len(column.dims) != 1 or column.dims != shared:
            rule = f"has the dimensions ({', '.join(column.dims)})"
            mistakes.add_cell(rule, name, remedy="all columns must share a single dimension")
    lengths = {name: column.values.size for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        rule = f"its columns differ in length, {lengths}"
        mistakes.add_cell(rule, remedy="give a value for each realization")


def _lacking(name: str, found: Iterable[str], reason: Text) -> Text:
    has = ", ".join(found) or "none"
    allowed = f"; allowed values: {INPUTS[name].allowed}" if name in INPUTS else ""
    fixed = (f" or write {name} as a number in ", SCENE) if name in INPUTS else ()
    add = f"; add the column (columns found: {has}{allowed})"
    return ("is missing and ", reason, add, fixed)


def _numbers(name: str, column: Label, mistakes: Mistakes) -> Array:
    """Return a column in the parameter's unit as float64; report invalid values."""
    parameter, values = INPUTS[name], column.values
    if values.dtype.kind in "iuf":
        numbers = values.astype(np.float64)
    else:
        numbers = np.array([_number(value) for value in values.ravel()], dtype=np.float64)
    unit = column.attributes.get("units", parameter.units)
    scale = factor(unit, parameter.units)
    if scale is None:
        mistakes.add_cell(
            f"is in {unit!r}, which is not a known unit of the {parameter.long_name}; convert it "
            f"to {parameter.units}; known are products of {', '.join(KNOWN_UNITS)}, as in mm s-1",
            name,
        )
        return numbers
    numbers = numbers * scale[0] / scale[1]
    for row in np.flatnonzero(~parameter.accepts(numbers)).tolist():
        value = values.ravel()[row]
        if value is not None:
            in_unit = f"{unit} " if "units" in column.attributes and str(value) else ""
            mistakes.add_cell(
                f"{in_unit}is not allowed; the {parameter.long_name} must be a number, "
                f"{parameter.allowed}",
                name,
                row + 1,
                value,
                "correct the table",
            )
    return numbers


def _number(value: Any) -> float:
    """Return the value as a float, or NaN, which no parameter accepts, if it is not a number."""
    if hasattr(value, "as_integer_ratio") and not isinstance(value, bool | np.bool_):
        with suppress(OverflowError):  # a fraction beyond the range of doubles
            return float(value)
    text = str(value)
    # Python takes 1_2 for 12, and digits of any script
    if isinstance(value, bool | np.bool_) or "_" in text or not text.isascii():
        return np.nan
    try:
        return float(text)
    except ValueError:
        return np.nan


def _judge_labels(labels: Mapping[str, Label], mistakes: Mistakes) -> None:
    """Check that a result file can hold the labels."""
    if len(labels) > _MOST_LABELS:
        mistakes.add_cell(
            f"has {len(labels)} columns that are not parameters; a result holds at most "
            f"{_MOST_LABELS}",
            remedy=("list the columns to use in ", COLUMNS),
        )
    for name, label in labels.items():
        texts = label.values.tolist() if label.values.dtype == object else []
        for row, text in enumerate(texts, start=1):
            if UNSTORABLE.search(text):
                rule = "has a character that no text in a file may have"
                mistakes.add_cell(rule, name, row, text, "correct the table")


def _label(column: Label) -> Label:
    """Return a label as numbers if each of its values is a number or missing; else as texts."""
    values = column.values
    if values.dtype.kind in "iuf":
        numbers = values.astype(np.float64)
        exact = values.dtype.kind == "f" or np.array_equal(numbers.astype(values.dtype), values)
    else:
        texts = [v.decode() if isinstance(v, bytes) else str(v) for v in values]
        numbers = np.array([_number(text) for text in texts])
        # 007 is a name, and so is an integer with more digits than a double holds
        exact = any(texts) and all(
            not text or (abs(number) <= 2.0**53 and not re.match(r"[+-]?0\d", text))
            for text, number in zip(texts, numbers, strict=True)
        )
        values = np.array(texts, dtype=object)
    return Label(numbers if exact else values.astype(str).astype(object), column.attributes)


# Unit -> numerator and denominator of its size, and its dimension with an exponent.  Dividing by
# the integer 1000 is rounded once; multiplying by 0.001 would be rounded twice.
_UNITS: Final[Mapping[str, tuple[float, float, str, int]]] = {
    "m": (1, 1, "m", 1),
    "km": (1000, 1, "m", 1),
    "cm": (1, 100, "m", 1),
    "mm": (1, 1000, "m", 1),
    "um": (1, 10**6, "m", 1),
    "kg": (1, 1, "kg", 1),
    "g": (1, 1000, "kg", 1),
    "mg": (1, 10**6, "kg", 1),
    "s": (1, 1, "s", 1),
    "ms": (1, 1000, "s", 1),
    "us": (1, 10**6, "s", 1),
    "ns": (1, 10**9, "s", 1),
    "min": (60, 1, "s", 1),
    "h": (3600, 1, "s", 1),
    "Hz": (1, 1, "s", -1),
    "mHz": (1, 1000, "s", -1),
    "kHz": (1000, 1, "s", -1),
    "MHz": (10**6, 1, "s", -1),
    "rpm": (1, 60, "s", -1),
    "rad": (1, 1, "rad", 1),
    "mrad": (1, 1000, "rad", 1),
    "deg": (math.pi, 180, "rad", 1),
    "degree": (math.pi, 180, "rad", 1),
    "degrees": (math.pi, 180, "rad", 1),
    "turn": (2.0 * math.pi, 1, "rad", 1),
    "1": (1, 1, "", 0),
    "%": (1, 100, "", 0),
    "percent": (1, 100, "", 0),
}
KNOWN_UNITS: Final = tuple(_UNITS)
_SAME: Final = {"\N{MICRO SIGN}": "u", "\N{GREEK SMALL LETTER MU}": "u", "\N{DEGREE SIGN}": "deg"}
_FACTOR: Final = re.compile(r"([A-Za-z%]+|1)(?:\^|\*\*)?([+-]?[1-9])?")


def factor(unit: str, wanted: str) -> tuple[float, float] | None:
    """Return numerator and denominator of the factor that converts a value to the wanted unit.

    A unit is a product of known units with exponents, as ``mm s-1``, ``mm.s^-1`` or ``mm/s``.
    Returns None if it is not known or has other dimensions than the wanted one.
    """
    given, target = _parsed(unit), _parsed(wanted)
    if given is None or target is None or given[2] != target[2]:
        return None
    return given[0] * target[1], given[1] * target[0]


def _parsed(unit: str) -> tuple[float, float, Mapping[str, int]] | None:
    """Return numerator and denominator of the size of a unit, and exponents of its dimensions."""
    for mark, plain in _SAME.items():
        unit = unit.replace(mark, plain)
    numerator, denominator, dimensions = 1.0, 1.0, Counter[str]()
    for k, side in enumerate(unit.split("/")):
        for word in re.split(r"[\s.]+|(?<!\*)\*(?!\*)", side.strip()):
            match = _FACTOR.fullmatch(word)
            if match is None or match[1] not in _UNITS:
                return None
            above, below, dimension, exponent = _UNITS[match[1]]
            power = int(match[2] or 1) * (-1 if k else 1)
            if power < 0:
                above, below = below, above
            numerator, denominator = (
                numerator * above ** abs(power),
                denominator * below ** abs(power),
            )
            dimensions[dimension] += exponent * power
    return numerator, denominator, {d: n for d, n in dimensions.items() if n and d}
