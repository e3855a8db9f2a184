"""The run directory next to an output, locked by one process at a time."""

from __future__ import annotations

import os
import shutil
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from vibrosweep.errors import RunError
from vibrosweep.mistakes import OUTPUT
from vibrosweep.store.disk import clear_partials, reporting, target_of, unwritten
from vibrosweep.store.parts import MANIFEST, read_manifest
from vibrosweep.system import locked

LOCK: Final = "lock"


def run_directory(output: Path) -> Path:
    """Return the path of the run directory of an output, on the same file system."""
    target = target_of(output)
    return target.with_name(f"{target.name}.parts")


def replaces(output: Path) -> bool:
    """Return whether an unfinished run was started with ``force``, to replace the output.

    Raises a RunError if its manifest is damaged.
    """
    manifest = read_manifest(run_directory(output))
    return manifest is not None and manifest.replaces


@contextmanager
def holding(output: Path) -> Iterator[Path]:
    """Create the run directory of an output and lock it; the lock ends with the process.

    First, temporary files of killed processes are removed.  At the end the directory is removed,
    unless it holds the manifest of a run that can be resumed.  Raises a RunError if another process
    holds the lock, and an OutputError if the directory cannot be created.
    """
    directory = run_directory(output)
    descriptor = _locked(output, directory)
    try:
        clear_partials(directory)
        yield directory
    finally:
        if (directory / MANIFEST).exists():
            os.close(descriptor)
        else:
            _remove(directory, descriptor)


def _locked(output: Path, directory: Path) -> int:
    """Create the directory, lock its lock file and return the descriptor."""
    while True:
        with reporting(output):
            directory.mkdir(exist_ok=True)
        try:
            descriptor = os.open(directory / LOCK, os.O_RDWR | os.O_CREAT, 0o666)
        except FileNotFoundError:  # a run that ended has just removed the directory
            continue
        except OSError as error:
            raise unwritten(output, error) from error
        try:
            _lock(output, directory, descriptor)
            if os.fstat(descriptor).st_nlink:
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)  # a run that ended has just removed the file


def _lock(output: Path, directory: Path, descriptor: int) -> None:
    try:
        free = locked(descriptor, wait=False)
    except OSError as error:
        raise RunError(
            f"{output}: the file system of {directory} has no locks ({error.strerror}), so that "
            f"two runs could disturb each other; choose another place with ",
            OUTPUT,
        ) from error
    if not free:
        holder = os.read(descriptor, 200).decode(errors="replace").strip()
        raise RunError(
            f"{output}: is being computed by another run ({holder or 'process unknown'}), which "
            f"holds {directory}; wait for its end, or write to another file with ",
            OUTPUT,
        )
    with suppress(OSError):  # the text is needed for messages only
        os.ftruncate(descriptor, 0)
        os.write(descriptor, f"process {os.getpid()} on {socket.gethostname()}\n".encode())


def empty(directory: Path) -> None:
    """Remove all files of a run from its directory, except the lock."""
    abandon(directory)
    for path in directory.iterdir():
        if path.name != LOCK:
            shutil.rmtree(path) if path.is_dir() else path.unlink()


def abandon(directory: Path) -> None:
    """Remove the manifest of a run directory, so that no run resumes with its parts."""
    (directory / MANIFEST).unlink(missing_ok=True)


def _remove(directory: Path, descriptor: int) -> None:
    """Remove the directory and release its lock, in this order except on Windows."""
    with suppress(OSError):  # leftover files do no harm
        empty(directory)
    if os.name == "nt":
        os.close(descriptor)
    with suppress(OSError):
        (directory / LOCK).unlink()
        directory.rmdir()
    if os.name != "nt":
        os.close(descriptor)
