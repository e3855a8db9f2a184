"""The commands, in files of those that belong together.

Each file has a table, `COMMANDS`, of two functions for each command: one adds its arguments to a
parser, the other performs it and returns an exit code, or None for success.  A file is imported
when one of its commands is called, other modules when it runs.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple


class Command(NamedTuple):
    """What ``vibrosweep --help`` says about a command, and where it is."""

    words: str
    module: str
    example: str = ""


# In the order in which ``vibrosweep --help`` lists them
COMMANDS: Final[Mapping[str, Command]] = {
    "examples": Command(
        "list the example sweeps, or copy some of them", "sweeps", "vibrosweep examples paper"
    ),
    "plan": Command(
        "estimate the time, memory and disk that a sweep takes",
        "sweeps",
        "vibrosweep plan paper.toml --threads 8",
    ),
    "run": Command("compute a sweep file", "sweeps", "vibrosweep run paper.toml -o paper.h5"),
    "info": Command("show what a result file holds", "results", "vibrosweep info paper.h5"),
    "figures": Command(
        "draw the figures of a result file", "results", "vibrosweep figures paper.h5 -o figures"
    ),
    "explore": Command(
        "look at a result in a browser, and at the motion behind every point of it",
        "explore",
        "vibrosweep explore plane.h5",
    ),
    "windows": Command(
        "find the intervals of the forcing in which conditions hold",
        "pictures",
        "vibrosweep windows windows.toml",
    ),
    "bifurcation": Command(
        "continue orbits up and down the forcing, and draw them",
        "pictures",
        "vibrosweep bifurcation bifurcation.toml --samples 200",
    ),
    "basins": Command(
        "find the attractor that each launch leads to, and draw the basins",
        "pictures",
        "vibrosweep basins basins.toml",
    ),
    "orbits": Command(
        "search for periodic orbits, whether they attract or not",
        "pictures",
        "vibrosweep orbits orbits.toml --impacts 2 --periods 3",
    ),
    "branches": Command(
        "continue periodic orbits along a parameter, and find their bifurcations",
        "pictures",
        "vibrosweep branches branches.toml --doublings 2",
    ),
    "boundaries": Command(
        "trace bifurcations of periodic orbits over a plane",
        "pictures",
        "vibrosweep boundaries boundaries.toml --periods 2",
    ),
    "verify": Command(
        "compare a result file with proved values",
        "results",
        "vibrosweep verify paper.h5 --sample 50",
    ),
    "lab": Command("measure camera tracks and compare them with prediction", "lab"),
    "doctor": Command(
        "examine the installation and this machine; exit code 1 if anything is wrong",
        "machine",
        "vibrosweep doctor",
    ),
    "warmup": Command(
        "compile the kernels of common scenes in advance",
        "machine",
        "vibrosweep warmup",
    ),
}
