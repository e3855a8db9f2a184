"""Pictures of docs/noise.md, checks/README.md and study/claims.md."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from vibrosweep.figures import style

WORDS = {
    "kick_noise": r"kick, $\sigma_V$ (m s$^{-1}$)",
    "drive_noise": r"drive, $\sigma_A$ (relative)",
    "restitution_noise": r"restitution, $\sigma_e$",
}


def against_strength(axes, kind):
    """Label an axis of the strength of a noise, whose range is too short for powers of ten."""
    axes.set(xscale="log", xlabel=WORDS[kind])
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())


@mpl.rc_context(style.RC)
def lifetimes(lives):
    """Mean lifetime of a lock against the strength of each kind of noise, with its interval."""
    figure = Figure(figsize=(style.PAGE, 2.6), layout="constrained")
    for axes, (kind, (values, (life, low, high))) in zip(
        figure.subplots(1, 3, sharey=True), lives.items(), strict=True
    ):
        known = np.isfinite(life)
        ends = [life[known] - low[known], high[known] - life[known]]
        axes.errorbar(
            values[known], life[known], ends,
            fmt="o", color=style.OKABE_ITO[0], markersize=3.0, capsize=2.0,
        )  # fmt: skip
        if not known.all():
            axes.plot(values[~known], low[~known], "^", color=style.GREY, label="at least")
        axes.set_yscale("log")
        against_strength(axes, kind)
        style.head(axes, "")
    figure.axes[0].set_ylabel("mean lifetime (periods)")
    return figure


@mpl.rc_context(style.RC)
def windows(amplitude, strengths, kept, ends):
    """Share of particles still locked against the amplitude, with the window without noise."""
    figure = Figure(figsize=(style.PAGE, 2.8), layout="constrained")
    axes = figure.subplots()
    for share, strength, colour in zip(kept.T, strengths, style.OKABE_ITO, strict=False):
        axes.plot(amplitude, share, color=colour, label=rf"$\sigma_V = {strength:g}$ m s$^{{-1}}$")
    for end, name in zip(ends, ("window without noise", ""), strict=True):
        axes.axvline(end, color="k", linewidth=0.8, linestyle="--", label=name)
    axes.set(xlabel=r"amplitude $A$ (m s$^{-1}$)", ylabel="share locked for 500 periods")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8.0)
    return figure


@mpl.rc_context(style.RC)
def energy(a, e, squares):
    """Mean square of the speed against the amplitude, with the random-phase approximation."""
    figure = Figure(figsize=(style.PAGE, 3.0), layout="constrained")
    axes = figure.subplots()
    for (sigma, found), colour in zip(squares.items(), style.OKABE_ITO, strict=False):
        axes.plot(a, found, ".", color=colour, label=rf"$\sigma = {sigma:g}$")
        axes.plot(a, (a * a / 2.0 + sigma**2) / (1.0 - e * e), color=colour, linewidth=0.8)
    axes.plot([], [], color="black", linewidth=0.8, label="random phases")
    axes.set(xscale="log", yscale="log", xlabel=r"amplitude $a$ ($g/2f$)")
    axes.set_ylabel(r"mean square speed $\langle u^2 \rangle$ ($(g/2f)^2$)")
    axes.legend(fontsize=8.0)
    return figure


@mpl.rc_context(style.RC)
def staggering(free):
    """Share of staggered pairs that never meet, against the strength of each kind of noise."""
    figure = Figure(figsize=(style.PAGE, 2.6), layout="constrained")
    for axes, (kind, (values, share)) in zip(
        figure.subplots(1, 3, sharey=True), free.items(), strict=True
    ):
        axes.plot(values, share, "o-", color=style.OKABE_ITO[0], markersize=3.0)
        axes.set_ylim(-0.05, 1.05)
        against_strength(axes, kind)
    figure.axes[0].set_ylabel("share of pairs that never meet")
    return figure
