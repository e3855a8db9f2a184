"""Sweeps computed in memory, with the same numbers as in a file."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.runs.chunks import bytes_per_realization, compute_rows, no_rows
from vibrosweep.runs.progress import Advance, silent
from vibrosweep.runs.result import declare, write_rows
from vibrosweep.scene.realizations import open_design
from vibrosweep.scene.sweep import Sweep
from vibrosweep.store.parts import Columns, kinds
from vibrosweep.store.writer import Attributes, Writer
from vibrosweep.system import physical_memory

if TYPE_CHECKING:
    import xarray as xr


class InMemory(Writer):
    """A result in memory, written like a file and returned as a dataset."""

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


def sweep_in_memory(spec: Sweep, *, threads: int, advance: Advance = silent) -> xr.Dataset:
    """Compute a sweep without its record; the result does not depend on the number of threads.

    `advance` is called with the number of finished realizations and the total.  Raises a
    ParameterError if the result does not fit into memory, and a TableError or SpecError if the
    design cannot be opened.
    """
    design = open_design(spec)
    total = design.realizations
    needed, available = bytes_per_realization(spec, design) * total, physical_memory()
    if needed > available / 2:
        raise ParameterError(
            f"the results of {total} realizations take {needed / 2**30:.3g} GiB of this machine's "
            f"{available / 2**30:.3g} GiB: write them to a file with vibrosweep.run"
        )
    found = InMemory()
    declare(found, spec, design, threads)
    with Workers(threads) as workers:

        def pieces() -> Iterator[Columns]:
            done = 0
            advance(done, total)
            for columns in compute_rows(spec, design, 0, total, workers):
                yield columns
                done += len(columns["status"])
                advance(done, total)

        write_rows(found, kinds(no_rows(spec, design)), pieces())
    return found.dataset()
