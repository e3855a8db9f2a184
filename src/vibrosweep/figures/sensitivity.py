"""Sobol' indices as bars."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from vibrosweep.analysis.datasets import require
from vibrosweep.figures import data, style
from vibrosweep.figures.canvas import Panels
from vibrosweep.model.measures import VARIABLES

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["sobol_bars"]


@style.styled
def sobol_bars(indices: xr.Dataset, *, ax: Axes | Sequence[Axes] | Panels | None = None) -> Panels:
    """Draw first-order and total indices of each output, with their intervals.

    Parameters
    ----------
    indices
        Result of `vibrosweep.sobol`.
    ax
        Axes to draw on, one for each output; by default those of a new figure of pyplot.

    Returns
    -------
    numpy.ndarray of matplotlib.axes.Axes
        The axes, shape (output,).

    Raises
    ------
    DataError
        The dataset is not a result of `vibrosweep.sobol`.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import sobol_bars
    >>> found = vs.sobol(restitution=(0.8, 0.98), amplitude=(0.2, 3.5), realizations=64)
    >>> len(sobol_bars(found)) == found.sizes["output"]
    True
    """
    parts = ("first_order", "total_order")
    require(indices, "sobol_bars", "output", "parameter", *parts, source="sobol")
    outputs = [str(name) for name in indices["output"].values]
    names = [str(name) for name in indices["parameter"].values]
    at = np.arange(len(names), dtype=np.float64)
    height, row = 1.5 + 0.24 * len(names), list(range(len(outputs)))
    panels = style.panels_on(ax, style.PAGE, height, [row], sharex=True, sharey=True)
    for axes, output in zip(panels, outputs, strict=True):
        one = indices.sel(output=output)
        for name, shift, colour, label in (
            ("first_order", -0.2, style.OKABE_ITO[0], "alone"),
            ("total_order", 0.2, style.OKABE_ITO[5], "with interactions"),
        ):
            axes.barh(at + shift, one[name].values, height=0.36, color=colour, label=label)
            # an interval need not hold the index, and so cannot be drawn as its error
            low, high = one[f"{name}_low"].values, one[f"{name}_high"].values
            axes.hlines(at + shift, low, high, color="black", linewidth=0.7)
        words = VARIABLES[output].long_name if output in VARIABLES else output
        axes.set_title(textwrap.fill(words, 18))
        axes.axvline(0.0, color="black", linewidth=0.6)
        axes.set_xlabel("Sobol' index")
        axes.set_yticks(at, [f"{n.replace('_', ' ')}{data.symbol(n)}" for n in names])
        axes.set_ylim(at[-1] + 0.6, -0.6)  # the first parameter is on top
    style.beside(panels[-1], "")
    return panels
