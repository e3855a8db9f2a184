"""Pictures of study/high-bounce.md."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from vibrosweep.figures import style

REGIMES = ("at rest", "resting", "locked", "other")
TICKS = (0.03, 0.1, 0.3, 1.0, 3.0)
COLOURS = ("0.75", style.OKABE_ITO[5], style.OKABE_ITO[0], style.OKABE_ITO[1])


@mpl.rc_context(style.RC)
def plane(e, gamma, common, agreement):
    """Commonest regime on each base, and two shares of launches that agree on both bases."""
    figure = Figure(figsize=(style.PAGE, 5.2), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    codes = {"cmap": ListedColormap(COLOURS), "norm": BoundaryNorm(np.arange(5) - 0.5, 4)}
    q = (1.0 - e) / (1.0 + e)
    for axes, values, steepest, title in zip(
        panels[0], common, (1.0, 1.0 + q * q), ("fixed base", "moving base"), strict=True
    ):
        kinds = axes.pcolormesh(e, gamma, values, rasterized=True, **codes)
        axes.plot(e, np.hypot(np.pi * q, steepest), "k--", path_effects=style.halo())
        axes.set_title(f"commonest regime, {title}")
    titles = ("the same regime", "the same, at rest and resting as one")
    for axes, share, title in zip(panels[1], agreement, titles, strict=True):
        shares = axes.pcolormesh(
            e,
            gamma,
            100.0 * share,
            cmap=style.SEQUENTIAL_MAP,
            vmin=0.0,
            vmax=100.0,
            rasterized=True,
        )
        axes.set_title(title)
    figure.colorbar(kinds, ax=panels[0], ticks=range(4)).ax.set_yticklabels(REGIMES)
    figure.colorbar(shares, ax=panels[1]).set_label("launches (%)")
    for axes in panels.flat:
        axes.plot(e, np.pi * q, "k-", path_effects=style.halo())
        axes.set(yscale="log", xlim=(e[0], e[-1]), ylim=(gamma[0], gamma[-1]))
        axes.set_yticks(TICKS, [f"{tick:g}" for tick in TICKS])
        axes.minorticks_off()
    for axes in panels[1]:
        axes.set_xlabel("restitution $e$")
    for axes in panels[:, 0]:
        axes.set_ylabel("acceleration of the base $\\Gamma$ (g)")
    return figure


@mpl.rc_context(style.RC)
def limit(gammas, curves):
    """Difference of landing times between the bases against Gamma, with its first order."""
    figure = Figure(figsize=(style.MEDIUM, 3.2), layout="constrained")
    axes = figure.add_subplot()
    for (u, off), colour in zip(curves.items(), style.colours(len(curves)), strict=True):
        axes.loglog(gammas, off[:, 0], "o", markersize=3, color=colour, label=f"$u_0 = {u:g}$")
        axes.loglog(gammas, off[:, -1], "s", markersize=3, color=colour, fillstyle="none")
        axes.loglog(gammas, gammas / (np.sqrt(2.0) * np.pi**2 * u), "-", color=colour)
    axes.set_xlabel("acceleration of the base $\\Gamma$ (g)")
    axes.set_ylabel("difference of landing times\n(rms, forcing periods)")
    style.head(axes, "first landing (dots), fourth (squares), first order (lines)", 3)
    return figure


@mpl.rc_context(style.RC)
def staircase(gammas, flights, marks):
    """Length of every flight of the completely inelastic ball on its attractor against Gamma."""
    figure = Figure(figsize=(style.PAGE, 3.2), layout="constrained")
    axes = figure.add_subplot()
    for (words, values), lines in zip(marks.items(), ("--", "-.", ":"), strict=True):
        axes.vlines(values, 0.0, 4.0, colors=style.GREY, linestyles=lines, lw=0.7, label=words)
    across = np.broadcast_to(gammas[:, np.newaxis], flights.shape)
    axes.plot(across, flights, ".", markersize=0.8, color=style.OKABE_ITO[0], rasterized=True)
    axes.set(xlim=(gammas[0], gammas[-1]), ylim=(0.0, 3.5))
    axes.set_xlabel("acceleration of the base $\\Gamma$ (g)")
    axes.set_ylabel("length of a flight\n(forcing periods)")
    style.head(axes, "completely inelastic ball, $e = 0$")
    return figure
