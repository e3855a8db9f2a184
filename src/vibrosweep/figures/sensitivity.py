"""Sobol' indices as bars."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from vibrosweep.analysis.requirements import require
from vibrosweep.figures import data, style
from vibrosweep.model.measures import VARIABLES

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["sobol_bars"]


@style.styled
def sobol_bars(indices: xr.Dataset) -> Figure:
    """Draw first-order and total indices of each output, with their intervals.

    Parameters
    ----------
    indices
        Result of `vibrosweep.sobol`.

    Returns
    -------
    matplotlib.figure.Figure
        The figure; it is neither displayed nor written.

    Raises
    ------
    DataError
        The dataset is no result of `vibrosweep.sobol`.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import sobol_bars
    >>> found = vs.sobol(restitution=(0.8, 0.98), amplitude=(0.2, 3.5), realizations=64)
    >>> len(sobol_bars(found).axes) == found.sizes["output"]
    True
    """
    parts = ("first_order", "total_order")
    require(indices, "sobol_bars", "output", "parameter", *parts, source="sobol")
    outputs = [str(name) for name in indices["output"].values]
    names = [str(name) for name in indices["parameter"].values]
    figure = Figure(figsize=(style.PAGE, 1.6 + 0.24 * len(names)), layout="constrained")
    at = np.arange(len(names), dtype=np.float64)
    panels = figure.subplots(1, len(outputs), sharex=True, sharey=True, squeeze=False)[0]
    for axes, output in zip(panels, outputs, strict=True):
        one = indices.sel(output=output)
        for name, shift, colour, label in (
            ("first_order", -0.2, style.OKABE_ITO[0], "alone"),
            ("total_order", 0.2, style.OKABE_ITO[5], "with interactions"),
        ):
            value = one[name].values
            ends = np.stack([value - one[f"{name}_low"].values, one[f"{name}_high"].values - value])
            axes.barh(
                at + shift,
                value,
                height=0.36,
                color=colour,
                xerr=np.maximum(ends, 0.0),
                error_kw={"elinewidth": 0.7},
                label=label,
            )
        axes.set_title(textwrap.fill(_short(output), 18))
        axes.axvline(0.0, color="black", linewidth=0.6)
    panels[0].set_yticks(at, [f"{n.replace('_', ' ')}{data.symbol(n)}" for n in names])
    panels[0].invert_yaxis()
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=2)
    figure.supxlabel("Sobol' index", fontsize=9)
    return figure


def _short(output: str) -> str:
    return VARIABLES[output].long_name if output in VARIABLES else output
