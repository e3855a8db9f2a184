"""The work-precision figure: one panel per scene, every method named beside its points."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from methods import compiled, moving
from methods.flights import SCIPY
from methods.scenes import Point, Scene


class Look(NamedTuple):
    """Colour (Okabe and Ito), marker, the name beside the points and where it stands."""

    colour: str
    marker: str
    label: str
    offset: tuple[float, float] = (7.0, 0.0)


LOOKS = {
    compiled.KERNEL: Look("#0072B2", "o", "kernel", (5.0, -10.0)),
    compiled.KERNEL_RECORD: Look("#0072B2", "s", "kernel, every landing", (-4.0, 11.0)),
    compiled.NAIVE: Look("#E69F00", "D", "naive map", (7.0, -3.0)),
    moving.SCALAR: Look("#E69F00", "D", "scalar loop", (6.0, -9.0)),
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


def draw(points: list[Point], scenes: Sequence[Scene], path: Path) -> None:
    """Draw scenes, two or three in a row, and write the file."""
    rows, columns = (2, 2) if len(scenes) == 4 else (1, len(scenes))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(5.0 * columns, 4.1 * rows), layout="constrained")
        axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        for letter, axis, scene in zip("abcd", axes.flat, scenes, strict=False):
            _panel(axis, [p for p in points if p.scene == scene.key])
            axis.set_title(f"({letter}) {scene.title}")
        for axis in axes[-1]:
            axis.set_xlabel("Largest landing-time error (s)")
        for axis in axes[:, 0]:
            axis.set_ylabel("Run time per impact (ns)")
        figure.savefig(path)


def _panel(axis: Axes, points: list[Point]) -> None:
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_xlim(1e-18, 1e5)
    axis.set_ylim(0.1, 2e7)
    axis.grid(which="major", color="0.9", linewidth=0.6)
    axis.set_axisbelow(True)
    for method, look in LOOKS.items():
        drawn = _of_method(points, method)
        if drawn:
            _series(axis, drawn, look)
    _steps(axis, _of_method(points, compiled.RK4))
    _state(axis, *_of_method(points, compiled.KERNEL), *_of_method(points, compiled.KERNEL_STATE))


def _of_method(points: list[Point], method: str) -> list[Point]:
    """Points of a method, on all its threads only."""
    found = [p for p in points if p.method == method]
    most = max((p.threads for p in found), default=0)
    return [p for p in found if p.threads == most]


def _series(axis: Axes, points: list[Point], look: Look) -> None:
    x = [p.error for p in points]
    y = [p.ns_per_impact for p in points]
    partial = points[0].partial
    axis.plot(
        x, y, color=look.colour, marker=look.marker, markersize=6, linewidth=1.2,
        markerfacecolor="white" if partial else look.colour,
    )  # fmt: skip
    place = len(x) // 2 if look.label == "RK4" else int(np.argmax(x))
    label = f"{look.label} (part of the orbit)" if partial else look.label
    _name(axis, label, points[place], look.offset)


def _name(
    axis: Axes, label: str, point: Point, offset: tuple[float, float], align: str = "left"
) -> None:
    axis.annotate(
        label, (point.error, point.ns_per_impact), xytext=offset, textcoords="offset points",
        color=TEXT, ha=align, va="center",
    )  # fmt: skip


def _steps(axis: Axes, points: list[Point]) -> None:
    """Name the coarsest and the finest step of RK4, where it takes part."""
    for point in points[:1] + points[1:][-1:]:
        exponent = round(np.log10(point.step))
        _name(axis, f"h = $10^{{{exponent}}}$ s", point, (7.0, 0.0))


def _state(axis: Axes, times: Point, state: Point) -> None:
    """The kernel's own state, open, where rounding it to one time costs accuracy."""
    if times.error < 3.0 * state.error:
        return
    axis.plot(
        [state.error, times.error], [state.ns_per_impact, times.ns_per_impact],
        color=LOOKS[compiled.KERNEL].colour, marker="o", markersize=6, linewidth=1.0,
        linestyle=":", markerfacecolor="white", zorder=1.9,
    )  # fmt: skip
    _name(axis, "its count\nand phase", state, (0.0, 16.0), "center")
