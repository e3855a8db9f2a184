"""The commands, one file each.

Each file states a ``HELP``, adds its arguments to a parser (``add_arguments``), and performs the
command (``perform``), returning an exit code, or None for success.  Other modules are imported when
the command runs.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import ModuleType
from typing import Final

# By name, in the order in which ``vibrosweep --help`` lists them
COMMANDS: Final[Mapping[str, ModuleType]] = {
    name: import_module(f"vibrosweep.commands.{name}")
    for name in (
        *("examples", "plan", "run", "info", "figures", "explore"),
        *("windows", "bifurcation", "basins", "orbits", "branches", "boundaries"),
        *("verify", "lab", "doctor", "warmup"),
    )
}
