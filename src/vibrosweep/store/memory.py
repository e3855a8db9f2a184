"""A result in memory: it is written like a file, and becomes a dataset."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vibrosweep.model.measures import Variable
from vibrosweep.store.rows import REALIZATION, along, require_written

if TYPE_CHECKING:
    import xarray as xr


@dataclass
class InMemory:
    """The counterpart of `vibrosweep.store.dataset.Group`, with the same methods."""

    _sizes: dict[str, int] = field(default_factory=dict)
    _axes: tuple[str, ...] = (REALIZATION,)
    _coordinates: dict[str, Any] = field(default_factory=dict)
    _variables: dict[str, Any] = field(default_factory=dict)
    _attributes: dict[str, Any] = field(default_factory=dict)
    _missing: dict[str, int] = field(default_factory=dict)

    def dimensions(self, sizes: Mapping[str, int], axes: tuple[str, ...] = (REALIZATION,)) -> None:
        """Declare dimensions by name and length; realizations lie along `axes`."""
        self._axes = axes
        self._sizes.update(sizes)

    def coordinate(
        self,
        name: str,
        dims: tuple[str, ...],
        attributes: Mapping[str, Any],
        values: NDArray[Any] | None = None,
    ) -> None:
        """Declare a coordinate; values that are not given are written later."""
        if values is None:
            values = np.full(self._shape(dims), np.nan)
            self._missing[name] = values.size
        self._coordinates[name] = (dims, values, dict(attributes))

    def fixed(self, name: str, attributes: Mapping[str, Any], value: float) -> None:
        """Take a value that all realizations share as a variable without dimensions."""
        self._variables[name] = ((), value, dict(attributes))

    def variable(self, variable: Variable) -> None:
        """Declare a variable of the registry."""
        dims = along(variable.dims, self._axes)
        values = np.full(self._shape(dims), variable.blank, variable.dtype)
        self._variables[variable.name] = (dims, values, variable.attributes)
        self._missing[variable.name] = math.prod(self._sizes[axis] for axis in self._axes)

    def write(self, name: str, start: int, values: NDArray[Any]) -> None:
        """Write a piece that begins at realization `start`."""
        _, whole, _ = self._coordinates.get(name) or self._variables[name]
        rows = whole.reshape(-1, *values.shape[1:])  # a view
        rows[start : start + values.shape[0]] = values
        self._missing[name] -= values.shape[0]

    def awaits(self, name: str) -> bool:
        """Tell whether values of a variable are still to be written."""
        return self._missing.get(name, 0) > 0

    def attributes(self, values: Mapping[str, Any]) -> None:
        """Set attributes."""
        self._attributes.update(values)

    def dataset(self) -> xr.Dataset:
        """Return the dataset; a RunError where values were never written."""
        import xarray as xr

        require_written("the result", self._missing)
        return xr.Dataset(self._variables, self._coordinates, self._attributes)

    def _shape(self, dims: tuple[str, ...]) -> tuple[int, ...]:
        return tuple(self._sizes[dim] for dim in dims)
