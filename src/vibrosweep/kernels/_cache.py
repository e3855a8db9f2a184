"""Numba's disk cache of machine code, made safe for several processes and for damaged files.

Numba numbers the files of a kernel's compiled variants in an index that it reads, extends and
writes back.  Two processes that do this at once can take the same number; one variant is then
loaded in place of the other, for example with a wrong law of rebound, and without an error.
Therefore only one process at a time may write.
"""

from __future__ import annotations

import contextlib
import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numba
from numba.core.caching import FunctionCache
from numba.core.registry import cpu_target
from numba.core.runtime import rtsys

from vibrosweep.kernels.vectors import vector_bits
from vibrosweep.system import locked


class KernelCache(FunctionCache):  # type: ignore[misc]
    """The cache of one kernel; an unreadable file counts as missing."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the machine code of a variant, or None.

        Numba first imports everything that it can compile, SciPy's linear algebra among it, which
        takes longer than all else.  Machine code that is complete needs no more than the functions
        that count references; where there is none, the compiler imports the rest itself.
        """
        try:
            rtsys.initialize(target_context)
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)
        except Exception:  # the exceptions of unpickling damaged bytes have no common base class
            self._discard()
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save the machine code of a variant; without a writable disk it is compiled again."""
        with contextlib.suppress(OSError), self._alone():
            super().save_overload(sig, data)

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        """Tell variants apart by the width of their vectors too, which the environment can set."""
        return (*super()._index_key(sig, codegen), vector_bits())

    def _discard(self) -> None:
        index = Path(self._cache_file._index_path)
        with contextlib.suppress(OSError), self._alone():
            index.unlink(missing_ok=True)

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        """Wait until no other process writes in the cache."""
        with (Path(self.cache_path) / ".lock").open("a") as lock:
            locked(lock.fileno(), wait=True)
            yield


class Variants(NamedTuple):
    """How many compiled variants a directory holds."""

    usable: int  # of them, those that this processor and this numba can use
    foreign: int  # those of other processors, versions or widths of vectors
    damaged: int  # those that cannot be read


def variants(directory: Path) -> Variants:
    """Count the compiled variants in a directory of machine code.

    An index file holds the version of numba, and then a stamp of the source and the variants: names
    of files by (signature, (system, processor, its features), digest, width of vectors).
    """
    cpu_target.target_context.refresh()
    here = cpu_target.target_context.codegen().magic_tuple()
    usable = foreign = damaged = 0
    for index in directory.rglob("*.nbi"):
        try:
            with index.open("rb") as file:
                version = pickle.load(file)
                _, overloads = pickle.load(file)
        except Exception:
            damaged += 1
            continue
        for key, name in overloads.items():
            if not (index.parent / name).is_file():
                damaged += 1
            elif version == numba.__version__ and (key[1], key[-1]) == (here, vector_bits()):
                usable += 1
            else:
                foreign += 1
    return Variants(usable, foreign, damaged)
