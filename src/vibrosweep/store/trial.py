"""Trial reading of a whole file in a separate process, because HDF5 may crash or never return.

``python trial.py PATH`` reads the file and prints the reason if that fails.
"""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

# Time allowed for reading, far more than even a slow disk needs
PATIENCE: Final = 20.0  # s
BYTES_PER_SECOND: Final = 1 << 24
ROWS_AT_A_TIME: Final = 1 << 16


def require_readable(path: Path) -> None:
    """Raise a ValueError if HDF5 cannot read all of a file, crashes or is not done in time."""
    _try(*version_of(path))


@lru_cache(maxsize=16)
def _try(path: Path, inode: int, size: int, modified: int) -> None:
    """Try once for each version of a file."""
    from vibrosweep.system import ENDINGS  # the trial itself does not import this package

    patience = PATIENCE + size / BYTES_PER_SECOND
    # -P: modules in this directory must not shadow others of the same name
    command = [sys.executable, "-P", "-W", "ignore", __file__, str(path)]
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
            timeout=patience,
            start_new_session=True,  # the interruption of a terminal ends only this process
        )
    except subprocess.TimeoutExpired as error:
        raise ValueError(f"HDF5 does not finish reading it in {patience:.0f} s") from error
    if -done.returncode in ENDINGS:  # a signal, which this process gets too, ended the trial
        raise KeyboardInterrupt
    if done.returncode < 0:
        raise ValueError(f"HDF5 crashes on it (signal {-done.returncode})")
    if done.returncode:
        raise ValueError(done.stdout.strip() or "HDF5 cannot read it")


def open_for_writing(path: Path) -> bool:
    """Return whether HDF5 has marked a file as open for writing.

    The mark is a bit of the superblock, and stays if the writing program does not close the file.
    """
    try:
        if not path.is_file():
            return False
        with path.open("rb") as file:
            block = file.read(24).ljust(24, b"\0")
    except OSError:
        return False
    if not block.startswith(b"\x89HDF\r\n\x1a\n"):
        return False
    version = block[8]
    return bool(block[20 if version < 2 else 11] & 1)


def version_of(path: Path) -> tuple[Path, int, int, int]:
    """Return path, inode, size and modification time, by which a changed file is recognised.

    Raises a ValueError for anything but a regular file: reading a pipe or a device might never
    end.
    """
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        raise ValueError("it is not a regular file")
    return path.resolve(), found.st_ino, found.st_size, found.st_mtime_ns


def require_whole(file: Any) -> None:
    """Raise a ValueError if an open file of h5py keeps any of its data in another file.

    The other file may have changed, or be a pipe that blocks the reader.
    """
    import h5py

    links: dict[str, Any] = {}
    file.visititems_links(links.__setitem__)
    away = [name for name, link in links.items() if isinstance(link, h5py.ExternalLink)]

    def check(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and (item.is_virtual or item.external):
            away.append(name)

    file.visititems(check)
    if away:
        raise ValueError(f"{', '.join(sorted(away))}: kept in another file, which is not opened")


def _read(group: Any) -> None:
    """Read all attributes and variables of a group of h5py and of those inside it."""
    dict(group.attrs)
    for member in group.values():
        if hasattr(member, "values"):
            _read(member)
        elif hasattr(member, "shape"):  # a named type has no shape
            dict(member.attrs)
            if member.shape:
                for start in range(0, member.shape[0], ROWS_AT_A_TIME):
                    member[start : start + ROWS_AT_A_TIME]
            elif member.shape is not None:  # None: an empty dataset
                member[()]


def _resolve(group: Any) -> None:
    """Find the dimensions of all variables of a group of h5netcdf and of those inside it."""
    for variable in group.variables.values():
        _ = variable.dimensions
    for inside in group.groups.values():
        _resolve(inside)


def _limit_memory() -> None:
    """Limit the memory of this process: a damaged size must not exhaust that of the machine."""
    try:
        import resource
    except ImportError:  # Windows has no limits of memory
        return
    half = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2
    with suppress(OSError, ValueError):  # some versions of macOS have none either
        resource.setrlimit(resource.RLIMIT_AS, (half, half))


if __name__ == "__main__":
    import h5netcdf
    import h5py

    _limit_memory()
    try:
        with h5py.File(sys.argv[1], "r") as file:  # h5netcdf takes five times as long to read all
            require_whole(file)
            _read(file)
        with h5netcdf.File(sys.argv[1], "r", phony_dims="access") as file:
            _resolve(file)
    except Exception as error:
        print(" ".join(str(error).split())[:300])
        raise SystemExit(1) from None
