"""The work-precision figure: one panel per scene, with one legend of all methods."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from methods import compiled
from methods.finals import Row
from methods.flights import SCIPY
from methods.scenes import Scene


class Look(NamedTuple):
    """Colour (Okabe and Ito), marker and name."""

    colour: str
    marker: str
    label: str


LOOKS = {
    compiled.KERNEL: Look("#0072B2", "o", "kernel"),
    compiled.KERNEL_RECORD: Look("#0072B2", "s", "kernel, every landing"),
    compiled.NAIVE: Look("#E69F00", "D", "naive map"),
    compiled.SCALAR: Look("#E69F00", "H", "scalar loop"),
    compiled.RK4: Look("#000000", "v", "RK4"),
    SCIPY: Look("#CC79A7", "^", "SciPy events"),
    "heyoka.py": Look("#009E73", "P", "heyoka.py"),
    "diffrax": Look("#D55E00", "X", "diffrax"),
}
TEXT = "0.15"

STYLE = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "savefig.dpi": 200,
}


def draw(rows: list[Row], scenes: Sequence[Scene], path: Path) -> None:
    """Draw scenes, three in a row, and write the file."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(13.5, 3.6 * len(scenes) / 3), layout="constrained")
        axes = figure.subplots(len(scenes) // 3, 3, sharex=True, sharey=True)
        for letter, axis, scene in zip("abcdefghi", axes.flat, scenes, strict=True):
            _panel(axis, [row for row in rows if row["scene"] == scene.key])
            axis.set_title(f"({letter}) {scene.title}")
        for axis in axes[-1]:
            axis.set_xlabel("Error of the last landing (s)")
        for axis in axes[:, 0]:
            axis.set_ylabel("Processor time\nper landing (ns)")
        handles = [
            Line2D([], [], color=look.colour, marker=look.marker, linewidth=1.2, label=look.label)
            for look in LOOKS.values()
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=len(LOOKS), frameon=False)
        figure.savefig(path)


def _panel(axis: Axes, rows: list[Row]) -> None:
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_xlim(1e-16, 1e3)
    axis.set_ylim(0.3, 2e7)
    axis.grid(which="major", color="0.9", linewidth=0.6)
    axis.set_axisbelow(True)
    for method, look in LOOKS.items():
        found = [row for row in rows if row["method"] == method]
        y, x = (
            np.array([float(row[name]) for row in found])
            for name in ("ns_per_impact", "last_landing_error_s")
        )
        if not np.isfinite(x).any():
            continue
        axis.plot(
            x, y, color=look.colour, marker=look.marker, markersize=7, linewidth=1.2,
            markeredgecolor="white", markeredgewidth=0.4,
        )  # fmt: skip
