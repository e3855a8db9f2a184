"""Checks of `vibrosweep doctor`: libraries, processor, kernels, disk and memory."""

from collections.abc import Iterator
from pathlib import Path

import vibrosweep.kernels  # noqa: F401  (before numba: it reads the environment)
from vibrosweep.doctor.compiled import kernel_cache, vector_registers
from vibrosweep.doctor.finding import Finding
from vibrosweep.doctor.libraries import hdf5_libraries, versions
from vibrosweep.doctor.machine import disk, memory, processors

__all__ = ["Finding", "examine"]


def examine(directory: Path) -> Iterator[Finding]:
    """Check everything that a run in `directory` depends on, in about two seconds."""
    yield from versions()
    space = disk(directory)
    yield hdf5_libraries(None if space.trouble else directory)
    yield processors()
    yield vector_registers()
    yield kernel_cache()
    yield memory()
    yield space
