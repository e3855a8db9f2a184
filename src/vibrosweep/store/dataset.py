"""Write a dataset piece by piece into a netCDF-4 file that appears only when it is complete.

The file is written under a temporary name in the directory of the output, closed, flushed to the
disk and renamed: whatever ends a run early, no file that looks finished is left behind.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import h5netcdf
import numpy as np
from numpy.typing import NDArray

from vibrosweep.errors import OutputError
from vibrosweep.variables import Variable

__all__ = ["Group", "check_output", "creating"]

# Doubles of a random sweep hold random digits: deflate saved 4 % of them and doubled the time to
# write.  Counts and flags shrink to a tenth at level 1, and hardly further at higher levels.
COMPRESSION: Final = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
CHUNK_VALUES: Final = 1 << 17


@dataclass
class Group:
    """A group of a file being written: its variables take pieces along their first dimension."""

    _group: Any
    _sizes: dict[str, int] = field(default_factory=dict)
    _auxiliary: list[str] = field(default_factory=list)

    def dimensions(self, sizes: Mapping[str, int]) -> None:
        """Declare dimensions by name and length."""
        self._group.dimensions.update(sizes)
        self._sizes.update(sizes)

    def coordinate(
        self,
        name: str,
        dims: tuple[str, ...],
        attributes: Mapping[str, Any],
        values: NDArray[np.float64] | None = None,
    ) -> None:
        """Declare an auxiliary coordinate of all variables declared after it.

        Parameters
        ----------
        values
            Written at once where given, else piece by piece with `write`.
        """
        variable = self._group.create_variable(name, dims, dtype="float64")
        variable.attrs.update(attributes)
        if values is not None:
            variable[...] = values
        self._auxiliary.append(name)

    def variable(self, variable: Variable) -> None:
        """Declare a variable of the registry."""
        shape = tuple(self._sizes[d] for d in variable.dims)
        options: dict[str, Any] = {}
        if np.issubdtype(np.dtype(variable.dtype), np.integer) and all(shape):
            options = dict(COMPRESSION, chunks=_chunks(shape))
        created = self._group.create_variable(
            variable.name, variable.dims, dtype=variable.dtype, **options
        )
        created.attrs.update(variable.attributes)
        if self._auxiliary:
            created.attrs["coordinates"] = " ".join(self._auxiliary)

    def write(self, name: str, start: int, values: NDArray[Any]) -> None:
        """Write a piece that begins at index `start` of the first dimension."""
        self._group.variables[name][start : start + values.shape[0]] = values

    def attributes(self, values: Mapping[str, Any]) -> None:
        """Set attributes of the group."""
        self._group.attrs.update(values)

    def group(self, name: str) -> Group:
        """Create a group inside this one."""
        return Group(self._group.create_group(name))


def _chunks(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Chunks of whole rows with about `CHUNK_VALUES` values."""
    rows = max(1, CHUNK_VALUES // int(np.prod(shape[1:])))
    return (min(rows, shape[0]), *shape[1:])


def check_output(path: Path, *, force: bool) -> None:
    """Refuse an output that cannot be written or that exists, before anything is computed.

    Raises
    ------
    OutputError
        Naming the path and what to do.
    """
    if path.is_dir():
        raise OutputError(f"{path}: is a directory; give the name of a file with -o")
    if path.exists() and not force:
        raise OutputError(
            f"{path}: exists and is kept; write to another file with -o, or replace it with --force"
        )
    parent = path.parent
    if not parent.is_dir():
        raise OutputError(f"{path}: the directory {parent} does not exist; create it first")
    try:
        with tempfile.TemporaryFile(dir=parent):
            pass
    except OSError as error:
        raise OutputError(
            f"{path}: cannot write in {parent} ({error.strerror}); choose another place with -o"
        ) from error


@contextmanager
def creating(path: Path) -> Iterator[Group]:
    """Create a file; it takes its name when the block ends well, and is removed otherwise.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".partial", dir=path.parent)
    os.close(handle)
    partial = Path(name)
    try:
        with h5netcdf.File(partial, "w") as file:
            yield Group(file)
        _flush(partial)
        # mkstemp is private to its owner; a result has the permissions of any new file
        mask = os.umask(0)
        os.umask(mask)
        partial.chmod(0o666 & ~mask)
        partial.replace(path)
        _flush(path.parent)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise OutputError(
            f"{path}: writing failed ({error.strerror or error}); free some space or choose "
            f"another place with -o, then run again"
        ) from error
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def _flush(path: Path) -> None:
    """Force a file or directory to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
