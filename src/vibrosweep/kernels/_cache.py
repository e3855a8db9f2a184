"""Numba's disk cache of machine code, made safe for several processes and for damaged files.

Numba numbers the files of a kernel's compiled variants in an index that it reads, extends and
writes back.  Two processes that do this at once can take the same number; one variant is then
loaded in place of the other, for example with a wrong law of rebound, and without an error.
Therefore only one process at a time may write.

Numba does not notice a flipped bit either, which may give wrong numbers or end the process.
Therefore every file has a checksum, which is compared before its bytes are used.
"""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import pickle
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, ClassVar, Final, NamedTuple

import numba

from vibrosweep.kernels._numba import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    UserProvidedCacheLocator,
    start_runtime,
    target,
    vector_bits,
)
from vibrosweep.system import locked

BYTES: Final = 32  # of a checksum

# Name of a file of machine code, and its checksum
Entry = tuple[str, bytes]


def _checksum(data: bytes) -> bytes:
    return hashlib.sha256(data).digest()


def _indexed(path: Path) -> tuple[Any, dict[Any, Entry]]:
    """Read an index: a stamp of the source, and the variants; a ValueError if it is damaged."""
    data = path.read_bytes()
    if _checksum(data[BYTES:]) != data[:BYTES]:
        raise ValueError(f"{path}: is damaged")
    stamp, entries = pickle.loads(data[BYTES:])
    return stamp, entries


def _machine_code(directory: Path, entry: Entry) -> bytes | None:
    """Read a file of machine code; None if it is damaged or missing."""
    name, checksum = entry
    try:
        data = (directory / name).read_bytes()
    except OSError:
        return None
    return data if _checksum(data) == checksum else None


def find_caches(digest: str) -> tuple[Path | None, tuple[Path, ...]]:
    """Return where machine code of some sources is saved, or None, and where it is only read.

    An administrator may have compiled kernels in a package that its users cannot change.
    """
    beside = Path(__file__).parent / "__pycache__"
    bases = [Path(numba.config.CACHE_DIR)] if numba.config.CACHE_DIR else [beside]
    if not numba.config.CACHE_DIR:
        with contextlib.suppress(RuntimeError):  # a user without a home directory
            bases.append(Path.home() / ".cache")
    read_only: list[Path] = []
    for base in bases:
        directory = base / "vibrosweep-kernels" / digest
        try:
            if not directory.is_dir():
                if base == beside:  # machine code of other sources can never be loaded again
                    shutil.rmtree(directory.parent, ignore_errors=True)
                directory.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=directory):
                return directory, (*read_only,)
        except OSError:
            with contextlib.suppress(OSError):
                read_only += [directory] if directory.is_dir() else []
    return None, (*read_only,)


class CheckedFiles(IndexDataCacheFile):  # type: ignore[misc]
    """The files of one kernel: an index with its checksum before it, and machine code.

    The index also holds the checksums of the machine code, so that a file of another variant, which
    a killed process may have left under the same number, is not loaded either.
    """

    def load(self, key: Any) -> Any:
        """Return the saved data of a variant, or None."""
        entry = self._load_index().get(key)
        data = None if entry is None else _machine_code(Path(self._cache_path), entry)
        return None if data is None else pickle.loads(data)

    def save(self, key: Any, data: Any) -> None:
        """Save a variant, in place of an earlier or damaged one."""
        entries = self._load_index()
        taken = {name for name, _ in entries.values()}
        free = (name for name in map(self._data_name, itertools.count(1)) if name not in taken)
        name = entries[key][0] if key in entries else next(free)
        code = self._dump(data)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(code)
        entries[key] = name, _checksum(code)
        index = self._dump((self._source_stamp, entries))
        with self._open_for_write(self._index_path) as file:
            file.write(_checksum(index) + index)

    def _load_index(self) -> dict[Any, Entry]:
        """Variants that were compiled from this source; none where the index cannot be read."""
        try:
            stamp, entries = _indexed(Path(self._index_path))
        except Exception:  # the exceptions of unpickling have no common base class
            return {}
        return entries if stamp == self._source_stamp else {}


class _Locator(UserProvidedCacheLocator):  # type: ignore[misc]
    """Numba's place for a cache; one that cannot be written is still read."""

    def ensure_cache_path(self) -> None:
        with contextlib.suppress(OSError):
            super().ensure_cache_path()


class _Results(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes: ClassVar = [_Locator]


class KernelCache(FunctionCache):  # type: ignore[misc]
    """The cache of one kernel; a damaged file counts as missing, and is written again.

    Machine code that it lacks is also looked for in the directories `read_only`.
    """

    _impl_class = _Results

    def __init__(self, function: Any, read_only: Iterable[Path] = ()) -> None:
        super().__init__(function)
        stamp = self._impl.locator.get_source_stamp()
        folder = Path(self._cache_path)
        self._cache_file, *self._read_only = (
            CheckedFiles(str(place), self._impl.filename_base, stamp)
            for place in (folder, *(directory / folder.name for directory in read_only))
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the machine code of a variant, or None.

        Numba would first import everything that it can compile, SciPy's linear algebra included,
        which takes longer than all else.  Complete machine code needs only the functions that count
        references; if machine code is missing, the compiler imports the rest itself.
        """
        # a file of another version of a library may fail in any way
        with contextlib.suppress(Exception):
            start_runtime(target_context)
            key = self._index_key(sig, target_context.codegen())
            for files in (self._cache_file, *self._read_only):
                if (data := files.load(key)) is not None:
                    return self._impl.rebuild(target_context, data)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save the machine code of a variant; without a writable disk it is compiled again."""
        with contextlib.suppress(OSError), self._alone():
            super().save_overload(sig, data)

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        """Return numba's key of a variant, with the width of vectors that the environment sets."""
        return (*super()._index_key(sig, codegen), vector_bits())

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        """Lock the cache against other processes."""
        with (Path(self.cache_path) / ".lock").open("a") as lock:
            locked(lock.fileno(), wait=True)
            yield


class Variants(NamedTuple):
    """Counts of the compiled variants in a directory."""

    usable: int  # variants that this processor can use
    foreign: int  # variants for other processors or widths of vectors
    damaged: int  # variants whose file, or whose kernel's index, is damaged or missing


def variants(directory: Path) -> Variants:
    """Count the compiled variants in a directory of machine code, and compare every checksum.

    Variants are distinguished by (signature, (system, processor, its features), digest, width of
    vectors).
    """
    here = target()
    usable = foreign = damaged = 0
    for index in directory.rglob("*.nbi"):
        try:
            _, entries = _indexed(index)
        except Exception:
            damaged += 1
            continue
        for key, entry in entries.items():
            if _machine_code(index.parent, entry) is None:
                damaged += 1
            elif (key[1], key[-1]) == (here, vector_bits()):
                usable += 1
            else:
                foreign += 1
    return Variants(usable, foreign, damaged)
