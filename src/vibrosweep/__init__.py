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
    from vibrosweep import analysis as analysis
    from vibrosweep import errors as errors
    from vibrosweep import figures as figures
    from vibrosweep import lab as lab
    from vibrosweep import theory as theory
    from vibrosweep.analysis.records import positions as positions
    from vibrosweep.analysis.records import rectangle as rectangle
    from vibrosweep.api.analyses import basins as basins
    from vibrosweep.api.analyses import bifurcation as bifurcation
    from vibrosweep.api.analyses import boundaries as boundaries
    from vibrosweep.api.analyses import branches as branches
    from vibrosweep.api.analyses import orbits as orbits
    from vibrosweep.api.analyses import separations as separations
    from vibrosweep.api.analyses import sobol as sobol
    from vibrosweep.api.analyses import windows as windows
    from vibrosweep.api.simulation import simulate as simulate
    from vibrosweep.api.sweeps import run as run
    from vibrosweep.api.sweeps import sweep as sweep
    from vibrosweep.explorer import explore as explore
    from vibrosweep.model.measures import LANDINGS_OF_AN_EXPONENT as LANDINGS_OF_AN_EXPONENT
    from vibrosweep.model.measures import Regime as Regime
    from vibrosweep.model.measures import Status as Status
    from vibrosweep.model.observables import Landing as Landing
    from vibrosweep.model.observables import Observable as Observable
    from vibrosweep.model.parameters import PARAMETERS as PARAMETERS
    from vibrosweep.model.parameters import Parameter as Parameter
    from vibrosweep.model.restitution_laws import Law as Law
    from vibrosweep.model.restitution_laws import register_law as register_law
    from vibrosweep.proof import verify as verify
    from vibrosweep.scene.design import register_design as register_design
    from vibrosweep.store.reading import ResultKind as ResultKind
    from vibrosweep.store.reading import open_record as open_record
    from vibrosweep.store.reading import open_sweep as open_sweep
    from vibrosweep.store.reading import register_kind as register_kind
    from vibrosweep.store.writing import save_result as save_result

# Modules that define the public names
_HOMES = {
    name: f"vibrosweep.{home}"
    for home, names in {
        **{name: name for name in ("analysis", "errors", "figures", "lab", "theory")},
        "analysis.records": "positions rectangle",
        "api.analyses": "basins bifurcation boundaries branches orbits separations sobol windows",
        "api.simulation": "simulate",
        "api.sweeps": "run sweep",
        "explorer": "explore",
        "model.measures": "LANDINGS_OF_AN_EXPONENT Regime Status",
        "model.observables": "Landing Observable",
        "model.parameters": "PARAMETERS Parameter",
        "model.restitution_laws": "Law register_law",
        "proof": "verify",
        "scene.design": "register_design",
        "store.reading": "ResultKind open_record open_sweep register_kind",
        "store.writing": "save_result",
    }.items()
    for name in names.split()
}
__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> object:
    from vibrosweep.waiting import lazily

    return lazily(__name__, _HOMES)(name)


def __dir__() -> list[str]:
    return sorted(__all__)
