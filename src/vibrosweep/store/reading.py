"""Clear errors for result files that cannot be read."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from vibrosweep.errors import DataError, VibrosweepError
from vibrosweep.store.seal import State, state_of
from vibrosweep.store.trial import require_readable


@contextmanager
def reading(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turn any failure to read a result file into one clear DataError.

    A sealed file is first compared with its checksum; a file without a seal is first read in a
    separate process, so that a damaged file cannot crash or block this one.
    """
    try:
        seal = state_of(Path(path))
        if seal is State.MISSING:
            require_readable(Path(path))
    except FileNotFoundError as error:
        raise no_result(path) from error
    except (OSError, ValueError) as error:
        raise _unreadable(path) from error
    if seal is State.BROKEN:
        raise DataError(
            f"{path}: is damaged, or was changed by another program: its contents are not those "
            f"that it was sealed with; compute it again with vibrosweep run"
        )
    try:
        yield
    except VibrosweepError:
        raise
    except Exception as error:  # the libraries' exceptions have no common base
        raise _unreadable(path) from error


def no_result(path: str | os.PathLike[str]) -> DataError:
    """Return the error for a result file that does not exist."""
    return DataError(f"{path}: there is no such result file; check the path")


def _unreadable(path: str | os.PathLike[str]) -> DataError:
    return DataError(
        f"{path}: is not a result of vibrosweep, or is damaged; check the path, or compute it "
        f"again with vibrosweep run"
    )
