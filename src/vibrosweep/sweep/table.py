"""Tables of realizations, from CSV or netCDF: columns named as the physical parameters."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vibrosweep.errors import TableError
from vibrosweep.scene import PARAMETERS
from vibrosweep.store.trial import require_readable
from vibrosweep.sweep.spec import SweepSpec
from vibrosweep.sweep.spec_messages import nearest

if TYPE_CHECKING:
    from _csv import Reader

__all__ = ["read_table"]

Array = NDArray[np.float64]
# A sweep without them would run at the defaults, which nobody who writes a table means.
_EXPECTED = ("restitution", "amplitude")


def read_table(spec: SweepSpec) -> dict[str, Array]:
    """Read the table of a sweep whole.

    Returns
    -------
    dict
        Parameter name -> float64 array of shape (realization,), in the order of
        `scene.PARAMETERS`, each value within the parameter's range.

    Raises
    ------
    TableError
        The table cannot be read, lacks or repeats a column, has an unknown column, holds a value
        that is no finite number or out of range, or contradicts the sweep file.
    """
    path = spec.table
    if path is None:
        raise ValueError(f"design {spec.design!r} has no table")
    if not path.is_file():
        reason = "is not a file" if path.exists() else "there is no such table"
        raise TableError(f"{path}: {reason}; check sample.design in {_sweep(spec)}")
    read = _read_netcdf if path.suffix.lower() == ".nc" else _read_csv
    table = {name: _numbers(path, name, raw) for name, raw in read(path, spec).items()}
    if not all(values.size for values in table.values()):
        raise TableError(f"{path}: has no rows; give one for each realization")
    return table


def _sweep(spec: SweepSpec) -> str:
    return str(spec.source or "the sweep")


def _read_csv(path: Path, spec: SweepSpec) -> dict[str, NDArray[Any]]:
    """Return the chosen columns as text; Python's float then rounds each cell correctly."""
    try:
        # utf-8-sig: spreadsheets put a byte order mark first
        with path.open(encoding="utf-8-sig", newline="") as file:
            return _cells(path, csv.reader(file), spec)
    except UnicodeDecodeError as error:
        raise TableError(f"{path}: is not UTF-8 text; save it as UTF-8") from error
    except csv.Error as error:
        raise TableError(f"{path}: is not a table of comma-separated values: {error}") from error
    except OSError as error:
        raise TableError(f"{path}: cannot be read: {error.strerror}") from error


def _cells(path: Path, lines: Reader, spec: SweepSpec) -> dict[str, NDArray[Any]]:
    names = [name.strip() for name in next(lines, [])]
    if not names:
        raise TableError(f"{path}: is empty; begin with a line of column names")
    for name in names:
        if names.count(name) > 1:
            raise TableError(f'{path}: column "{name}" appears twice; keep one')
    chosen = [(names.index(name), name) for name in _chosen(path, names, spec)]
    cells: dict[str, list[str]] = {name: [] for _, name in chosen}
    for row in lines:
        if row and len(row) != len(names):
            raise TableError(
                f"{path}: line {lines.line_num} has {len(row)} values for {len(names)} columns; "
                f"give one for each"
            )
        if row:
            for place, name in chosen:
                cells[name].append(row[place].strip())
    return {name: np.array(texts, dtype=object) for name, texts in cells.items()}


def _read_netcdf(path: Path, spec: SweepSpec) -> dict[str, NDArray[Any]]:
    import xarray as xr

    try:
        require_readable(path)
        # times are not decoded: a contact_time in "s" would become a time span
        with xr.open_dataset(
            path, engine="h5netcdf", decode_times=False, phony_dims="access"
        ) as dataset:
            dataset.load()
    except Exception as error:  # what a damaged file makes the libraries raise has no common base
        raise TableError(f"{path}: is not a readable netCDF-4 file: {error}") from error
    # the index of a dimension, such as a running number, is no column
    found = [str(n) for n in dataset.variables if n not in dataset.dims or n in PARAMETERS]
    chosen = _chosen(path, found, spec)
    for name in chosen:
        dims = dataset[name].dims
        if len(dims) != 1 or dims != dataset[chosen[0]].dims:
            raise TableError(
                f'{path}: column "{name}" has the dimensions ({", ".join(map(str, dims))}); all '
                f"columns must have the same single one"
            )
    return {name: dataset[name].to_numpy() for name in chosen}


def _chosen(path: Path, found: list[str], spec: SweepSpec) -> list[str]:
    """Names of the columns to use, in the order of `scene.PARAMETERS`."""
    if spec.columns is not None:
        for name in spec.columns:
            if name not in found:
                raise _lacking(path, name, found, "sample.columns names it")
        return list(spec.columns)
    for name in found:
        if name not in PARAMETERS:
            raise _unknown(path, name)
        if name in spec.given:
            raise TableError(
                f'{path}: column "{name}" is also fixed, {name} = {spec.fixed[name]:g} in '
                f"{_sweep(spec)}; keep one of the two"
            )
    for name in _EXPECTED:
        if name not in found and name not in spec.given:
            raise _lacking(path, name, found, f"{_sweep(spec)} does not fix it")
    if not found:
        raise TableError(f"{path}: has no columns; known columns: {', '.join(PARAMETERS)}")
    return [name for name in PARAMETERS if name in found]


def _lacking(path: Path, name: str, found: Iterable[str], reason: str) -> TableError:
    has = ", ".join(found) or "none"
    return TableError(
        f'{path}: column "{name}" is missing and {reason}; add the column (columns found: {has}; '
        f"allowed values: {PARAMETERS[name].allowed}) or write {name} as a number in [scene]"
    )


def _unknown(path: Path, name: str) -> TableError:
    guess = nearest(name, PARAMETERS)
    hint = f'did you mean "{guess}"? ' if guess else ""
    return TableError(
        f'{path}: column "{name}" is not a physical parameter; {hint}Known columns: '
        f"{', '.join(PARAMETERS)}; to ignore others, list those to use in sample.columns"
    )


def _numbers(path: Path, name: str, values: NDArray[Any]) -> Array:
    """Return the column as float64, or raise with its first bad row."""
    parameter = PARAMETERS[name]
    if values.dtype.kind in "iuf":
        numbers = values.astype(np.float64)
    else:
        numbers = np.array([_number(value) for value in values], dtype=np.float64)
    bad = np.flatnonzero(~parameter.accepts(numbers))
    if bad.size:
        row = int(bad[0])
        more = f" ({bad.size} such rows in all)" if bad.size > 1 else ""
        raise TableError(
            f'{path}: column "{name}", row {row + 1} (the first row of values is 1): '
            f"{str(values[row]) or 'nothing'} is not allowed; the {parameter.long_name} must be a "
            f"number, {parameter.allowed}{more}; correct the table"
        )
    return numbers


def _number(value: object) -> float:
    """Return the value as a float; NaN, which no parameter accepts, for what is no number."""
    if isinstance(value, bool | np.bool_):
        return np.nan
    try:
        return float(str(value))
    except ValueError:
        return np.nan
