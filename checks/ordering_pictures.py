"""Pictures of study/ordering.md."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from vibrosweep.figures import style

KINDS = ("staggered", "bunched", "other modes", "not locked", "at rest")
COLOURS = (style.OKABE_ITO[0], style.OKABE_ITO[1], style.OKABE_ITO[5], "0.85", "0.45")


@mpl.rc_context(style.RC)
def stability(natural, load, panels):
    """Spectral radius of staggered orbits over natural frequency and mass, with resonances."""
    figure = Figure(figsize=(style.PAGE, 5.0), layout="constrained")
    grid = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, (k, particles, damping, values, tips) in zip(grid.flat, panels, strict=True):
        drawn = axes.pcolormesh(
            natural, load, values, cmap="RdBu_r", vmin=0.9, vmax=1.1, rasterized=True
        )
        axes.contour(natural, load, values, [1.0], colors="k", linewidths=0.8)
        axes.plot(tips, np.full(tips.shape, load[0]), "^", color="k", markersize=5, clip_on=False)
        many = "one particle" if particles == 1 else f"{particles} particles in {k} slots"
        axes.set_title(f"{many}, $k = {k}$, $\\zeta = {damping:g}$")
        axes.set(xscale="log", yscale="log")
    for axes in grid[1]:
        axes.set_xlabel("natural frequency of the mount $f_0/f$")
    for axes in grid[:, 0]:
        axes.set_ylabel("mass of all particles $N\\mu$")
    bar = figure.colorbar(drawn, ax=grid, extend="both")
    bar.set_label("spectral radius per period")
    return figure


@mpl.rc_context(style.RC)
def attractors(natural, load, maps, edge):
    """Commonest outcome over natural frequency and mass, with the limit of linear stability."""
    figure = Figure(figsize=(style.PAGE, 3.0), layout="constrained")
    panels = figure.subplots(1, len(maps), sharex=True, sharey=True)
    codes = {"cmap": ListedColormap(COLOURS), "norm": BoundaryNorm(np.arange(6) - 0.5, 5)}
    for axes, (words, kinds) in zip(panels, maps.items(), strict=True):
        drawn = axes.pcolormesh(natural, load, kinds, rasterized=True, **codes)
        axes.contour(natural, load, np.nan_to_num(edge, nan=9.0), [1.0], colors="k", linewidths=0.8)
        axes.set(xscale="log", yscale="log", title=words)
        axes.set_xlabel("natural frequency $f_0/f$")
    panels[0].set_ylabel("mass of both particles $2\\mu$")
    figure.colorbar(drawn, ax=panels, ticks=range(5)).ax.set_yticklabels(KINDS)
    return figure


@mpl.rc_context(style.RC)
def phases(cases, times, slot):
    """Phase of every landing against time, one panel for each case; colours by slot of launch."""
    figure = Figure(figsize=(style.PAGE, 5.6), layout="constrained")
    panels = figure.subplots(len(cases), 1, sharex=True, sharey=True)
    for axes, (load, natural), landings in zip(panels, cases, times, strict=True):
        for own, place in zip(landings, slot, strict=True):
            colour = style.OKABE_ITO[place]
            axes.plot(own, own % 1.0, ".", markersize=2.0, color=colour, rasterized=True)
        axes.set_title(f"$N\\mu = {load:g}$, $f_0/f = {natural:g}$")
        axes.set_ylim(0.15, 0.65)
    figure.supylabel("phase of landing (turns)", fontsize=9.0)
    panels[-1].set_xlabel("time (forcing periods)")
    return figure
