"""Where a condition holds among random samples, and the brackets of its edges between them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from vibrosweep.figures import data, style
from vibrosweep.figures.windows import draw_windows

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["NEEDS", "edges_between_samples"]

NEEDS: Final = data.Needs(("holds", "restitution", "amplitude", "restitution_inside"))


@style.styled
def edges_between_samples(edges: xr.Dataset) -> Figure:
    """Draw samples by whether a condition holds, and a line across every bracket of its edge.

    Parameters
    ----------
    edges
        Result of `vibrosweep.analysis.sampled.sampled_edges`.

    Raises
    ------
    DataError
        The dataset lacks a variable.
    """
    NEEDS.check("edges_between_samples", edges)
    figure, axes = style.new_figure(style.MEDIUM, 3.6)
    holds = edges["holds"].values == 1
    name = str(edges.attrs["condition"]).replace("_", " ")
    e, amplitude = edges["restitution"].values, edges["amplitude"].values
    inside = np.stack([edges["restitution_inside"], edges["amplitude_inside"]], axis=-1)
    outside = np.stack([edges["restitution_outside"], edges["amplitude_outside"]], axis=-1)
    segments = np.stack([inside, outside], axis=1)
    label = "bracket of an edge"
    axes.add_collection(LineCollection(list(segments), colors=style.GREY, lw=0.6, label=label))
    for chosen, words in ((holds, name), (~holds, f"not {name}")):
        colour = style.OKABE_ITO[0 if chosen is holds else 1]
        axes.scatter(e[chosen], amplitude[chosen], s=9.0, linewidths=0.0, color=colour, label=words)
    axes.set_xlabel(data.label(edges, "restitution"))
    axes.set_ylabel(data.label(edges, "amplitude"))
    if {"frequency", "gravity"} <= edges.coords.keys():
        forcing = float(edges["frequency"]), float(edges["gravity"])
        draw_windows(axes, *forcing, "A", over=False)
    style.head(axes, "")
    return figure
