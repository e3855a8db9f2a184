"""The kinds of results that this package writes.

They are registered when the package is imported; the functions they call are imported when called.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from vibrosweep.store.kinds import ResultKind, register_kind

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

    from vibrosweep.figures.canvas import Panels
    from vibrosweep.proof.verification import Report

_PROVES: Final = "the reference proves landings of single trajectories from their launch, and"
_OF_A_CAMERA: Final = "it holds measurements of a camera, which cannot be proved"


def _window_lines(windows: xr.Dataset) -> Iterable[str]:
    from vibrosweep.analysis.window_codes import proof_lines, summary

    return [*summary(windows), *(proof_lines(windows) if "min_proof" in windows else ())]


def _window_figure(windows: xr.Dataset) -> Panels:
    from vibrosweep.figures import stability_windows

    return stability_windows(windows)


def _bifurcation_lines(diagram: xr.Dataset) -> Iterable[str]:
    from vibrosweep.analysis.bifurcation import summary

    return summary(diagram)


def _bifurcation_figure(diagram: xr.Dataset) -> Panels:
    from vibrosweep.figures import bifurcation_diagram

    return bifurcation_diagram(diagram)


def _basin_lines(basins: xr.Dataset) -> Iterable[str]:
    from vibrosweep.analysis.basins import summary

    return summary(basins)


def _basin_figure(basins: xr.Dataset) -> Axes:
    from vibrosweep.figures import basin_shares, basins_of_attraction

    return (basin_shares if "along" in basins.attrs else basins_of_attraction)(basins)


def _orbit_lines(orbits: xr.Dataset) -> Iterable[str]:
    from vibrosweep.analysis.closed_orbits import summary

    return summary(orbits)


def _orbit_figure(orbits: xr.Dataset) -> Axes:
    from vibrosweep.figures import periodic_orbits

    return periodic_orbits(orbits)


def _verify_orbits(path: Path, **options: Any) -> Report:
    from vibrosweep.proof.closed_orbits import verify_orbits

    return verify_orbits(path, **options)


def _line_lines(lines: xr.Dataset) -> Iterable[str]:
    from vibrosweep.analysis.branches import summary

    return summary(lines)


def _branch_figure(branches: xr.Dataset) -> Axes:
    from vibrosweep.figures import orbit_branches

    return orbit_branches(branches)


def _boundary_figure(boundaries: xr.Dataset) -> Axes:
    from vibrosweep.figures import orbit_boundaries

    return orbit_boundaries(boundaries)


def _impact_lines(impacts: xr.Dataset) -> Iterable[str]:
    from vibrosweep.lab.lines import impact_lines

    return impact_lines(impacts)


def _comparison_lines(table: xr.Dataset) -> Iterable[str]:
    from vibrosweep.lab.lines import table_lines

    return table_lines(table)


def _comparison_figure(table: xr.Dataset) -> Panels:
    from vibrosweep.figures.laboratory import errors_by_case

    return errors_by_case(table)


WINDOWS: Final = register_kind(
    ResultKind(
        "windows",
        "vibrosweep windows",
        _window_lines,
        _window_figure,
        "stability_windows",
        unverified=f"{_PROVES} this holds ends of intervals of the forcing",
    )
)
BIFURCATION: Final = register_kind(
    ResultKind(
        "bifurcation",
        "vibrosweep bifurcation",
        _bifurcation_lines,
        _bifurcation_figure,
        "bifurcation_diagram",
        unverified=f"{_PROVES} this holds orbits that are continued from amplitude to amplitude",
    )
)
BASINS: Final = register_kind(
    ResultKind(
        "basins",
        "vibrosweep basins",
        _basin_lines,
        _basin_figure,
        "basins_of_attraction",
        unverified=f"{_PROVES} this holds the attractors that launches lead to",
    )
)
ORBITS: Final = register_kind(
    ResultKind(
        "orbits",
        "vibrosweep orbits",
        _orbit_lines,
        _orbit_figure,
        "periodic_orbits",
        unverified="",
        verify=_verify_orbits,
    )
)
BRANCHES: Final = register_kind(
    ResultKind(
        "branches",
        "vibrosweep branches",
        _line_lines,
        _branch_figure,
        "orbit_branches",
        unverified=f"{_PROVES} this holds periodic orbits, whether they attract or not",
    )
)
BOUNDARIES: Final = register_kind(
    ResultKind(
        "boundaries",
        "vibrosweep boundaries",
        _line_lines,
        _boundary_figure,
        "orbit_boundaries",
        unverified=f"{_PROVES} this holds bifurcations of periodic orbits",
    )
)
IMPACTS: Final = register_kind(
    ResultKind(
        "impacts",
        "vibrosweep lab impacts",
        _impact_lines,
        undrawn="the figure shows the tracks themselves: vibrosweep lab impacts TRACKS "
        "--figures DIR",
        unverified=_OF_A_CAMERA,
    )
)
COMPARISON: Final = register_kind(
    ResultKind(
        "comparison",
        "vibrosweep lab compare",
        _comparison_lines,
        _comparison_figure,
        "lab_table4",
        unverified=_OF_A_CAMERA,
    )
)
