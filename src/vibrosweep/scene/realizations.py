"""Realizations of a sweep: their parameters, chunk by chunk, in bounded memory.

The parameters of a realization depend only on the sweep and on its index, so that any division
into chunks gives the same bits.  A table of realizations, from CSV or netCDF, has columns named as
the physical parameters, and labels; all its mistakes are reported at once, each with its column,
row and value.
"""

from __future__ import annotations

import csv
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from vibrosweep.abilities import refusal
from vibrosweep.arrays import Array
from vibrosweep.errors import TableError, refuse
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
from vibrosweep.model.measures import MEASURES, RESERVED
from vibrosweep.model.parameters import STREAM, mount_mistakes, noise_mistakes
from vibrosweep.model.restitution_laws import range_mistake, speed_mistakes
from vibrosweep.scene.design import DESIGNS, GRID, TABLE, Design, GivenTable, Label, columns_of
from vibrosweep.scene.keys import SECTIONS
from vibrosweep.scene.sweep import Sweep
from vibrosweep.store.arranged import UNSTORABLE
from vibrosweep.store.trial import require_readable

__all__ = ["Realizations", "chosen", "open_design"]

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
