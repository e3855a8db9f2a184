"""Fast, accurate parameter sweeps of the bouncing ball (vibro-impact).

`sweep` computes realizations in memory, `run` computes them into a file and continues after
interruptions, `simulate` returns every landing of a small scene, and `positions` heights at any
times; `windows`, `bifurcation`, `basins`, `orbits`, `branches`, `boundaries`, `sobol` and
`separations` answer one question each.  Functions that compute take the same keywords, and all
return an `xarray.Dataset`.  `analysis` derives quantities from a result or a record, `figures`
draws, `lab` reads camera tracks, `theory` holds closed forms, `errors` the exceptions.

Importing this package loads neither numba nor xarray: they are loaded when first used.
"""

from __future__ import annotations

from vibrosweep._version import __version__

# `typing` takes ten times as long as this file, during which a command cannot handle signals yet
TYPE_CHECKING = False
if TYPE_CHECKING:
    from vibrosweep import analysis, errors, figures, lab, theory
    from vibrosweep.analysis.records import positions, rectangle
    from vibrosweep.api.analyses import (
        basins,
        bifurcation,
        boundaries,
        branches,
        orbits,
        separations,
        sobol,
        windows,
    )
    from vibrosweep.api.simulation import simulate
    from vibrosweep.api.sweeps import run, sweep
    from vibrosweep.explorer import explore
    from vibrosweep.model.measures import LANDINGS_OF_AN_EXPONENT, Regime, Status
    from vibrosweep.model.observables import Landing, Observable
    from vibrosweep.model.parameters import PARAMETERS, Parameter
    from vibrosweep.model.restitution_laws import Law, register_law
    from vibrosweep.proof import verify
    from vibrosweep.scene.design import register_design
    from vibrosweep.store.reading import ResultKind, open_record, open_sweep, register_kind
    from vibrosweep.store.writing import save_result

__all__ = [
    "LANDINGS_OF_AN_EXPONENT",
    "PARAMETERS",
    "Landing",
    "Law",
    "Observable",
    "Parameter",
    "Regime",
    "ResultKind",
    "Status",
    "__version__",
    "analysis",
    "basins",
    "bifurcation",
    "boundaries",
    "branches",
    "errors",
    "explore",
    "figures",
    "lab",
    "open_record",
    "open_sweep",
    "orbits",
    "positions",
    "rectangle",
    "register_design",
    "register_kind",
    "register_law",
    "run",
    "save_result",
    "separations",
    "simulate",
    "sobol",
    "sweep",
    "theory",
    "verify",
    "windows",
]

_HOMES = {
    **{name: f"vibrosweep.{name}" for name in ("analysis", "errors", "figures", "lab", "theory")},
    "explore": "vibrosweep.explorer",
    "Landing": "vibrosweep.model.observables",
    **dict.fromkeys(("Law", "register_law"), "vibrosweep.model.restitution_laws"),
    "Observable": "vibrosweep.model.observables",
    **dict.fromkeys(("PARAMETERS", "Parameter"), "vibrosweep.model.parameters"),
    **dict.fromkeys(("LANDINGS_OF_AN_EXPONENT", "Regime", "Status"), "vibrosweep.model.measures"),
    **dict.fromkeys(("run", "sweep"), "vibrosweep.api.sweeps"),
    **dict.fromkeys(("open_record", "open_sweep"), "vibrosweep.store.reading"),
    **dict.fromkeys(("boundaries", "branches", "orbits"), "vibrosweep.api.analyses"),
    "positions": "vibrosweep.analysis.records",
    "rectangle": "vibrosweep.analysis.records",
    **dict.fromkeys(("ResultKind", "register_kind"), "vibrosweep.store.reading"),
    "save_result": "vibrosweep.store.writing",
    "register_design": "vibrosweep.scene.design",
    "separations": "vibrosweep.api.analyses",
    "simulate": "vibrosweep.api.simulation",
    "verify": "vibrosweep.proof",
    **dict.fromkeys(("basins", "bifurcation", "sobol", "windows"), "vibrosweep.api.analyses"),
}


def __getattr__(name: str) -> object:
    from vibrosweep.lazy import lazily

    return lazily(__name__, _HOMES)(name)


def __dir__() -> list[str]:
    return sorted(__all__)
