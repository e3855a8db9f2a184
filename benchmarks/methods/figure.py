"""The work-precision figure: one panel per scene, every method named beside its points."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from methods import compiled
from methods.flights import SCIPY
from methods.scenes import SCENES, Point


class Look(NamedTuple):
    """Colour (Okabe and Ito), marker, whether it is filled, and the name beside the points."""

    colour: str
    marker: str
    filled: bool
    label: str


LOOKS = {
    compiled.KERNEL: Look("#0072B2", "o", True, "kernel"),
    compiled.KERNEL_STATE: Look("#0072B2", "o", False, "kernel,\ncount and phase"),
    compiled.KERNEL_RECORD: Look("#0072B2", "s", True, "kernel, every landing"),
    compiled.NAIVE: Look("#E69F00", "D", True, "naive map"),
    compiled.RK4: Look("#000000", "v", True, "RK4"),
    SCIPY: Look("#CC79A7", "^", True, "SciPy events"),
    "heyoka.py": Look("#009E73", "P", True, "heyoka.py"),
    "diffrax": Look("#D55E00", "X", True, "diffrax"),
}

STYLE = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "savefig.dpi": 200,
}


def draw(points: list[Point], path: Path) -> None:
    """Draw all scenes and write the file."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(10.0, 8.2), layout="constrained")
        axes = figure.subplots(2, 2, sharex=True, sharey=True)
        for letter, axis, scene in zip("abcd", axes.flat, SCENES, strict=True):
            _panel(axis, [p for p in points if p.scene == scene.key])
            axis.set_title(f"({letter}) {scene.title}")
        for axis in axes[1]:
            axis.set_xlabel("Largest landing-time error (s)")
        for axis in axes[:, 0]:
            axis.set_ylabel("Run time per impact (ns)")
        figure.savefig(path)


def _panel(axis: Axes, points: list[Point]) -> None:
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_xlim(1e-17, 1e3)
    axis.set_ylim(0.4, 2e7)
    axis.grid(which="major", color="0.9", linewidth=0.6)
    axis.set_axisbelow(True)
    for method, look in LOOKS.items():
        drawn = _of_method(points, method)
        if drawn:
            _series(axis, drawn, look)
    _steps(axis, _of_method(points, compiled.RK4))


def _of_method(points: list[Point], method: str) -> list[Point]:
    """Points of a method, on all its threads only."""
    found = [p for p in points if p.method == method]
    most = max((p.threads for p in found), default=0)
    return [p for p in found if p.threads == most]


def _series(axis: Axes, points: list[Point], look: Look) -> None:
    x = np.array([p.error for p in points])
    y = np.array([p.ns_per_impact for p in points])
    axis.plot(
        x, y, color=look.colour, marker=look.marker, markersize=6, linewidth=1.2,
        markerfacecolor=look.colour if look.filled and not points[0].partial else "white",
    )  # fmt: skip
    partial = " (part of the orbit)" if points[0].partial else ""
    last = int(np.argmax(x)) if look.label != "RK4" else len(x) // 2
    axis.annotate(
        look.label + partial, (x[last], y[last]), xytext=(7, 0), textcoords="offset points",
        color=look.colour, va="center", annotation_clip=False,
    )  # fmt: skip


def _steps(axis: Axes, points: list[Point]) -> None:
    """Name the coarsest and the finest step of RK4."""
    for point in (points[0], points[-1]):
        axis.annotate(
            point.setting, (point.error, point.ns_per_impact), xytext=(7, 0),
            textcoords="offset points", va="center", fontsize=8,
        )  # fmt: skip
