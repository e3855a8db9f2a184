"""``vibrosweep doctor``: find problems of this installation and their remedies."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from vibrosweep.commands.arguments import some
from vibrosweep.errors import VibrosweepError

if TYPE_CHECKING:
    from vibrosweep.doctor import Finding


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add nothing: the command has no arguments."""


def perform(options: argparse.Namespace) -> int:
    """Perform the command; return 1 if anything is wrong."""
    wrong = 0
    for finding in _findings(Path.cwd()):
        print("\n".join(finding.lines()), flush=True)
        wrong += bool(finding.trouble)
    print(f"{some(wrong, 'problem')}, marked WRONG above" if wrong else "all is well")
    return 1 if wrong else 0


def _findings(directory: Path) -> Iterator[Finding]:
    """Check everything that a run in `directory` depends on, in a few seconds."""
    from vibrosweep.doctor import Finding, libraries

    yield from libraries.versions()
    try:
        from vibrosweep.doctor import compiled, machine
    except VibrosweepError as error:  # a numba with which nothing runs
        yield Finding("compiler", "none", str(error))
        return
    space = machine.disk(directory)
    place = None if space.trouble else directory
    yield libraries.hdf5_libraries(place)
    yield machine.processors()
    yield compiled.compiler(place)
    yield compiled.vector_registers()
    yield compiled.kernel_cache()
    yield machine.memory()
    yield space
