"""Figures of a result or of a record of landings: Dataset in, matplotlib Axes out.

The figures compute only geometry: parabolas between recorded events, and closed forms.
They draw on the axes that are given as ``ax``, or on a new figure of pyplot, and leave the
parameters of matplotlib unchanged; files are written without pyplot.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Final

from vibrosweep.errors import VibrosweepError
from vibrosweep.waiting import lazily

if "MPLBACKEND" in os.environ:
    try:
        import matplotlib  # noqa: F401
    except ValueError as error:
        raise VibrosweepError(
            f"MPLBACKEND={os.environ['MPLBACKEND']}: is not a backend of matplotlib; unset it, or "
            f"name one that is"
        ) from error

if TYPE_CHECKING:
    from vibrosweep.figures import style
    from vibrosweep.figures.orbits import (
        basin_shares,
        basins_of_attraction,
        bifurcation_diagram,
        orbit_boundaries,
        orbit_branches,
        periodic_orbits,
    )
    from vibrosweep.figures.records import height_time, return_map
    from vibrosweep.figures.registry import available, save_all
    from vibrosweep.figures.sweeps import (
        height_against_restitution,
        parameter_plane,
        separation_distributions,
        separations_over_chance,
        share_curves,
        sobol_bars,
    )
    from vibrosweep.figures.windows import stability_windows

__all__ = [
    "available",
    "basin_shares",
    "basins_of_attraction",
    "bifurcation_diagram",
    "height_against_restitution",
    "height_time",
    "orbit_boundaries",
    "orbit_branches",
    "parameter_plane",
    "periodic_orbits",
    "return_map",
    "save_all",
    "separation_distributions",
    "separations_over_chance",
    "share_curves",
    "sobol_bars",
    "stability_windows",
    "style",
]

_HOMES: Final = {
    name: f"vibrosweep.figures.{home}"
    for home, names in {
        "style": ["style"],
        "records": ["height_time", "return_map"],
        "sweeps": [
            "height_against_restitution",
            "parameter_plane",
            "separation_distributions",
            "separations_over_chance",
            "share_curves",
            "sobol_bars",
        ],
        "windows": ["stability_windows"],
        "orbits": [
            "basin_shares",
            "basins_of_attraction",
            "bifurcation_diagram",
            "orbit_boundaries",
            "orbit_branches",
            "periodic_orbits",
        ],
        "registry": ["available", "save_all"],
    }.items()
    for name in names
}
__getattr__ = lazily(__name__, _HOMES)


def __dir__() -> list[str]:
    return sorted(__all__)
