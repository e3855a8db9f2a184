"""A seal behind the end of a result file: a checksum that shows damage before HDF5 reads it.

HDF5 ignores what stands behind its own end, but of a damaged file it may make anything: other
numbers, a crash of the process, a loop without end.
"""

from __future__ import annotations

import hashlib
import os
import re
from enum import Enum, auto
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO, Final

__all__ = ["State", "append_seal", "state_of"]

DIGITS: Final = 64
PATTERN: Final = re.compile(rb"\nvibrosweep seal sha256 ([0-9a-f]{%d})\n" % DIGITS)
LENGTH: Final = len("\nvibrosweep seal sha256 \n") + DIGITS
BLOCK: Final = 1 << 20


class State(Enum):
    """What the seal of a file says."""

    INTACT = auto()
    BROKEN = auto()
    MISSING = auto()


def append_seal(file: BinaryIO) -> None:
    """Seal a file that is complete and open for reading and writing."""
    digest = _digest(file, file.seek(0, os.SEEK_END))
    file.seek(0, os.SEEK_END)
    file.write(f"\nvibrosweep seal sha256 {digest}\n".encode())


def state_of(path: Path) -> State:
    """Compare the contents of a file with its seal, which takes a second for a gigabyte or two.

    Raises
    ------
    OSError
        It cannot be read.
    """
    found = path.stat()
    return _state(path.resolve(), found.st_ino, found.st_size, found.st_mtime_ns)


@lru_cache(maxsize=16)
def _state(path: Path, inode: int, size: int, modified: int) -> State:
    """Compare once; a file that has changed since has another time or inode."""
    with path.open("rb") as file:
        file.seek(max(0, size - LENGTH))
        seal = PATTERN.fullmatch(file.read())
        if seal is None:
            return State.MISSING
        intact = _digest(file, size - LENGTH) == seal[1].decode()
    return State.INTACT if intact else State.BROKEN


def _digest(file: BinaryIO, length: int) -> str:
    """Checksum of the first bytes of a file."""
    digest = hashlib.sha256()
    file.seek(0)
    while length > 0 and (block := file.read(min(BLOCK, length))):
        digest.update(block)
        length -= len(block)
    return digest.hexdigest()
