"""Files that appear when they are complete, and that end with a checksum of their contents.

A file is written under a temporary name in the directory of the output, flushed to the disk and
renamed.  However a run ends, no incomplete file has the name of the output.

The seal of a result is compared before HDF5, which ignores bytes after its own end of file, reads
it: from a damaged file HDF5 may return wrong numbers, crash the process or never return.
"""

from __future__ import annotations

import errno
import glob
import hashlib
import io
import itertools
import os
import re
import secrets
import signal
import stat
import tempfile
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from enum import Enum, auto
from functools import lru_cache
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, BinaryIO, Final

from vibrosweep.errors import ExistingOutputError, OutputError, ParameterError, TakenOutputError
from vibrosweep.mistakes import OUTPUT, Word
from vibrosweep.store.trial import version_of
from vibrosweep.system import ENDINGS, locked

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

__all__ = ["check_output", "make_directory", "path_of", "replacing"]


def path_of(name: str, value: object) -> Path:
    """Return the path that an argument gives; a ParameterError unless it is text or a path."""
    text = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(text, str) or not text or "\0" in text:
        raise ParameterError(f"{name} = {value!r}: must be the path of a file")
    return Path(text)


def target_of(path: Path) -> Path:
    """Return the file behind symbolic links, which are kept; a loop of links is left as it is."""
    return Path(os.path.realpath(path))  # Path.resolve raises a RuntimeError for a loop of links


def check_output(path: Path, *, force: bool, inputs: Iterable[Path | None] = ()) -> None:
    """Raise an OutputError for an output that cannot be written, or that exists.

    An existing file is accepted with `force`, unless it is one of `inputs`.
    """
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        mode = None
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written ({error.strerror}); choose another name with ", OUTPUT
        ) from error
    if mode is not None and not stat.S_ISREG(mode):
        kind = "a directory" if stat.S_ISDIR(mode) else "not a regular file"
        raise OutputError(f"{path}: is {kind}; give the name of a file with ", OUTPUT)
    if mode is not None and not force:
        raise ExistingOutputError(path)
    if any(file is not None and file.exists() and file.samefile(path) for file in inputs if mode):
        raise OutputError(f"{path}: is an input of this run; write to another file with ", OUTPUT)
    parent = target_of(path).parent
    if not parent.is_dir():
        raise OutputError(
            f"{path}: {parent} is not a directory; create it, or choose another place with ", OUTPUT
        )
    try:
        with tempfile.TemporaryFile(dir=parent):
            pass
    except OSError as error:
        raise OutputError(
            f"{path}: cannot write in {parent} ({error.strerror}); choose another place with ",
            OUTPUT,
        ) from error


class Disk(io.FileIO):
    """A new file that HDF5 can close even if the disk fails.

    HDF5 crashes the process when it closes a file that it cannot write.  Here the first error is
    stored and all later writes are dropped; `check` raises the error.
    """

    def __init__(self, partial: Path, path: Path) -> None:
        self.path = path
        self.failure: OSError | None = None
        super().__init__(partial, "x+")

    def write(self, data: ReadableBuffer, /) -> int:
        """Write all of the data; do nothing after an error."""
        view = memoryview(data)
        done = 0
        try:
            while done < view.nbytes and self.failure is None:
                done += super().write(view[done:]) or 0
        except OSError as error:
            self.failure = error
        return view.nbytes

    def truncate(self, size: int | None = None, /) -> int:
        """Set the length of the file."""
        try:
            return super().truncate(size)
        except OSError as error:
            self.failure = self.failure or error
            return size or 0

    def check(self) -> None:
        """Raise an OutputError if a write has failed."""
        if self.failure is not None:
            raise unwritten(self.path, self.failure)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Delay signals during calls of HDF5, which loses exceptions that are raised inside it."""
    late: list[tuple[int, FrameType | None]] = []

    def hold(number: int, frame: FrameType | None) -> None:
        late.append((number, frame))

    handlers = {}
    if threading.current_thread() is threading.main_thread():
        for number in ENDINGS:
            handler = signal.getsignal(number)
            if callable(handler):
                handlers[int(number)] = handler
                signal.signal(number, hold)
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number, frame in late:
            handlers[number](number, frame)


@contextmanager
def replacing(path: Path, directory: Path | None = None, *, force: bool = True) -> Iterator[Disk]:
    """Write a file that is renamed to `path` if the block succeeds, and removed otherwise.

    The temporary file is in `directory`, on the same file system; by default in that of `path`.
    Raises an OutputError if the file cannot be written.  Without `force`, raises a TakenOutputError
    if another file of this name has appeared; the new file is then saved beside it under another
    name.
    """
    target, beside = target_of(path), None
    name = target.name[:40]
    with reporting(path):
        clear_partials(directory or target.parent, glob.escape(name))
        disk = _begun(directory or target.parent, name, path)
    partial = Path(str(disk.name))
    try:
        with disk:
            yield disk
            disk.check()
            with reporting(path):
                os.fsync(disk.fileno())
                if os.name == "nt":  # an open file cannot be renamed
                    disk.close()
                if force:
                    partial.replace(target)
                elif not _named(partial, target):
                    beside = _named_beside(partial, target)
    finally:
        with suppress(OSError):  # the directory may have been removed
            partial.unlink()
    flush_directory(target.parent)
    if beside is not None:
        raise TakenOutputError(path, beside)


def _begun(directory: Path, name: str, path: Path) -> Disk:
    """Create a temporary file, locked until it is closed, so that no other process removes it."""
    while True:
        disk = Disk(directory / f".{name}.{secrets.token_hex(4)}.partial", path)
        try:
            if locked(disk.fileno(), wait=False) and os.fstat(disk.fileno()).st_nlink:
                return disk
        except OSError:  # a file system without locks, on which no temporary file is removed
            return disk
        disk.close()  # another process removed it before it was locked


def clear_partials(directory: Path, name: str = "*") -> None:
    """Remove temporary files that killed processes left, where their names match `name`."""
    for partial in directory.glob(f".{name}.{'[0-9a-f]' * 8}.partial"):
        with suppress(OSError), partial.open("r+b") as file:
            if locked(file.fileno(), wait=False):
                if os.name == "nt":  # an open file cannot be removed
                    file.close()
                partial.unlink()


def _named(partial: Path, name: Path) -> bool:
    """Rename a finished file unless the name is taken; return whether it was free."""
    try:
        name.hardlink_to(partial)
    except FileExistsError:
        return False
    except OSError:  # no hard links here: reserve the name, then replace it
        try:
            name.touch(exist_ok=False)
        except FileExistsError:
            return False
        partial.replace(name)
    return True


def _named_beside(partial: Path, target: Path) -> Path:
    """Rename a finished file to the first free variant of the target's name."""
    names = (
        target.with_name(f"{target.stem[:200]}-{k}{target.suffix}") for k in itertools.count(1)
    )
    return next(name for name in names if _named(partial, name))


