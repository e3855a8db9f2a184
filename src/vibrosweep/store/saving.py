"""Write a small dataset in one piece, atomically."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from vibrosweep.store.disk import replacing
from vibrosweep.store.kinds import KIND, ResultKind
from vibrosweep.store.seal import append_seal

if TYPE_CHECKING:
    import xarray as xr


def save_result(
    dataset: xr.Dataset, path: str | os.PathLike[str], kind: ResultKind, *, force: bool = False
) -> Path:
    """Write a dataset as netCDF-4, with its kind and, as for results of sweeps, a seal.

    The file appears only when it is complete; the seal shows later damage.

    Parameters
    ----------
    dataset
        Result of an analysis.
    path
        Path of the new file.
    kind
        The kind, as registered by `register_kind`.
    force
        True to replace an existing file.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    OutputError
        The file cannot be written, or exists and `force` is not given.

    Examples
    --------
    >>> import tempfile, vibrosweep as vs, xarray as xr
    >>> echo = vs.register_kind(vs.ResultKind("echo", "the echo package"))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     vs.save_result(xr.Dataset({"gain": 0.5}), f"{folder}/echo.h5", echo).name
    'echo.h5'
    """
    output = Path(path)
    with tempfile.TemporaryDirectory() as directory, replacing(output, force=force) as disk:
        draft = Path(directory) / "dataset.h5"
        dataset.assign_attrs({KIND: kind.name}).to_netcdf(draft, engine="h5netcdf")
        disk.write(draft.read_bytes())
        append_seal(disk)
    return output
