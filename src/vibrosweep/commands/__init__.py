"""The commands, one file each, which imports other modules when the command runs.

Each file states its ``NAME`` and ``HELP``, adds its arguments to a parser, and performs the
command, returning an exit code or None for success.
"""

from __future__ import annotations

from types import ModuleType
from typing import Final

from vibrosweep.commands import (
    basins,
    bifurcation,
    boundaries,
    branches,
    doctor,
    examples,
    explore,
    figures,
    info,
    lab,
    orbits,
    plan,
    run,
    verify,
    warmup,
    windows,
)

__all__ = ["COMMANDS"]

COMMANDS: Final[tuple[ModuleType, ...]] = (
    examples,
    plan,
    run,
    info,
    figures,
    explore,
    windows,
    bifurcation,
    basins,
    orbits,
    branches,
    boundaries,
    verify,
    lab,
    doctor,
    warmup,
)