@contextmanager
def reporting(path: Path) -> Iterator[None]:
    """Turn an error of writing into an OutputError that names the path."""
    try:
        yield
    except OutputError:
        raise
    except OSError as error:
        raise unwritten(path, error) from error


@contextmanager
def naming(argument: Word) -> Iterator[None]:
    """Let an OutputError name the argument that gives the output, where it is not `OUTPUT`."""
    try:
        yield
    except OutputError as error:
        error.write_again(argument if part == OUTPUT else part for part in error.parts)
        raise


def unwritten(path: Path, error: OSError) -> OutputError:
    """Return the OutputError for an error of writing."""
    remedy = "free some space"
    if error.errno == errno.EFBIG:
        remedy = "raise the limit on the size of a file (ulimit -f)"
    reason = f" ({error.strerror or error}); {remedy} or choose another place with "
    if error.errno == errno.ENOENT:
        parent = target_of(path).parent
        reason = f": {parent} was removed; make the directory again, or choose another place with "
    return OutputError(f"{path}: writing failed{reason}", OUTPUT, ", then run again")


def make_directory(directory: Path) -> None:
    """Make a directory, with those above it, or raise an OutputError."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        problem = f"{directory}: cannot be made ({error.strerror})"
        raise OutputError(f"{problem}; choose another directory, or free this path") from error


def flush_directory(directory: Path) -> None:
    """Flush the entries of a directory to the disk, on systems that can."""
    with suppress(OSError):
        descriptor = os.open(directory, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


DIGITS: Final = 64
PATTERN: Final = re.compile(rb"\nvibrosweep seal sha256 ([0-9a-f]{%d})\n" % DIGITS)
LENGTH: Final = len("\nvibrosweep seal sha256 \n") + DIGITS
BLOCK: Final = 1 << 20


class FileState(Enum):
    """Result of comparing a file with its seal."""

    INTACT = auto()
    BROKEN = auto()
    MISSING = auto()


def append_seal(file: BinaryIO) -> None:
    """Append a seal to a complete file that is open for reading and writing."""
    digest = _digest(file, file.seek(0, os.SEEK_END))
    file.seek(0, os.SEEK_END)
    file.write(f"\nvibrosweep seal sha256 {digest}\n".encode())


def state_of(path: Path) -> FileState:
    """Compare the contents of a file with its seal; takes about a second per 1-2 GB.

    Raises a ValueError for anything but a regular file.
    """
    return _state(*version_of(path))


@lru_cache(maxsize=16)
def _state(path: Path, inode: int, size: int, modified: int) -> FileState:
    """Compare once for each version of a file."""
    with path.open("rb") as file:
        file.seek(max(0, size - LENGTH))
        seal = PATTERN.fullmatch(file.read())
        if seal is None:
            return FileState.MISSING
        intact = _digest(file, size - LENGTH) == seal[1].decode()
    return FileState.INTACT if intact else FileState.BROKEN


def _digest(file: BinaryIO, length: int) -> str:
    """Return the checksum of the first `length` bytes of a file."""
    digest = hashlib.sha256()
    file.seek(0)
    while length > 0 and (block := file.read(min(BLOCK, length))):
        digest.update(block)
        length -= len(block)
    return digest.hexdigest()
