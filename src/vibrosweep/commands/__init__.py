"""The commands, one file each.

Each file states a ``NAME`` and a ``HELP``, adds its arguments to a parser (``add_arguments``), and
performs the command (``perform``), returning an exit code, or None for success.  Other modules are
imported when the command runs.
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
