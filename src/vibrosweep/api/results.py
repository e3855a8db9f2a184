"""Open result files."""

from __future__ import annotations

import os
import warnings

import xarray as xr

from vibrosweep.errors import DataError
from vibrosweep.model.measures import IN_FILE, SAMPLES
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.store.disk import path_of, undisturbed
from vibrosweep.store.fresh import opened
from vibrosweep.store.reading import SWEEP, kind_of, reading, result_file

__all__ = ["has_record", "open_record", "open_sweep"]


def open_sweep(path: str | os.PathLike[str]) -> xr.Dataset:
    """Open the result of a sweep, lazily; the same as ``xarray.open_dataset(path)``.

    Parameters
    ----------
    path
        File that `vibrosweep.run` or ``vibrosweep run`` wrote.

    Returns
    -------
    xarray.Dataset
        As `vibrosweep.sweep` returns it; values are read when they are needed.

    Raises
    ------
    DataError
        There is no such file, or it is not a result.

    Examples
    --------
    >>> import tempfile, vibrosweep as vs
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     vs.run({"restitution": [0.8, 0.9]}, f"{folder}/out.h5").close()
    ...     with vs.open_sweep(f"{folder}/out.h5") as found:
    ...         print(found.restitution.values)
    [0.8 0.9]
    """
    found = opened(path_of("path", path))
    return _open(path, None) if found is None else found


def open_record(path: str | os.PathLike[str]) -> xr.Dataset:
    """Open the record of every landing that a sweep file requests in ``[record]``.

    Parameters
    ----------
    path
        File that `vibrosweep.run` or ``vibrosweep run`` wrote.

    Returns
    -------
    xarray.Dataset
        As `vibrosweep.simulate` returns it, ragged if the sweep file has ``ragged = true`` in its
        ``[record]``; values are read when they are needed.

    Raises
    ------
    DataError
        There is no such file, or it holds no record.

    Examples
    --------
    >>> import tempfile, vibrosweep as vs
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     vs.run({"record": {"particles": 2}}, f"{folder}/out.h5").close()
    ...     with vs.open_record(f"{folder}/out.h5") as found:
    ...         print(found.landing_time.dims)
    ('realization', 'particle', 'impact')
    """
    if not has_record(path):
        raise DataError(
            f"{path}: holds no record of landings; add a [record] section to the sweep file and "
            f"run it again"
        )
    found = _open(path, IN_FILE)
    count = found["impact_count"].attrs
    if SAMPLES in count:
        count[SAMPLES] = count[SAMPLES].removeprefix(f"{IN_FILE}_")
    return found


def has_record(path: str | os.PathLike[str]) -> bool:
    """Return whether a result holds a record of landings.

    Raises
    ------
    DataError
        There is no such file, or it is not a result.
    """
    with result_file(path) as file:
        return IN_FILE in file.groups


def _open(path: str | os.PathLike[str], group: str | None) -> xr.Dataset:
    with reading(path), undisturbed(), warnings.catch_warnings():
        # h5netcdf warns of unexpected attributes, which another program may have written
        warnings.simplefilter("ignore", xr.SerializationWarning)
        # without phony_dims a foreign file makes h5netcdf warn
        dataset = xr.open_dataset(path, engine="h5netcdf", group=group, phony_dims="access")
        kind = kind_of(path, dataset.attrs) if group is None else SWEEP
    needed = {*PARAMETERS, "landing_time" if group else "impact_count"}
    if not needed <= dataset.variables.keys():
        dataset.close()
        if kind is not SWEEP:
            raise DataError(
                f"{path}: is a result of {kind.command}; open it with xarray.open_dataset"
            )
        raise DataError(f"{path}: is not a result of vibrosweep run; check the path")
    return dataset.rename({d: str(d).removeprefix(f"{group}_") for d in dataset.dims})
