"""The commands; each has a file of its own name.

Each file adds its arguments to a parser (``add_arguments``) and performs the command (``perform``),
returning an exit code, or None for success.  Other modules are imported when the command runs.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

# What each command does, in the order in which ``vibrosweep --help`` lists them
COMMANDS: Final[Mapping[str, str]] = {
    "examples": "list the example sweeps, or copy some of them",
    "plan": "estimate what a sweep will take, from a few of its realizations",
    "run": "compute a sweep file",
    "info": "show what a result file holds",
    "figures": "draw the figures of a result file",
    "explore": "look at a result in a browser, and at the motion behind every point of it",
    "windows": "find the intervals of the forcing in which conditions hold",
    "bifurcation": "follow orbits up and down the forcing, and draw them",
    "basins": "find the attractor that each launch leads to, and draw the basins",
    "orbits": "search for periodic orbits, whether they attract or not",
    "branches": "follow periodic orbits along a parameter, and find their bifurcations",
    "boundaries": "trace bifurcations of periodic orbits over a plane",
    "verify": "compare a result file with proved values",
    "lab": "measure camera tracks and compare them with prediction",
    "doctor": "examine the installation and this machine; exit code 1 if anything is wrong",
    "warmup": "compile the kernels of common scenes once and keep the machine code",
}
