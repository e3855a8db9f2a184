"""Result files are opened here, with clear errors, and have a kind: command, lines and figure.

An attribute of the file names its kind.  `OWN` registers the kinds of this package, when a kind is
requested.  Another package names its kinds in entry points of the group `GROUP`, which are searched
when a file of an unregistered kind is read.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import h5netcdf
import h5py

from vibrosweep.errors import DataError, ParameterError, VibrosweepError
from vibrosweep.model.measures import IN_FILE, SAMPLES
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.store.disk import FileState, path_of, state_of, undisturbed
from vibrosweep.store.trial import open_for_writing, require_readable, require_whole

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

__all__ = [
    "KINDS",
    "SWEEP",
    "has_record",
    "load_dataset",
    "open_record",
    "open_sweep",
    "read_kind",
    "result_file",
]


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
        if seal is FileState.MISSING:
            require_readable(file_path)
        elif seal is FileState.INTACT:
            with undisturbed(), h5py.File(path, "r") as file:
                require_whole(file)
    except FileNotFoundError as error:
        raise no_result(path) from error
    except (ValueError, OSError) as error:
        if isinstance(error, BlockingIOError) or open_for_writing(file_path):
            raise _in_use(path) from error
        raise _unreadable(path, f" ({error})" if isinstance(error, ValueError) else "") from error
    if seal is FileState.BROKEN:
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
        if state_of(Path(path)) is not FileState.MISSING:
            raise
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise DataError(
            f"{path}: was saved by another program, and holds something that vibrosweep does "
            f"not write ({reason}); take the file that vibrosweep wrote, or compute it again"
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


KIND: Final = "result"  # attribute of a file that names its kind
GROUP: Final = "vibrosweep.results"
OWN: Final = "vibrosweep.api.result_kinds"  # module that registers the kinds of this package


class ResultKind(NamedTuple):
    """A kind of result, for ``vibrosweep info``, ``figures`` and ``verify``.

    Attributes
    ----------
    name
        Name of the kind, which its files hold as the attribute ``result``.
    command
        The command that makes such a result, as messages name it.
    lines
        Function from the dataset to the lines that ``vibrosweep info`` prints.
    draw
        Function from the dataset to the axes, or an array of axes, of the figure of
        ``vibrosweep figures``; None if it has no figure.
    stem
        Name of the figure's files without their ending; by default `name`.
    undrawn
        Reason why there is no figure, and what to do instead.
    unverified
        Reason why ``vibrosweep verify`` does not check such a result; empty if it does.
    verify
        Function from the path and the keywords ``sample``, ``seed`` and ``advance`` of
        `vibrosweep.verify` to its report; None for results of a sweep, and for results that are
        not checked.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> vs.ResultKind("echo", "the echo package").undrawn
    'results of this kind have no figure'
    """

    name: str
    command: str
    lines: Callable[[xr.Dataset], Iterable[str]] = lambda result: ()
    draw: Callable[[xr.Dataset], Axes | NDArray[Any]] | None = None
    stem: str = ""
    undrawn: str = "results of this kind have no figure"
    unverified: str = "verify proves only results of vibrosweep run and vibrosweep orbits"
    verify: Callable[..., Any] | None = None

    def axes(self, result: xr.Dataset) -> Axes | NDArray[Any]:
        """Draw a result; a DataError if results of this kind have no figure."""
        if self.draw is None:
            raise DataError(self.undrawn)
        return self.draw(result)


SWEEP: Final = ResultKind("sweep", "vibrosweep run", unverified="")
KINDS: Final[dict[str, ResultKind]] = {SWEEP.name: SWEEP}  # registered kinds by name


def register_kind(kind: ResultKind) -> ResultKind:
    """Make a kind of result known to ``info``, ``figures``, ``verify`` and `save_result`.

    The command line finds a kind of another package by an entry point of the group
    ``vibrosweep.results``, whose name is that of the kind, and whose value is the `ResultKind`.

    Parameters
    ----------
    kind
        The kind; registering it twice changes nothing.

    Returns
    -------
    ResultKind
        The kind that was given.

    Raises
    ------
    ParameterError
        Another kind has this name, or a field is of another type.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> echo = vs.register_kind(vs.ResultKind("echo", "the echo package"))
    """
    if not isinstance(kind, ResultKind):
        raise ParameterError(f"kind = {kind!r}: must be a vibrosweep.ResultKind")
    for field, value in kind._asdict().items():
        wanted = kind._field_defaults.get(field, "")
        if isinstance(wanted, str) and not isinstance(value, str):
            raise ParameterError(f"kind {kind.name!r}: {field} = {value!r} must be a text")
        if not isinstance(wanted, str) and value is not None and not callable(value):
            raise ParameterError(f"kind {kind.name!r}: {field} = {value!r} must be a function")
    import_module(OWN)
    if KINDS.setdefault(kind.name, kind) != kind:
        raise ParameterError(
            f"kind {kind.name!r}: {KINDS[kind.name].command} has registered another kind of this "
            f"name; choose another name"
        )
    return kind


def kind_of(path: str | os.PathLike[str], attributes: Mapping[str, Any]) -> ResultKind:
    """Return the kind of a file from its attributes; by default the result of a sweep.

    Raises a DataError if no installed package knows the kind.
    """
    name = str(attributes.get(KIND, SWEEP.name))
    import_module(OWN)
    if name not in KINDS:
        from importlib.metadata import entry_points  # takes 30 ms

        for entry_point in entry_points(group=GROUP, name=name):
            register_kind(entry_point.load())
    if name not in KINDS:
        raise DataError(
            f"{path}: is a result of the kind {name!r}, which this version of vibrosweep does not "
            f"know; use the version that wrote it, or install the package that did"
        )
    return KINDS[name]


def read_kind(path: Path) -> ResultKind:
    """Return the kind of a result file; a DataError if it is none, or cannot be read."""
    with result_file(path) as file:
        return kind_of(path, file.attrs)


def load_dataset(path: Path) -> xr.Dataset:
    """Read a result other than a sweep into memory; raises a DataError as `read_kind` does."""
    import xarray as xr

    with reading(path), undisturbed(), warnings.catch_warnings():
        # h5netcdf warns of unexpected attributes, which another program may have written
        warnings.simplefilter("ignore", xr.SerializationWarning)
        return xr.load_dataset(path, engine="h5netcdf")


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
    from vibrosweep.store.fresh import opened  # imports xarray

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
    import xarray as xr

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
