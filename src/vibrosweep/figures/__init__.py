"""Figures of a result or of a record of landings: Dataset in, matplotlib Axes out.

The figures compute only geometry: parabolas between recorded events, and closed forms.
They draw on the axes that are given as ``ax``, or on a new figure of pyplot, and leave the
parameters of matplotlib unchanged; files are written without pyplot.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Final

from vibrosweep.errors import VibrosweepError
from vibrosweep.lazy import lazily

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
    from vibrosweep.figures.basins import basin_shares, basins_of_attraction
    from vibrosweep.figures.bifurcation import bifurcation_diagram
    from vibrosweep.figures.height_curves import height_time
    from vibrosweep.figures.lines import orbit_boundaries, orbit_branches
    from vibrosweep.figures.orbits import periodic_orbits
    from vibrosweep.figures.plane import parameter_plane
    from vibrosweep.figures.registry import available, save_all
    from vibrosweep.figures.restitution import height_against_restitution
    from vibrosweep.figures.returns import return_map
    from vibrosweep.figures.sensitivity import sobol_bars
    from vibrosweep.figures.separations import (
        separation_distributions,
        separations_over_chance,
    )
    from vibrosweep.figures.shares import share_curves
    from vibrosweep.figures.window_bands import stability_windows

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
    "style": "vibrosweep.figures.style",
    **dict.fromkeys(("basin_shares", "basins_of_attraction"), "vibrosweep.figures.basins"),
    "bifurcation_diagram": "vibrosweep.figures.bifurcation",
    "height_time": "vibrosweep.figures.height_curves",
    "parameter_plane": "vibrosweep.figures.plane",
    **dict.fromkeys(("orbit_boundaries", "orbit_branches"), "vibrosweep.figures.lines"),
    "periodic_orbits": "vibrosweep.figures.orbits",
    **dict.fromkeys(("available", "save_all"), "vibrosweep.figures.registry"),
    "height_against_restitution": "vibrosweep.figures.restitution",
    "return_map": "vibrosweep.figures.returns",
    "share_curves": "vibrosweep.figures.shares",
    "sobol_bars": "vibrosweep.figures.sensitivity",
    **dict.fromkeys(
        ("separation_distributions", "separations_over_chance"),
        "vibrosweep.figures.separations",
    ),
    "stability_windows": "vibrosweep.figures.window_bands",
}
__getattr__ = lazily(__name__, _HOMES)
