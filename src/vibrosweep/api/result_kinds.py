"""The kinds of results that this package writes.

They are registered when this file is imported, as `vibrosweep.store.reading` does before it looks
for a kind; the functions they call are imported when called.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

from vibrosweep.store.reading import ResultKind, register_kind

if TYPE_CHECKING:
    import xarray as xr


def _late(path: str) -> Callable[..., Any]:
    """Return a function that imports a function of this package when called, and calls it."""
    module, _, name = path.rpartition(".")

    def call(*arguments: Any, **options: Any) -> Any:
        return getattr(import_module(f"vibrosweep.{module}"), name)(*arguments, **options)

    return call


def _analysis(name: str, lines: str, figure: str, holds: str, **more: Any) -> ResultKind:
    """Register the kind of an analysis, which ``verify`` does not prove, as a message says."""
    unverified = (
        f"the reference proves landings of single trajectories from their launch, while this "
        f"result holds {holds}"
    )
    drawn = {"draw": _late(f"figures.{figure}"), "stem": figure, "unverified": unverified}
    summary = _late(f"analysis.{lines}")
    return register_kind(ResultKind(name, f"vibrosweep {name}", summary, **{**drawn, **more}))


def _of_laboratory(name: str, lines: str, *drawn: Any, **more: Any) -> ResultKind:
    """Register a kind of the laboratory."""
    command = f"vibrosweep lab {'compare' if name == 'comparison' else name}"
    more = {"unverified": "it holds measurements of a camera, which cannot be proved"} | more
    return register_kind(ResultKind(name, command, _late(f"lab.lines.{lines}"), *drawn, **more))


def _basin_figure(basins: xr.Dataset) -> Any:
    from vibrosweep.figures import basin_shares, basins_of_attraction

    return (basin_shares if "along" in basins.attrs else basins_of_attraction)(basins)


WINDOWS: Final = _analysis(
    "windows", "windows.summary", "stability_windows", "ends of intervals of the forcing"
)
BIFURCATION: Final = _analysis(
    "bifurcation",
    "bifurcation.summary",
    "bifurcation_diagram",
    "orbits continued from amplitude to amplitude",
)
BASINS: Final = _analysis(
    "basins",
    "basins.summary",
    "basins_of_attraction",
    "the attractors that launches lead to",
    draw=_basin_figure,
)
ORBITS: Final = _analysis(
    "orbits",
    "orbits.summary",
    "periodic_orbits",
    "",
    unverified="",
    verify=_late("proof.verify_orbits"),
)
BRANCHES: Final = _analysis(
    "branches",
    "orbits.line_summary",
    "orbit_branches",
    "periodic orbits, whether they attract or not",
)
BOUNDARIES: Final = _analysis(
    "boundaries", "orbits.line_summary", "orbit_boundaries", "bifurcations of periodic orbits"
)
IMPACTS: Final = _of_laboratory(
    "impacts",
    "impact_lines",
    undrawn="the figure shows the tracks themselves: vibrosweep lab impacts TRACKS --figures DIR",
)
COMPARISON: Final = _of_laboratory(
    "comparison", "table_lines", _late("figures.laboratory.errors_by_case"), "lab_table4"
)
RESTITUTION: Final = _of_laboratory(
    "restitution",
    "restitution_lines",
    _late("figures.laboratory.restitution_by_speed"),
    "lab_restitution",
    unverified="it holds measurements of a ball, which cannot be proved",
)
