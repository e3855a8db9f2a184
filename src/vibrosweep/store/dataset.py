"""Write a dataset piece by piece into a netCDF-4 file that appears only when it is complete."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import h5netcdf
import h5py
import numpy as np
from numpy.typing import NDArray

from vibrosweep.errors import RunError
from vibrosweep.model.measures import Variable
from vibrosweep.store.disk import Disk, replacing, undisturbed
from vibrosweep.store.seal import append_seal

__all__ = ["Group", "creating"]

# Measured on 10^6 realizations: counts and flags shrink to a tenth at level 1 in twice the time to
# write them, and no further at level 9.  Measured doubles hold random digits: deflate saves 14 % of
# them in 16 times the time, so they are stored as they are.
COMPRESSION: Final = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
# Small enough that a chunk stays in HDF5's cache until it is full, whatever the pieces written.
CHUNK_VALUES: Final = 1 << 13


@dataclass
class Group:
    """A group of a file being written: its variables take pieces along their first dimension."""

    _disk: Disk
    _group: Any
    _prefix: str = ""
    _sizes: dict[str, int] = field(default_factory=dict)
    _auxiliary: list[str] = field(default_factory=list)
    _missing: dict[str, int] = field(default_factory=dict)
    _groups: list[Group] = field(default_factory=list)

    @undisturbed()
    def dimensions(self, sizes: Mapping[str, int]) -> None:
        """Declare dimensions by name and length."""
        self._group.dimensions.update(zip(self._named(sizes), sizes.values(), strict=True))
        self._sizes.update(sizes)

    @undisturbed()
    def coordinate(
        self,
        name: str,
        dims: tuple[str, ...],
        attributes: Mapping[str, Any],
        values: NDArray[Any] | None = None,
    ) -> None:
        """Declare an auxiliary coordinate of all variables declared after it.

        Parameters
        ----------
        values
            Written at once where given, else piece by piece with `write`: numbers, or texts as
            objects.
        """
        texts = values is not None and values.dtype == object
        kind = h5py.string_dtype() if texts else "float64"
        variable = self._group.create_variable(name, self._named(dims), dtype=kind)
        variable.attrs.update(attributes)
        if values is not None:
            variable[...] = values
        else:
            self._missing[name] = self._sizes[dims[0]]
        self._auxiliary.append(name)

    @undisturbed()
    def variable(self, variable: Variable) -> None:
        """Declare a variable of the registry."""
        shape = tuple(self._sizes[d] for d in variable.dims)
        options: dict[str, Any] = {}
        if np.issubdtype(np.dtype(variable.dtype), np.integer) and all(shape):
            options = dict(COMPRESSION, chunks=_chunks(shape))
        created = self._group.create_variable(
            variable.name, self._named(variable.dims), dtype=variable.dtype, **options
        )
        created.attrs.update(variable.attributes)
        self._missing[variable.name] = shape[0]
        if self._auxiliary:
            created.attrs["coordinates"] = " ".join(self._auxiliary)

    @undisturbed()
    def write(self, name: str, start: int, values: NDArray[Any]) -> None:
        """Write a piece that begins at index `start` of the first dimension."""
        self._group.variables[name][start : start + values.shape[0]] = values
        self._missing[name] -= values.shape[0]
        self._disk.check()

    @undisturbed()
    def attributes(self, values: Mapping[str, Any]) -> None:
        """Set attributes of the group; what HDF5 cannot hold as it is goes in as near text."""
        for name, value in values.items():
            if isinstance(value, str):
                value = value.replace("\0", "\N{REPLACEMENT CHARACTER}")
            elif isinstance(value, int) and value >= 2**63:
                value = str(value)
            self._group.attrs[name] = value

    @undisturbed()
    def group(self, name: str) -> Group:
        """Create a group inside this one, whose dimensions in the file begin with its name.

        What xarray opens as a tree may not have dimensions of one name and different lengths.
        """
        self._groups.append(Group(self._disk, self._group.create_group(name), f"{name}_"))
        return self._groups[-1]

    def _named(self, dims: Iterable[str]) -> tuple[str, ...]:
        return tuple(f"{self._prefix}{name}" for name in dims)

    def require_complete(self) -> None:
        """Refuse a file in which HDF5 would fill values that nobody wrote with zeros.

        Raises
        ------
        RunError
            Variables were declared and not written to their end.
        """
        missing = [name for name, rows in self._missing.items() if rows]
        if missing:
            raise RunError(
                f"{self._disk.path}: {', '.join(missing)}: not written to the end; this is a fault "
                f"of vibrosweep: please report it"
            )
        for group in self._groups:
            group.require_complete()


def _chunks(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Chunks of whole rows with about `CHUNK_VALUES` values."""
    rows = max(1, CHUNK_VALUES // int(np.prod(shape[1:])))
    return (min(rows, shape[0]), *shape[1:])


@contextmanager
def creating(path: Path, room: Path | None = None, *, force: bool = True) -> Iterator[Group]:
    """Create a file; it takes its name when the block ends well, and is removed otherwise.

    Parameters
    ----------
    path
        The name it takes.
    room
        Directory of the unfinished file, on the same file system; by default that of `path`.
    force
        Whether it replaces a file that has the name by then.

    Raises
    ------
    OutputError
        The file cannot be written.
    RunError
        Not all that was declared was written.
    """
    with replacing(path, room, force=force) as disk:
        with undisturbed():
            file = h5netcdf.File(disk, "w")
        try:
            root = Group(disk, file)
            yield root
            root.require_complete()
            with undisturbed():
                file.close()
                disk.check()
                append_seal(disk)
        except BaseException as error:
            with undisturbed(), suppress(Exception):
                file.close()
            if isinstance(error, Exception):
                disk.check()  # what HDF5 says of a full disk is less clear
            raise
