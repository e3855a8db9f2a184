"""Columns of a table of realizations, and tables that are given in memory, not as a file."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.errors import TableError
from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.parameters import refuse_masked
from vibrosweep.store.arranged import REALIZATION
from vibrosweep.store.rows import flat

if TYPE_CHECKING:
    import xarray as xr

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
