"""The run directory next to an output: its lock, the manifest, and one file per finished chunk.

One process at a time may hold it.  A part is written under a temporary name, flushed to the disk
and renamed to a name with its chunk number and its checksum.  Renaming is atomic: whenever the
process is killed, a chunk is either finished, with a valid checksum, or missing.  The checksum
includes the manifest, so that a part of another run is never accepted.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import shutil
import socket
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.errors import RunError
from vibrosweep.mistakes import FORCE, OUTPUT
from vibrosweep.store.disk import (
    clear_partials,
    flush_directory,
    replacing,
    reporting,
    target_of,
    unwritten,
)
from vibrosweep.system import locked

Columns = dict[str, NDArray[Any]]

MANIFEST: Final = "manifest.json"
PART: Final = re.compile(r"chunk-(\d{10})-[0-9a-f]{32}\.part")
ALIGNMENT: Final = 64


@dataclass(frozen=True)
class Manifest:
    """Identity of a run and its division into chunks, which never change during the run."""

    identity: Mapping[str, str]  # everything on which the results depend, by name
    realizations: int
    chunk: int  # realizations in a chunk; the last one may hold fewer
    # Type and shape of each column, as `kinds` gives them; the same for every part
    columns: Mapping[str, str]
    replaces: bool = False  # True if an existing output is to be replaced at the end
    text: str = ""  # text of the sweep file as it stands in the result

    @property
    def key(self) -> str:
        """Checksum of the manifest."""
        text = json.dumps(asdict(self), sort_keys=True)
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.realizations // self.chunk)

    def bounds(self, index: int) -> tuple[int, int]:
        """First realization of a chunk, and the end of its range (exclusive)."""
        return index * self.chunk, min((index + 1) * self.chunk, self.realizations)


def kinds(columns: Mapping[str, NDArray[Any]]) -> dict[str, str]:
    """Return the type of each column, and its shape without the first dimension."""
    return {name: f"{values.dtype.str} {values.shape[1:]}" for name, values in columns.items()}


def write_manifest(directory: Path, manifest: Manifest) -> None:
    """Write the manifest of a run directory; an OutputError if it cannot be written."""
    text = json.dumps({"run": asdict(manifest), "checksum": manifest.key}, indent=1)
    with replacing(directory / MANIFEST) as disk:
        disk.write(text.encode())
    flush_directory(directory.parent)


def read_manifest(directory: Path) -> Manifest | None:
    """Read the manifest of a run directory; None if missing, a RunError if it is damaged."""
    path = directory / MANIFEST
    try:
        data = json.loads(path.read_bytes())
        manifest = Manifest(**data["run"])
        if data["checksum"] == manifest.key and manifest.chunk >= 1:
            return manifest
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise RunError(
            f"{path}: cannot be read ({error.strerror}); choose another place with ", OUTPUT
        ) from error
    except (ValueError, TypeError, KeyError, RecursionError):
        pass
    raise RunError(
        f"{path}: is damaged or of another version, so that the parts next to it "
        f"cannot be identified; start the run again with ",
        FORCE,
    )


@dataclass(frozen=True)
class Parts:
    """The parts of a run."""

    directory: Path
    manifest: Manifest

    def write(self, index: int, columns: Mapping[str, NDArray[Any]]) -> None:
        """Write the part of a chunk; equal columns give equal files, bit for bit.

        Raises a RunError for columns other than those of the manifest, and an OutputError if the
        part cannot be written.
        """
        if not self._fits(index, columns):
            raise RunError(
                f"{self.directory}: chunk {index} was computed with other columns than the run "
                f"declares ({', '.join(sorted(columns))}); use the same version everywhere"
            )
        pieces = _packed(columns)
        with replacing(self.directory / self._name(index, pieces)) as disk:
            for piece in pieces:
                disk.write(piece)

    def finished(self) -> dict[int, Path]:
        """Return the paths of the parts of all finished chunks, by chunk number."""
        found = ((PART.fullmatch(path.name), path) for path in self.directory.iterdir())
        return {int(match[1]): path for match, path in found if match}

    def read(self, index: int, path: Path) -> Columns | None:
        """Read the part of a chunk; None if it is damaged, missing, or has other columns."""
        try:
            data = path.read_bytes()
        except OSError:
            return None
        if path.name != self._name(index, [data]):
            return None
        columns = _unpacked(data)
        return columns if self._fits(index, columns) else None

    def _fits(self, index: int, columns: Mapping[str, NDArray[Any]]) -> bool:
        """Return whether the columns are those of the manifest and have the length of the chunk."""
        start, stop = self.manifest.bounds(index)
        lengths = {len(values) for values in columns.values()}
        return kinds(columns) == self.manifest.columns and lengths <= {stop - start}

    def _name(self, index: int, pieces: Iterable[bytes | memoryview]) -> str:
        digest = hashlib.blake2b(f"{self.manifest.key} {index}\n".encode(), digest_size=16)
        for piece in pieces:
            digest.update(piece)
        return f"chunk-{index:010d}-{digest.hexdigest()}.part"


# Format of a part: a line of JSON that lists the arrays in order, then their bytes, each padded to
# a multiple of `ALIGNMENT`.  numpy's .npz copies all data again and adds more checksums,
# which took a tenth of the time of a quick sweep.


def _packed(columns: Mapping[str, NDArray[Any]]) -> list[bytes | memoryview]:
    head = json.dumps([(name, v.dtype.str, v.shape) for name, v in columns.items()]).encode()
    pieces: list[bytes | memoryview] = [head + b" " * (-(len(head) + 1) % ALIGNMENT) + b"\n"]
    for values in columns.values():
        data = np.ascontiguousarray(values).reshape(-1).view(np.uint8)
        pieces += [data.data, bytes(-data.size % ALIGNMENT)]
    return pieces


def _unpacked(data: bytes) -> Columns:
    place = data.index(b"\n") + 1
    columns = {}
    for name, kind, shape in json.loads(data[:place]):
        values = np.frombuffer(data, kind, math.prod(shape), place).reshape(shape)
        columns[name] = values
        place += values.nbytes + -values.nbytes % ALIGNMENT
    return columns


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
