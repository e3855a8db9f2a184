"""Pictures of docs/what-high-bounce-costs.md."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from vibrosweep.figures import style

REGIMES = ("at rest", "resting", "locked", "other")
COLOURS = ("0.75", style.OKABE_ITO[5], style.OKABE_ITO[0], style.OKABE_ITO[1])


@style.styled
def plane(e, gamma, common, same):
    """Commonest regime on each base, and the share of launches with the same regime on both."""
    figure = Figure(figsize=(style.PAGE, 3.0), layout="constrained")
    panels = figure.subplots(1, 3, sharex=True, sharey=True)
    codes = {"cmap": ListedColormap(COLOURS), "norm": BoundaryNorm(np.arange(5) - 0.5, 4)}
    for axes, values, title in zip(panels, common, ("fixed base", "moving base"), strict=False):
        drawn = axes.pcolormesh(e, gamma, values, rasterized=True, **codes)
        axes.set_title(title)
    bar = figure.colorbar(
        drawn, ax=panels[:2], ticks=range(4), location="bottom", shrink=0.8, aspect=40
    )
    bar.ax.set_xticklabels(REGIMES)
    shares = panels[2].pcolormesh(
        e, gamma, 100.0 * same, cmap=style.SEQUENTIAL_MAP, vmin=0.0, vmax=100.0, rasterized=True
    )
    panels[2].set_title("the same regime on both")
    bar = figure.colorbar(shares, ax=panels[2], location="bottom", aspect=20)
    bar.set_label("launches (%)")
    for axes in panels:
        axes.plot(e, np.pi * (1.0 - e) / (1.0 + e), "k-", path_effects=style.halo())
        axes.axhline(1.0, color="k", linestyle=":", path_effects=style.halo())
        axes.set(yscale="log", xlim=(e[0], e[-1]), ylim=(gamma[0], gamma[-1]))
    figure.supxlabel("restitution $e$", size=9.0)
    panels[0].set_ylabel("acceleration of the base $\\Gamma$ (g)")
    return figure


@style.styled
def limit(gammas, curves):
    """Difference of landing times between the bases against Gamma, with its first order."""
    figure, axes = style.new_figure(style.COLUMN, 3.0)
    for (u, off), colour in zip(curves.items(), style.colours(len(curves)), strict=True):
        axes.loglog(gammas, off[:, 0], "o", markersize=3, color=colour, label=f"$u_0 = {u:g}$")
        axes.loglog(gammas, off[:, -1], "s", markersize=3, color=colour, fillstyle="none")
        axes.loglog(gammas, gammas / (np.sqrt(2.0) * np.pi**2 * u), "-", color=colour)
    axes.set_xlabel("acceleration of the base $\\Gamma$ (g)")
    axes.set_ylabel("difference of landing times\n(rms, forcing periods)")
    style.head(axes, "first landing (dots), fourth (squares), first order (lines)", 3)
    return figure
