"""Write a small dataset in one piece: the file appears when it is complete, or not at all."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from vibrosweep.store.disk import replacing

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["save_dataset"]


def save_dataset(dataset: xr.Dataset, path: Path) -> None:
    """Write a dataset as netCDF-4; an existing file is replaced.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    with tempfile.TemporaryDirectory() as directory, replacing(path) as disk:
        whole = Path(directory) / "dataset.h5"
        dataset.to_netcdf(whole, engine="h5netcdf")
        disk.write(whole.read_bytes())
