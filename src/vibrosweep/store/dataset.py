"""Write a dataset piece by piece into a netCDF-4 file that appears only when it is complete."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import h5py
import numpy as np
from numpy.typing import NDArray

from vibrosweep.model.measures import Variable
from vibrosweep.store.disk import Disk, replacing, undisturbed
from vibrosweep.store.rows import REALIZATION, UNSTORABLE, along, boxes, require_written
from vibrosweep.store.seal import append_seal

# Measured on 10^6 realizations: level 1 compresses counts and flags to a tenth and doubles the time
# to write them; level 9 gains nothing more.  The digits of measured doubles are random: deflate
# saves 14 % and takes 16 times as long, so doubles are stored uncompressed.
COMPRESSION: Final = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
# Small enough that a chunk stays in HDF5's cache until it is full, whatever the size of the writes.
CHUNK_VALUES: Final = 1 << 13


# Name, in netCDF-4, of an axis without a variable; it ends with the length of the axis.
NO_VARIABLE: Final = "This is a netCDF dimension but not a netCDF variable.%10d"


@dataclass
class Group:
    """A group of a file being written; data are appended along its rows, the realizations.

    A netCDF-4 file is an HDF5 file whose axes have dimension scales.  h5py writes it in half the
    time of h5netcdf, which looks up every object whenever it is used.
    """

    _disk: Disk
    _group: h5py.Group
    _prefix: str = ""
    _outer: Iterable[str] = ()
    _sizes: dict[str, int] = field(default_factory=dict)
    _axes: tuple[str, ...] = (REALIZATION,)
    _variables: dict[str, tuple[h5py.Dataset, tuple[str, ...]]] = field(default_factory=dict)
    _auxiliary: list[str] = field(default_factory=list)
    _missing: dict[str, int] = field(default_factory=dict)
    _groups: list[Group] = field(default_factory=list)

    def dimensions(self, sizes: Mapping[str, int], axes: tuple[str, ...] = (REALIZATION,)) -> None:
        """Declare dimensions by name and length; realizations lie along `axes`."""
        self._axes = axes
        self._sizes.update(sizes)

    def has_outer(self, name: str) -> bool:
        """Tell whether the file that holds this group has a dimension of that name."""
        return name in self._outer

    @undisturbed()
    def coordinate(
        self,
        name: str,
        dims: tuple[str, ...],
        attributes: Mapping[str, Any],
        values: NDArray[Any] | None = None,
    ) -> None:
        """Declare a coordinate of all variables declared after it.

        Given values, numbers or strings as objects, are written at once; without them, `write`
        adds them piece by piece.
        """
        texts = values is not None and values.dtype == object
        dataset = self._create(name, dims, h5py.string_dtype() if texts else "float64", attributes)
        if values is not None:
            dataset[...] = values
        else:
            self._missing[name] = math.prod(dataset.shape)
        if dims != (name,):  # that of its own dimension belongs to all variables anyway
            self._auxiliary.append(name)

    @undisturbed()
    def fixed(self, name: str, attributes: Mapping[str, Any], value: float) -> None:
        """Write a value that all realizations share as a variable without dimensions.

        It is no coordinate: xarray writes all coordinates of one value above a plot.
        """
        self._create(name, (), "float64", attributes)[...] = value

    @undisturbed()
    def variable(self, variable: Variable) -> None:
        """Declare a variable of the registry."""
        dims = along(variable.dims, self._axes)
        shape = tuple(self._sizes[d] for d in dims)
        options: dict[str, Any] = {}
        if np.issubdtype(np.dtype(variable.dtype), np.integer) and all(shape):
            options = dict(COMPRESSION, chunks=_chunks(shape))
        attributes = dict(variable.attributes)
        if self._auxiliary:
            attributes["coordinates"] = " ".join(self._auxiliary)
        self._create(variable.name, dims, variable.dtype, attributes, options)
        self._missing[variable.name] = math.prod(shape[: len(self._axes)])

    def _create(
        self,
        name: str,
        dims: tuple[str, ...],
        kind: Any,
        attributes: Mapping[str, Any],
        options: Mapping[str, Any] = MappingProxyType({}),
    ) -> h5py.Dataset:
        shape = tuple(self._sizes[d] for d in dims)
        most = tuple(size or None for size in shape)  # netCDF has no fixed length of 0
        dataset = self._group.create_dataset(
            name, shape, kind, maxshape=None if all(shape) else most, track_order=True, **options
        )
        for key, value in attributes.items():
            dataset.attrs[key] = _storable(value)
        self._variables[name] = (dataset, dims)
        return dataset

    @undisturbed()
    def write(self, name: str, start: int, values: NDArray[Any]) -> None:
        """Write a piece that begins at realization `start`."""
        (variable, _), done = self._variables[name], 0
        sizes = [self._sizes[d] for d in self._axes]
        for box in boxes(sizes, start, start + values.shape[0]):
            shape = [side.stop - side.start for side in box]
            size = math.prod(shape)
            piece = values[done : done + size]
            variable[box] = piece.reshape(*shape, *values.shape[1:])
            done += size
        self._missing[name] -= values.shape[0]
        self._disk.check()

    def awaits(self, name: str) -> bool:
        """Tell whether values of a variable are still to be written."""
        return self._missing.get(name, 0) > 0

    @undisturbed()
    def attributes(self, values: Mapping[str, Any]) -> None:
        """Set attributes of the group; a character that no file can hold is marked."""
        for name, value in values.items():
            self._group.attrs[name] = _storable(value)

    @undisturbed()
    def group(self, name: str) -> Group:
        """Create a subgroup; in the file, the names of its dimensions begin with its name.

        xarray cannot open a file as a tree if dimensions of one name differ in length between
        groups.
        """
        inner = self._group.create_group(name, track_order=True)
        self._groups.append(Group(self._disk, inner, f"{name}_", self._sizes))
        return self._groups[-1]

    @undisturbed()
    def complete(self) -> None:
        """Name the axes of all variables.

        Raises a RunError if values were never written: HDF5 would fill them with zeros.
        """
        require_written(str(self._disk.path), self._missing)
        for name, size in self._sizes.items():
            scale, _ = self._variables.get(name, (None, ()))
            if scale is None:
                scale = self._group.create_dataset(
                    f"{self._prefix}{name}", (size,), ">f4", maxshape=(size or None,)
                )
            scale.make_scale(name if name in self._variables else NO_VARIABLE % size)
            for dataset, dims in self._variables.values():
                if name in dims and dataset is not scale:
                    dataset.dims[dims.index(name)].attach_scale(scale)
        for group in self._groups:
            group.complete()


def _storable(value: Any) -> Any:
    """Replace zero bytes, which end a text in HDF5, and characters that UTF-8 lacks."""
    if not isinstance(value, str):
        return value
    return UNSTORABLE.sub("\N{REPLACEMENT CHARACTER}", value)


def _chunks(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Chunks of about `CHUNK_VALUES` values that follow each other in memory."""
    sides: list[int] = []
    for size in reversed(shape):
        sides.insert(0, min(size, max(1, CHUNK_VALUES // math.prod(sides))))
    return tuple(sides)


@contextmanager
def creating(path: Path, directory: Path | None = None, *, force: bool = True) -> Iterator[Group]:
    """Create a file as `vibrosweep.store.disk.replacing` does.

    Raises a RunError where a declared variable was not written completely.
    """
    with replacing(path, directory, force=force) as disk:
        with undisturbed():
            file = h5py.File(disk, "w", track_order=True)
        try:
            root = Group(disk, file)
            yield root
            root.complete()
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
