"""Signals, file locks and amounts of memory, which differ between operating systems.

psutil is required where neither the POSIX ``sysconf`` nor ``/proc`` states the memory.
"""

from __future__ import annotations

import os
import signal
import time
from importlib import import_module
from pathlib import Path
from typing import Final

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

# Signals that end a program; Windows has no SIGHUP
ENDINGS: Final = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]
MOST_THREADS: Final = 4096  # more than any machine runs; each takes memory
POLL: Final = 0.05  # s between two attempts to lock a file on Windows
# Windows lets nobody read a locked byte, so this one lies beyond the text of a lock file.
LOCKED_BYTE: Final = 1 << 30


def locked(descriptor: int, *, wait: bool) -> bool:
    """Lock a file that is open for writing, until it is closed or the process ends.

    Returns False if another process holds the lock and `wait` is False.  Raises an OSError where
    the file system has no locks.
    """
    if fcntl is None:
        return _locked_on_windows(descriptor, wait=wait)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _locked_on_windows(descriptor: int, *, wait: bool) -> bool:
    msvcrt = import_module("msvcrt")
    while True:
        os.lseek(descriptor, LOCKED_BYTE, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except PermissionError:
            if not wait:
                return False
            time.sleep(POLL)
        else:
            return True
        finally:
            os.lseek(descriptor, 0, os.SEEK_SET)


def physical_memory() -> int:
    """Total memory of this machine in bytes."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError):
        return int(import_module("psutil").virtual_memory().total)


def available_memory() -> int:
    """Memory in bytes that programs can still take."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    except OSError:
        return int(import_module("psutil").virtual_memory().available)
    return next(int(line.split()[1]) for line in lines if line.startswith("MemAvailable")) * 1024


def resident_memory() -> int:
    """Memory in bytes that this process occupies."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        return int(import_module("psutil").Process().memory_info().rss)
    return pages * os.sysconf("SC_PAGE_SIZE")
