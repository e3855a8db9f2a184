"""Results are written, piece by piece or in one, into netCDF-4 files that appear when complete.

A `Writer` declares arrays and appends their rows, in memory or, as a `Group`, in a file.  Every
declared array must be filled; a result with missing rows is refused.
"""

from __future__ import annotations

import math
import os
import platform
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeVar

import h5py
import numpy as np
from numpy.typing import NDArray

from vibrosweep._version import __version__
from vibrosweep.errors import DataError, ParameterError, RunError
from vibrosweep.mistakes import Word, cut
from vibrosweep.model.measures import Variable
from vibrosweep.store.arranged import REALIZATION, UNSTORABLE, along, boxes
from vibrosweep.store.disk import (
    Disk,
    append_seal,
    check_output,
    naming,
    path_of,
    replacing,
    undisturbed,
)
from vibrosweep.store.reading import KIND, KINDS, ResultKind

if TYPE_CHECKING:
    import h5netcdf
    import xarray as xr

__all__ = ["NO_VARIABLE", "provenance"]


CONVENTIONS: Final = "CF-1.11"
version: Callable[[str], str] = cache(metadata.version)  # uncached, it reads files at each call
LIBRARIES: Final = ("numpy", "numba", "llvmlite", "h5py", "h5netcdf")


def provenance(threads: int) -> dict[str, str | int]:
    """Return attributes that state the program, libraries, machine and time of a computation."""
    attributes: dict[str, str | int] = {
        "Conventions": CONVENTIONS,
        "source": f"vibrosweep {__version__}",
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "libraries": " ".join(f"{name} {version(name)}" for name in LIBRARIES),
        "python": platform.python_version(),
        "cpu": _processor(),
        "threads": threads,
    }
    revision = _revision()
    if revision:
        attributes["git_revision"] = revision
    return attributes


def _processor() -> str:
    """Return the model name of the processor as the system reports it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.machine()


def _revision() -> str:
    """Return the git revision of the source tree; empty for an installed package."""
    git = Path(__file__).parents[3] / ".git"
    try:
        head = (git / "HEAD").read_text(encoding="utf-8").strip()
        if not head.startswith("ref: "):
            return head
        reference = git / head.removeprefix("ref: ")
        return reference.read_text(encoding="utf-8").strip()
    except OSError:
        return ""


Attributes = Mapping[str, Any]


class Writer(ABC):
    """A result that is being written; rows are appended along its realizations."""

    def __init__(self) -> None:
        self._sizes: dict[str, int] = {}
        self._axes: tuple[str, ...] = (REALIZATION,)
        self._arrays: dict[str, tuple[tuple[str, ...], Any, Attributes]] = {}
        self._coordinates: list[str] = []
        self._missing: dict[str, int] = {}

    @abstractmethod
    def _create(
        self, name: str, shape: tuple[int, ...], dtype: Any, attributes: Attributes, blank: float
    ) -> Any:
        """Create an array; one in memory holds `blank` until it is written."""

    @abstractmethod
    def _fill(self, array: Any, start: int, values: NDArray[Any]) -> None:
        """Write a piece of an array that begins at realization `start`."""

    @abstractmethod
    def attributes(self, values: Attributes) -> None:
        """Set attributes of the result."""

    def dimensions(self, sizes: Mapping[str, int], axes: tuple[str, ...] = (REALIZATION,)) -> None:
        """Declare dimensions by name and length; realizations lie along `axes`."""
        self._axes = axes
        self._sizes.update(sizes)

    def coordinate(
        self,
        name: str,
        dims: tuple[str, ...],
        attributes: Attributes,
        values: NDArray[Any] | None = None,
    ) -> None:
        """Declare a coordinate of all variables declared after it.

        `values`, numbers or strings as objects, are written at once; without them, `write` adds
        them piece by piece.
        """
        texts = values is not None and values.dtype == object
        array = self._declare(name, dims, object if texts else "float64", attributes)
        if values is None:
            self._missing[name] = math.prod(array.shape)
        else:
            array[...] = values
        self._coordinates.append(name)

    def fixed(self, name: str, attributes: Attributes, value: float) -> None:
        """Write a value that all realizations share as a variable without dimensions.

        It is not a coordinate, because xarray prints every scalar coordinate above a plot.
        """
        self._declare(name, (), "float64", attributes)[...] = value

    def array(
        self, name: str, dims: tuple[str, ...], attributes: Attributes, values: NDArray[Any]
    ) -> None:
        """Write a whole array that does not lie along realizations."""
        self._declare(name, dims, values.dtype, attributes)[...] = values

    def variable(self, variable: Variable) -> None:
        """Declare a variable of the registry."""
        dims, attributes = along(variable.dims, self._axes), self._described(variable)
        self._declare(variable.name, dims, variable.dtype, attributes, variable.blank)
        self._missing[variable.name] = math.prod(self._sizes[axis] for axis in self._axes)

    def _described(self, variable: Variable) -> Attributes:
        return variable.attributes

    def _declare(
        self,
        name: str,
        dims: tuple[str, ...],
        dtype: Any,
        attributes: Attributes,
        blank: float = math.nan,
    ) -> Any:
        shape = tuple(self._sizes[dim] for dim in dims)
        array = self._create(name, shape, dtype, attributes, blank)
        self._arrays[name] = dims, array, attributes
        return array

    def write(self, name: str, start: int, values: NDArray[Any]) -> None:
        """Write a piece that begins at realization `start`."""
        self._fill(self._arrays[name][1], start, values)
        self._missing[name] -= values.shape[0]

    def awaits(self, name: str) -> bool:
        """Return whether values of a variable are still missing."""
        return self._missing.get(name, 0) > 0

    def _require_written(self, what: str) -> None:
        """Raise a RunError if rows of a variable are missing."""
        names = [name for name, rows in self._missing.items() if rows]
        if names:
            raise RunError(
                f"{what}: {', '.join(names)}: rows are missing; this is a fault of "
                f"vibrosweep: please report it"
            )


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
    def _fill(self, array: h5py.Dataset, start: int, values: NDArray[Any]) -> None:
        done, sizes = 0, [self._sizes[axis] for axis in self._axes]
        for box in boxes(sizes, start, start + values.shape[0]):
            shape = [side.stop - side.start for side in box]
            size = math.prod(shape)
            array[box] = values[done : done + size].reshape(*shape, *values.shape[1:])
            done += size
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
    import xarray as xr

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
    import h5netcdf
    from xarray.backends import H5NetCDFStore

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
