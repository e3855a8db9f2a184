"""Fast, accurate parameter sweeps of the bouncing ball (vibro-impact).

`sweep` computes realizations in memory, `run` into a file that survives interruptions, and
`simulate` gives every landing of a small scene; `windows`, `bifurcation`, `basins`, `sobol` and
`separations` answer one question each.  All take the same keywords and return an `xarray.Dataset`.
`lab` reads camera tracks, `theory` holds closed forms, `errors` what is raised.

Importing this package loads neither numba nor xarray: they are loaded when first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

from vibrosweep._version import __version__

if TYPE_CHECKING:
    from vibrosweep import errors, lab
    from vibrosweep.api.analyses import basins, bifurcation, separations, sobol, windows
    from vibrosweep.api.results import open_record, open_sweep
    from vibrosweep.api.simulation import simulate
    from vibrosweep.api.sweeps import run, sweep
    from vibrosweep.model import theory
    from vibrosweep.model.observables import Landing, Observable

__all__ = [
    "Landing",
    "Observable",
    "__version__",
    "basins",
    "bifurcation",
    "errors",
    "lab",
    "open_record",
    "open_sweep",
    "run",
    "separations",
    "simulate",
    "sobol",
    "sweep",
    "theory",
    "windows",
]

# Where each public name stands; a module stands for itself.
_HOMES: Final = {
    "errors": "vibrosweep.errors",
    "lab": "vibrosweep.lab",
    "theory": "vibrosweep.model.theory",
    **dict.fromkeys(("Landing", "Observable"), "vibrosweep.model.observables"),
    **dict.fromkeys(("run", "sweep"), "vibrosweep.api.sweeps"),
    **dict.fromkeys(("open_record", "open_sweep"), "vibrosweep.api.results"),
    "simulate": "vibrosweep.api.simulation",
    **dict.fromkeys(
        ("basins", "bifurcation", "separations", "sobol", "windows"), "vibrosweep.api.analyses"
    ),
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'vibrosweep' has no attribute {name!r}")
    home = import_module(_HOMES[name])
    return getattr(home, name, home)


def __dir__() -> list[str]:
    return sorted(__all__)
