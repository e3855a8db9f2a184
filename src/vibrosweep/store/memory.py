"""Results in memory, written like a file and returned as a dataset."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vibrosweep.store.writer import Attributes, Writer

if TYPE_CHECKING:
    import xarray as xr


class InMemory(Writer):
    """A result in memory."""

    def __init__(self) -> None:
        super().__init__()
        self._attributes: dict[str, Any] = {}

    def _create(
        self, name: str, shape: tuple[int, ...], dtype: Any, attributes: Attributes, blank: float
    ) -> NDArray[Any]:
        return np.full(shape, blank, dtype)

    def attributes(self, values: Attributes) -> None:
        """Set attributes of the result."""
        self._attributes.update(values)

    def dataset(self) -> xr.Dataset:
        """Return the dataset; a RunError if rows of a variable are missing."""
        import xarray as xr

        self._require_written("the result")
        coordinates = {name: self._arrays[name] for name in self._coordinates}
        others = {name: array for name, array in self._arrays.items() if name not in coordinates}
        return xr.Dataset(others, coordinates, self._attributes)
