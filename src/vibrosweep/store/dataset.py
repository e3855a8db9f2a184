"""Write a dataset piece by piece into a netCDF-4 file that appears only when it is complete."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeVar

import h5py
import numpy as np
from numpy.typing import NDArray

from vibrosweep.model.measures import Variable
from vibrosweep.store.disk import Disk, replacing, undisturbed
from vibrosweep.store.rows import UNSTORABLE
from vibrosweep.store.seal import append_seal
from vibrosweep.store.writer import Attributes, Writer

if TYPE_CHECKING:
    import h5netcdf  # slow to import, and only other results than those of sweeps need it

__all__ = ["NO_VARIABLE"]

# Measured on 10^6 realizations: level 1 compresses counts and flags to a tenth and doubles the time
# to write them; level 9 gains nothing more.  The digits of measured doubles are random: deflate
# saves 14 % and takes 16 times as long, so doubles are stored uncompressed.
COMPRESSION: Final = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
# A chunk of HDF5 of this size stays in the cache until it is full, whatever the size of the writes
CHUNK_VALUES: Final = 1 << 13

POINTERS: Final = "coordinates"  # attribute of a variable that lists its coordinates
# Name that netCDF-4 gives to an axis without a variable; it ends with the length of the axis
NO_VARIABLE: Final = "This is a netCDF dimension but not a netCDF variable.%10d"


Handle = TypeVar("Handle", "h5py.File", "h5netcdf.File")


class Contents(NamedTuple):
    """Contents of a file that this process has written, without the values."""

    # dims, shape, type and attributes of each array
    arrays: Mapping[str, tuple[tuple[str, ...], tuple[int, ...], np.dtype[Any], Attributes]]
    coordinates: tuple[str, ...]
    attributes: Attributes


# The last file written, by its device, inode, size and time of change, with its contents
_last: tuple[tuple[int, ...], Contents] | None = None


def just_written(path: Path) -> Contents | None:
    """Return the contents of the file that this process wrote last, unless it has changed."""
    with suppress(OSError):
        if _last is not None and _last[0] == _identified(path.stat()):
            return _last[1]
    return None


def _identified(found: os.stat_result) -> tuple[int, ...]:
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


class Group(Writer):
    """A group of a file that is being written.

    A netCDF-4 file is an HDF5 file whose axes have dimension scales.  h5py writes it in half the
    time of h5netcdf, which looks up every object at each use.
    """

    def __init__(self, disk: Disk, group: h5py.Group, parent: Group | None = None) -> None:
        super().__init__()
        self._disk, self._group, self._parent = disk, group, parent
        self._groups: list[Group] = []
        self._attributes: dict[str, Any] = {}

    coordinate = undisturbed()(Writer.coordinate)
    fixed = undisturbed()(Writer.fixed)
    array = undisturbed()(Writer.array)
    variable = undisturbed()(Writer.variable)

    def has_outer(self, name: str) -> bool:
        """Return whether the file that holds this group has a dimension of that name."""
        return self._parent is not None and name in self._parent._sizes

    def _described(self, variable: Variable) -> Attributes:
        # a coordinate with the name of its dimension belongs to all variables anyway
        listed = [name for name in self._coordinates if self._arrays[name][0] != (name,)]
        pointers = {POINTERS: " ".join(listed)} if listed else {}
        return {**variable.attributes, **pointers}

    def _create(
        self, name: str, shape: tuple[int, ...], dtype: Any, attributes: Attributes, blank: float
    ) -> h5py.Dataset:
        kind = h5py.string_dtype() if dtype is object else np.dtype(dtype)
        options: dict[str, Any] = {}
        if np.issubdtype(kind, np.integer) and all(shape):
            options = dict(COMPRESSION, chunks=_chunks(shape))
        most = tuple(size or None for size in shape)  # netCDF has no fixed length of 0
        dataset = self._group.create_dataset(
            name, shape, kind, maxshape=None if all(shape) else most, track_order=True, **options
        )
        for key, value in attributes.items():
            dataset.attrs[key] = _storable(value)
        return dataset

    @undisturbed()
    def write(self, name: str, start: int, values: NDArray[Any]) -> None:
        """Write a piece that begins at realization `start`."""
        super().write(name, start, values)
        self._disk.check()

    @undisturbed()
    def attributes(self, values: Attributes) -> None:
        """Set attributes of the group; a character that no file can hold is replaced."""
        for name, value in values.items():
            self._group.attrs[name] = self._attributes[name] = _storable(value)

    @undisturbed()
    def group(self, name: str) -> Group:
        """Create a subgroup; in the file, names of its dimensions are prefixed with its name.

        xarray cannot open a tree of groups in which two dimensions of one name differ in length.
        """
        inner = self._group.create_group(name, track_order=True)
        self._groups.append(Group(self._disk, inner, self))
        return self._groups[-1]

    def contents(self) -> Contents:
        """Return the arrays, coordinates and attributes as they were declared."""
        arrays = {
            name: (
                dims,
                array.shape,
                array.dtype,
                {k: _storable(v) for k, v in attributes.items() if k != POINTERS},
            )
            for name, (dims, array, attributes) in self._arrays.items()
        }
        return Contents(arrays, (*self._coordinates,), self._attributes)

    @undisturbed()
    def complete(self, prefix: str = "") -> None:
        """Attach dimension scales to the axes of all variables.

        Raises a RunError if values are missing: HDF5 would fill them with zeros.
        """
        self._require_written(str(self._disk.path))
        for name, size in self._sizes.items():
            _, scale, _ = self._arrays.get(name, (None, None, None))
            if scale is None:
                scale = self._group.create_dataset(
                    f"{prefix}{name}", (size,), ">f4", maxshape=(size or None,)
                )
            scale.make_scale(name if name in self._arrays else NO_VARIABLE % size)
            for dims, dataset, _ in self._arrays.values():
                if name in dims and dataset is not scale:
                    dataset.dims[dims.index(name)].attach_scale(scale)
        for group in self._groups:
            group.complete(f"{group._group.name.rpartition('/')[2]}_")


def _storable(value: Any) -> Any:
    """Replace zero bytes, which end a text in HDF5, and characters that UTF-8 lacks."""
    if not isinstance(value, str):
        return value
    return UNSTORABLE.sub("\N{REPLACEMENT CHARACTER}", value)


def _chunks(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return the shape of chunks of about `CHUNK_VALUES` values, contiguous in memory."""
    sides: list[int] = []
    for size in reversed(shape):
        sides.insert(0, min(size, max(1, CHUNK_VALUES // math.prod(sides))))
    return tuple(sides)


@contextmanager
def sealed(disk: Disk, opened: Callable[[Disk], Handle]) -> Iterator[Handle]:
    """Open a new HDF5 file on a disk; close it after the block, and append its seal."""
    with undisturbed():
        file = opened(disk)
    try:
        yield file
        with undisturbed():
            file.close()
            disk.check()
            append_seal(disk)
    except BaseException as error:
        with undisturbed(), suppress(Exception):
            file.close()
        if isinstance(error, Exception):
            disk.check()  # clearer than HDF5's own message about a full disk
        raise


@contextmanager
def creating(path: Path, directory: Path | None = None, *, force: bool = True) -> Iterator[Group]:
    """Create a netCDF-4 file, with a seal, as `vibrosweep.store.disk.replacing` does.

    Raises a RunError if rows of a declared variable are missing.
    """
    global _last
    with replacing(path, directory, force=force) as disk:
        with sealed(disk, lambda disk: h5py.File(disk, "w", track_order=True)) as file:
            root = Group(disk, file)
            yield root
            root.complete()
            contents = root.contents()
        written = _identified(os.fstat(disk.fileno())), contents
    _last = written
