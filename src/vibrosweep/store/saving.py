"""Write a small dataset in one piece, atomically."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from vibrosweep.store.disk import replacing
from vibrosweep.store.kinds import KIND, Kind
from vibrosweep.store.seal import append_seal

if TYPE_CHECKING:
    import xarray as xr


def save_dataset(dataset: xr.Dataset, path: Path, kind: Kind, *, force: bool) -> None:
    """Write a dataset as netCDF-4, with its kind and a seal like the result of a sweep.

    Raises an OutputError where the file cannot be written, or exists and `force` is not given.
    """
    with tempfile.TemporaryDirectory() as directory, replacing(path, force=force) as disk:
        whole = Path(directory) / "dataset.h5"
        dataset.assign_attrs({KIND: kind.name}).to_netcdf(whole, engine="h5netcdf")
        disk.write(whole.read_bytes())
        append_seal(disk)
