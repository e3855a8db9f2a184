"""Say of a result file that cannot be read what that means."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from vibrosweep.errors import DataError

__all__ = ["no_result", "reading"]


@contextmanager
def reading(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turn whatever goes wrong while a result file is read into one clear error.

    Raises
    ------
    DataError
        There is no such file, or it is not a result that can be read.
    """
    try:
        yield
    except FileNotFoundError as error:
        raise no_result(path) from error
    except Exception as error:  # what a damaged file makes the libraries raise has no common base
        raise DataError(
            f"{path}: is not a result of vibrosweep, or is damaged; check the path, or compute it "
            f"again with vibrosweep run"
        ) from error


def no_result(path: str | os.PathLike[str]) -> DataError:
    """Return the error that says that there is no such result."""
    return DataError(f"{path}: there is no such result file; check the path")
