"""Figures of a sweep and of a record of landings: Dataset in, matplotlib Figure out.

Nothing is computed here but geometry: parabolas between recorded events, and closed forms.
Nothing is shown and no global state of matplotlib is changed.
"""

from __future__ import annotations

from vibrosweep.figures.height_curves import height_time
from vibrosweep.figures.plane import parameter_plane
from vibrosweep.figures.registry import FIGURES, FigureEntry, available, missing, save_all
from vibrosweep.figures.restitution import height_against_restitution
from vibrosweep.figures.returns import return_map

__all__ = [
    "FIGURES",
    "FigureEntry",
    "available",
    "height_against_restitution",
    "height_time",
    "missing",
    "parameter_plane",
    "return_map",
    "save_all",
]
