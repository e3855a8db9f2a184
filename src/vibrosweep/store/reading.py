"""Clear errors for result files that cannot be read."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5netcdf
import h5py

from vibrosweep.errors import DataError, VibrosweepError
from vibrosweep.store.disk import path_of, undisturbed
from vibrosweep.store.seal import State, state_of
from vibrosweep.store.trial import open_for_writing, require_readable, require_whole

__all__ = ["result_file"]


@contextmanager
def reading(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turn any failure to read a result file into one clear DataError.

    A file with a seal is first compared with its checksum.  A file without a seal is first read in
    a separate process, so that damage cannot crash or block this one.  Links to other files are
    never opened.
    """
    file_path = path_of("path", path)
    try:
        before = open_for_writing(file_path)
        seal = state_of(file_path)
        if seal is State.MISSING:
            require_readable(file_path)
        elif seal is State.INTACT:
            with undisturbed(), h5py.File(path, "r") as file:
                require_whole(file)
    except FileNotFoundError as error:
        raise no_result(path) from error
    except (ValueError, OSError) as error:
        if isinstance(error, BlockingIOError) or open_for_writing(file_path):
            raise _in_use(path) from error
        raise _unreadable(path, f" ({error})" if isinstance(error, ValueError) else "") from error
    if seal is State.BROKEN:
        if before or open_for_writing(file_path):
            raise _in_use(path)
        raise DataError(
            f"{path}: is damaged, or was changed by another program: its contents are not those "
            f"that it was sealed with; compute it again with the command that made it"
        )
    try:
        yield
    except VibrosweepError:
        raise
    except Exception as error:  # the libraries' exceptions have no common base
        raise _unreadable(path) from error


@contextmanager
def result_file(path: str | os.PathLike[str]) -> Iterator[Any]:
    """Open a result file; any failure to read it becomes one clear DataError."""
    # without phony_dims a foreign file makes h5netcdf warn
    with reading(path):
        with undisturbed():
            opened = h5netcdf.File(Path(path), "r", phony_dims="access")
        with opened as file:
            yield file


@contextmanager
def using(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turn any failure to use a file that another program saved into one clear DataError.

    Such a file may hold anything under any name.  If the file has a seal, the failure is a fault of
    this program and is raised unchanged.
    """
    try:
        yield
    except DataError as error:
        if str(path) in str(error):
            raise
        raise DataError(f"{path}: {error}") from error
    except (VibrosweepError, MemoryError):
        raise
    except Exception as error:  # a foreign file can cause any error
        if state_of(Path(path)) is not State.MISSING:
            raise
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise DataError(
            f"{path}: was saved by another program, and holds something other than vibrosweep "
            f"writes ({reason}); take the file that vibrosweep wrote, or compute it again"
        ) from error


def no_result(path: str | os.PathLike[str]) -> DataError:
    """Return the DataError for a result file that does not exist."""
    return DataError(f"{path}: there is no such result file; check the path")


def _in_use(path: str | os.PathLike[str]) -> DataError:
    return DataError(
        f"{path}: another program has it open for writing, or ended without closing it; close it "
        f"there, or, where that program has ended, remove its mark with h5clear -s {path}"
    )


def _unreadable(path: str | os.PathLike[str], reason: str = "") -> DataError:
    return DataError(
        f"{path}: is not a result of vibrosweep, or is damaged{reason}; check the path, or compute "
        f"it again with the command that made it"
    )
