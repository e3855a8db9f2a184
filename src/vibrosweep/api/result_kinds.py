"""The kinds of results that this package writes.

They are registered when this file is imported, as `vibrosweep.store.reading` does before it looks
for a kind; the functions they call are imported when called.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

from vibrosweep.store.reading import ResultKind, register_kind

if TYPE_CHECKING:
    import xarray as xr

_PROVES: Final = "the reference proves landings of single trajectories from their launch,"
_OF_A_CAMERA: Final = "it holds measurements of a camera, which cannot be proved"


def _late(module: str, name: str) -> Callable[..., Any]:
    """Return a function that imports a function of this package when called, and calls it."""

    def call(*arguments: Any, **options: Any) -> Any:
        return getattr(import_module(f"vibrosweep.{module}"), name)(*arguments, **options)

    return call


def _window_lines(windows: xr.Dataset) -> Iterable[str]:
    from vibrosweep.analysis.windows import proof_lines, summary

    return [*summary(windows), *(proof_lines(windows) if "min_proof" in windows else ())]


def _basin_figure(basins: xr.Dataset) -> Any:
    from vibrosweep.figures import basin_shares, basins_of_attraction

    return (basin_shares if "along" in basins.attrs else basins_of_attraction)(basins)


WINDOWS: Final = ResultKind(
    "windows",
    "vibrosweep windows",
    _window_lines,
    _late("figures", "stability_windows"),
    "stability_windows",
    unverified=f"{_PROVES} while this result holds ends of intervals of the forcing",
)
BIFURCATION: Final = ResultKind(
    "bifurcation",
    "vibrosweep bifurcation",
    _late("analysis.bifurcation", "summary"),
    _late("figures", "bifurcation_diagram"),
    "bifurcation_diagram",
    unverified=f"{_PROVES} while this result holds orbits continued from amplitude to amplitude",
)
BASINS: Final = ResultKind(
    "basins",
    "vibrosweep basins",
    _late("analysis.basins", "summary"),
    _basin_figure,
    "basins_of_attraction",
    unverified=f"{_PROVES} while this result holds the attractors that launches lead to",
)
ORBITS: Final = ResultKind(
    "orbits",
    "vibrosweep orbits",
    _late("analysis.orbits", "summary"),
    _late("figures", "periodic_orbits"),
    "periodic_orbits",
    unverified="",
    verify=_late("proof", "verify_orbits"),
)
BRANCHES: Final = ResultKind(
    "branches",
    "vibrosweep branches",
    _late("analysis.branches", "summary"),
    _late("figures", "orbit_branches"),
    "orbit_branches",
    unverified=f"{_PROVES} while this result holds periodic orbits, whether they attract or not",
)
BOUNDARIES: Final = ResultKind(
    "boundaries",
    "vibrosweep boundaries",
    _late("analysis.branches", "summary"),
    _late("figures", "orbit_boundaries"),
    "orbit_boundaries",
    unverified=f"{_PROVES} while this result holds bifurcations of periodic orbits",
)
IMPACTS: Final = ResultKind(
    "impacts",
    "vibrosweep lab impacts",
    _late("lab.lines", "impact_lines"),
    undrawn="the figure shows the tracks themselves: vibrosweep lab impacts TRACKS --figures DIR",
    unverified=_OF_A_CAMERA,
)
COMPARISON: Final = ResultKind(
    "comparison",
    "vibrosweep lab compare",
    _late("lab.lines", "table_lines"),
    _late("figures.laboratory", "errors_by_case"),
    "lab_table4",
    unverified=_OF_A_CAMERA,
)
RESTITUTION: Final = ResultKind(
    "restitution",
    "vibrosweep lab restitution",
    _late("lab.lines", "restitution_lines"),
    _late("figures.laboratory", "restitution_by_speed"),
    "lab_restitution",
    unverified="it holds measurements of a ball, which cannot be proved",
)

for _kind in (
    WINDOWS,
    BIFURCATION,
    BASINS,
    ORBITS,
    BRANCHES,
    BOUNDARIES,
    IMPACTS,
    COMPARISON,
    RESTITUTION,
):
    register_kind(_kind)
