"""The seal: a checksum at the end of a result file, which is compared before HDF5 reads the file.

HDF5 ignores bytes after its own end of file.  When it reads a damaged file, it may return wrong
numbers, crash the process or never return.
"""

from __future__ import annotations

import hashlib
import os
import re
from enum import Enum, auto
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO, Final

from vibrosweep.store.trial import version_of

DIGITS: Final = 64
PATTERN: Final = re.compile(rb"\nvibrosweep seal sha256 ([0-9a-f]{%d})\n" % DIGITS)
LENGTH: Final = len("\nvibrosweep seal sha256 \n") + DIGITS
BLOCK: Final = 1 << 20


class State(Enum):
    """Result of comparing a file with its seal."""

    INTACT = auto()
    BROKEN = auto()
    MISSING = auto()


def append_seal(file: BinaryIO) -> None:
    """Append a seal to a complete file that is open for reading and writing."""
    digest = _digest(file, file.seek(0, os.SEEK_END))
    file.seek(0, os.SEEK_END)
    file.write(f"\nvibrosweep seal sha256 {digest}\n".encode())


def state_of(path: Path) -> State:
    """Compare the contents of a file with its seal; takes about a second per 1-2 GB.

    Raises a ValueError for anything but a regular file.
    """
    return _state(*version_of(path))


@lru_cache(maxsize=16)
def _state(path: Path, inode: int, size: int, modified: int) -> State:
    """Compare once for each version of a file."""
    with path.open("rb") as file:
        file.seek(max(0, size - LENGTH))
        seal = PATTERN.fullmatch(file.read())
        if seal is None:
            return State.MISSING
        intact = _digest(file, size - LENGTH) == seal[1].decode()
    return State.INTACT if intact else State.BROKEN


def _digest(file: BinaryIO, length: int) -> str:
    """Return the checksum of the first `length` bytes of a file."""
    digest = hashlib.sha256()
    file.seek(0)
    while length > 0 and (block := file.read(min(BLOCK, length))):
        digest.update(block)
        length -= len(block)
    return digest.hexdigest()
