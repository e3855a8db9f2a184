"""The whole examination."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from vibrosweep.doctor.compiled import kernel_cache, threads, vector_registers
from vibrosweep.doctor.finding import Finding
from vibrosweep.doctor.libraries import hdf5_libraries, versions
from vibrosweep.doctor.machine import disk, memory, processors


def examine(directory: Path) -> Iterator[Finding]:
    """Check everything that a run in `directory` depends on, in about two seconds."""
    yield from versions()
    here = disk(directory)
    yield hdf5_libraries(None if here.trouble else directory)
    yield processors()
    yield threads()
    yield vector_registers()
    yield kernel_cache()
    yield memory()
    yield here
