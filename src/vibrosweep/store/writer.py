"""The writer of a result, in a file or in memory: it declares arrays and appends their rows.

Every declared array must be filled; a result with missing rows is refused.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from vibrosweep.errors import RunError
from vibrosweep.model.measures import Variable
from vibrosweep.store.arranged import REALIZATION
from vibrosweep.store.rows import along, boxes

Attributes = Mapping[str, Any]


class Writer(ABC):
    """A result that is being written; rows are appended along its realizations."""

    def __init__(self) -> None:
        self._sizes: dict[str, int] = {}
        self._axes: tuple[str, ...] = (REALIZATION,)
        self._arrays: dict[str, tuple[tuple[str, ...], Any, Attributes]] = {}
        self._coordinates: list[str] = []
        self._missing: dict[str, int] = {}

    @abstractmethod
    def _create(
        self, name: str, shape: tuple[int, ...], dtype: Any, attributes: Attributes, blank: float
    ) -> Any:
        """Create an array; one in memory holds `blank` until it is written."""

    @abstractmethod
    def attributes(self, values: Attributes) -> None:
        """Set attributes of the result."""

    def dimensions(self, sizes: Mapping[str, int], axes: tuple[str, ...] = (REALIZATION,)) -> None:
        """Declare dimensions by name and length; realizations lie along `axes`."""
        self._axes = axes
        self._sizes.update(sizes)

    def coordinate(
        self,
        name: str,
        dims: tuple[str, ...],
        attributes: Attributes,
        values: NDArray[Any] | None = None,
    ) -> None:
        """Declare a coordinate of all variables declared after it.

        `values`, numbers or strings as objects, are written at once; without them, `write` adds
        them piece by piece.
        """
        texts = values is not None and values.dtype == object
        array = self._declare(name, dims, object if texts else "float64", attributes)
        if values is None:
            self._missing[name] = math.prod(array.shape)
        else:
            array[...] = values
        self._coordinates.append(name)

    def fixed(self, name: str, attributes: Attributes, value: float) -> None:
        """Write a value that all realizations share as a variable without dimensions.

        It is not a coordinate, because xarray prints every scalar coordinate above a plot.
        """
        self._declare(name, (), "float64", attributes)[...] = value

    def array(
        self, name: str, dims: tuple[str, ...], attributes: Attributes, values: NDArray[Any]
    ) -> None:
        """Write a whole array that does not lie along realizations."""
        self._declare(name, dims, values.dtype, attributes)[...] = values

    def variable(self, variable: Variable) -> None:
        """Declare a variable of the registry."""
        dims, attributes = along(variable.dims, self._axes), self._described(variable)
        self._declare(variable.name, dims, variable.dtype, attributes, variable.blank)
        self._missing[variable.name] = math.prod(self._sizes[axis] for axis in self._axes)

    def _described(self, variable: Variable) -> Attributes:
        return variable.attributes

    def _declare(
        self,
        name: str,
        dims: tuple[str, ...],
        dtype: Any,
        attributes: Attributes,
        blank: float = math.nan,
    ) -> Any:
        shape = tuple(self._sizes[dim] for dim in dims)
        array = self._create(name, shape, dtype, attributes, blank)
        self._arrays[name] = dims, array, attributes
        return array

    def write(self, name: str, start: int, values: NDArray[Any]) -> None:
        """Write a piece that begins at realization `start`."""
        array, done = self._arrays[name][1], 0
        sizes = [self._sizes[axis] for axis in self._axes]
        for box in boxes(sizes, start, start + values.shape[0]):
            shape = [side.stop - side.start for side in box]
            size = math.prod(shape)
            array[box] = values[done : done + size].reshape(*shape, *values.shape[1:])
            done += size
        self._missing[name] -= values.shape[0]

    def awaits(self, name: str) -> bool:
        """Return whether values of a variable are still missing."""
        return self._missing.get(name, 0) > 0

    def _require_written(self, what: str) -> None:
        """Raise a RunError if rows of a variable are missing."""
        names = [name for name, rows in self._missing.items() if rows]
        if names:
            raise RunError(
                f"{what}: {', '.join(names)}: rows are missing; this is a fault of "
                f"vibrosweep: please report it"
            )
