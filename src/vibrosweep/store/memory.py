"""A result in memory: takes what the file of a sweep takes, and becomes a dataset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vibrosweep.model.measures import Variable

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["InMemory"]


@dataclass
class InMemory:
    """The counterpart of `vibrosweep.store.dataset.Group`, with the same methods."""

    _sizes: dict[str, int] = field(default_factory=dict)
    _coordinates: dict[str, Any] = field(default_factory=dict)
    _variables: dict[str, Any] = field(default_factory=dict)
    _attributes: dict[str, Any] = field(default_factory=dict)

    def dimensions(self, sizes: Mapping[str, int]) -> None:
        """Declare dimensions by name and length."""
        self._sizes.update(sizes)

    def coordinate(
        self,
        name: str,
        dims: tuple[str, ...],
        attributes: Mapping[str, Any],
        values: NDArray[Any] | None = None,
    ) -> None:
        """Declare a coordinate, whose values are written later where they are not given."""
        room = np.empty(self._shape(dims)) if values is None else values
        self._coordinates[name] = (dims, room, dict(attributes))

    def variable(self, variable: Variable) -> None:
        """Declare a variable of the registry."""
        room = np.empty(self._shape(variable.dims), variable.dtype)
        self._variables[variable.name] = (variable.dims, room, variable.attributes)

    def write(self, name: str, start: int, values: NDArray[Any]) -> None:
        """Write a piece that begins at index `start` of the first dimension."""
        _, room, _ = self._coordinates.get(name) or self._variables[name]
        room[start : start + values.shape[0]] = values

    def attributes(self, values: Mapping[str, Any]) -> None:
        """Set attributes."""
        self._attributes.update(values)

    def dataset(self) -> xr.Dataset:
        """Return the dataset, once all is written."""
        import xarray as xr

        return xr.Dataset(self._variables, self._coordinates, self._attributes)

    def _shape(self, dims: tuple[str, ...]) -> tuple[int, ...]:
        return tuple(self._sizes[dim] for dim in dims)
