"""Write a small dataset in one piece, atomically."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

import h5netcdf
import xarray as xr
from xarray.backends import H5NetCDFStore

from vibrosweep.errors import DataError, ParameterError
from vibrosweep.mistakes import Word, cut
from vibrosweep.store.dataset import sealed
from vibrosweep.store.disk import check_output, naming, path_of, replacing, undisturbed
from vibrosweep.store.kinds import KIND, KINDS, ResultKind

PATH: Final = Word("path=", "path=")


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
    ParameterError
        An argument is of another type, or the kind is not registered.
    DataError
        The dataset holds something that netCDF cannot hold.

    Examples
    --------
    >>> import tempfile, vibrosweep as vs, xarray as xr
    >>> echo = vs.register_kind(vs.ResultKind("echo", "the echo package"))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     vs.save_result(xr.Dataset({"gain": 0.5}), f"{folder}/echo.h5", echo).name
    'echo.h5'
    """
    if not isinstance(dataset, xr.Dataset):
        raise ParameterError(f"dataset = {type(dataset).__name__}: must be an xarray.Dataset")
    if not isinstance(kind, ResultKind) or KINDS.get(kind.name) != kind:
        raise ParameterError(
            f"kind = {cut(repr(kind))}: must be a ResultKind that register_kind has registered"
        )
    output = path_of("path", path)
    with naming(PATH):
        check_output(output, force=force)
        write_dataset(dataset, output, kind, force=force)
    return output


def write_dataset(
    dataset: xr.Dataset, output: Path, kind: ResultKind, *, force: bool = False
) -> None:
    """Write a dataset that took long to compute, for whose output there was no file before.

    If one has appeared meanwhile and `force` is not given, the new file gets another name, which
    the OutputError tells.
    """
    whole = dataset.assign_attrs({KIND: kind.name}).compute()
    with (
        replacing(output, force=force) as disk,
        sealed(disk, lambda disk: h5netcdf.File(disk, "w")) as file,
        undisturbed(),
    ):
        try:
            whole.dump_to_store(H5NetCDFStore(file))
        except Exception as error:  # xarray and its libraries raise exceptions of any kind
            disk.check()
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            raise DataError(f"{output}: netCDF cannot hold this dataset ({reason})") from error
