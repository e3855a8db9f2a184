"""Open the file that this process has just written without reading its structure again.

h5netcdf looks up every object of a file several times, which takes a quarter of the processor time
of a small run.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr
from xarray.backends import BackendArray, BackendEntrypoint, CachingFileManager
from xarray.backends.locks import HDF5_LOCK
from xarray.core import indexing

from vibrosweep.store.writing import just_written


def opened(path: Path) -> xr.Dataset | None:
    """Open the file that this process wrote last, as ``xarray.open_dataset`` does.

    Returns None for any other file, and for one that has changed or holds texts.
    """
    found = just_written(path)
    if found is None or any(dtype.hasobject for _, _, dtype, _ in found.arrays.values()):
        return None  # h5netcdf has special types for texts, such as labels of a table
    return xr.open_dataset(path.absolute(), engine=_JustWritten)


class _JustWritten(BackendEntrypoint):
    """Opens the file that this process wrote last."""

    open_dataset_parameters = ("filename_or_obj", "drop_variables")

    def open_dataset(self, filename_or_obj: Any, *, drop_variables: Any = None) -> xr.Dataset:
        path = os.fspath(filename_or_obj)
        found = just_written(Path(path))
        assert found is not None
        files = CachingFileManager(h5py.File, path, mode="r", lock=HDF5_LOCK)
        files.acquire()
        arrays = {}
        for name, (dims, shape, dtype, attributes) in found.arrays.items():
            stored = indexing.LazilyIndexedArray(_Stored(files, name, shape, dtype))
            arrays[name] = xr.Variable(dims, stored, attributes)
        coordinates = {name: arrays.pop(name) for name in found.coordinates}
        dataset = xr.Dataset(arrays, coordinates, found.attributes)
        dataset.set_close(files.close)
        return dataset


class _Stored(BackendArray):
    """An array of a file."""

    def __init__(
        self,
        files: CachingFileManager[h5py.File],
        name: str,
        shape: tuple[int, ...],
        dtype: np.dtype[Any],
    ) -> None:
        self._files, self._name = files, name
        self.shape, self.dtype = shape, dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        support = indexing.IndexingSupport.OUTER_1VECTOR
        return indexing.explicit_indexing_adapter(key, self.shape, support, self._read)

    def _read(self, key: tuple[Any, ...]) -> Any:
        with HDF5_LOCK:
            return self._files.acquire(needs_lock=False)[self._name][key]
