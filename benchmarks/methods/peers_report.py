"""The section on peers of docs/evidence.md, and its figure, from the stored table."""

from __future__ import annotations

import csv
import textwrap
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from accuracy import table, write_section
from methods.ensembles import NOTHING_SKIPPED, RECORD, STATISTICS
from methods.figure import STYLE, TEXT
from methods.scenes import SWEEPS

PAGE = Path(__file__).parents[2] / "docs" / "evidence.md"

Row = dict[str, str]

# method of a point: the name in the table and the figure, and the colour (Okabe and Ito)
NAMES = {
    STATISTICS: ("**vibrosweep**, statistics", "#0072B2"),
    NOTHING_SKIPPED: ("**vibrosweep**, nothing skipped", "#0072B2"),
    RECORD: ("**vibrosweep**, every landing recorded", "#56B4E9"),
    "naive map": ("scalar numba loop", "#E69F00"),
    "numpy": ("numpy over all trajectories", "#E69F00"),
    "pynamicalsys": ("pynamicalsys, ensemble call", "#000000"),
    "JAX": ("JAX, the map under `vmap`", "#D55E00"),
    "diffrax": ("diffrax, events under `vmap`", "#D55E00"),
    "heyoka.py": ("heyoka.py, Taylor series with events", "#009E73"),
    "SciPy solve_ivp": ("SciPy `solve_ivp` with events", "#CC79A7"),
}

ABOVE = """\
Random realizations of `sweeps/paper.toml`, the same for all (`python benchmarks/peers.py`):
"""

PICTURE = "![Time per landing of this package and its peers](images/peers.png)"

BELOW = """\
Errors are against proved trajectories: {proved}. vibrosweep and the numba loop use {threads}
threads, pynamicalsys the faster of one and {threads}, and the other methods one thread.
pynamicalsys, JAX and diffrax stop all trajectories of a batch together; their times include
impacts past the end. heyoka.py and SciPy run the proved trajectories only, diffrax runs 256
trajectories. Compilation is not included. {agreement}
"""

BARE = """\
The bare map, without rests and statistics, takes {ours:.2g} ns per impact on {threads} threads;
the ensemble call of pynamicalsys on as many threads takes {default:.0f} times as long with its
defaults, and {fastest:.0f} times as long at its fastest.
"""


def read_rows(path: Path) -> list[Row]:
    """Rows of the stored table."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _of(rows: list[Row], scene: str) -> dict[str, Row]:
    """Rows of a scene by method."""
    return {row["method"]: row for row in rows if row["scene"] == scene}


def peers_table(rows: list[Row]) -> str:
    """Markdown: one line per method, time and error in each scene."""
    scenes = [_of(rows, sweep.key) for sweep in SWEEPS]
    head = ["method"]
    for sweep in SWEEPS:
        head += [f"{sweep.title}: ns per landing", "largest error (s)"]
    lines = []
    for method, (name, _) in NAMES.items():
        cells = [name]
        for found in scenes:
            row = found.get(method)
            cells += [_short(row["ns_per_impact"]), _error(row)] if row else ["", ""]
        if any(cells[1:]):
            lines.append(cells)
    return table(head, lines)


def _short(number: str) -> str:
    """Two significant digits, without an exponent."""
    value = float(f"{float(number):.1e}")
    return f"{value:.2g}" if value < 10.0 else f"{value:,.0f}"


def _error(row: Row) -> str:
    mark = " (part of the landings)" if row["note"].startswith("first ") else ""
    return f"{float(row['largest_error_s']):.0e}{mark}"


def section(rows: list[Row], origin: str) -> str:
    """The whole section in Markdown."""
    proved = ", ".join(f"{sweep.proved} over {sweep.title}" for sweep in SWEEPS)
    threads = max(int(row["threads"]) for row in rows if row["threads"])
    below = BELOW.format(proved=proved, threads=threads, agreement=agreement(rows))
    paragraphs = [ABOVE, PICTURE, peers_table(rows), below, bare_sentence(rows), origin]
    return "\n\n".join(_wrapped(text) for text in paragraphs if text)


def publish(rows: list[Row], origin: str) -> None:
    """Replace the section of the page."""
    write_section("peers", section(rows, origin), PAGE)


def _wrapped(text: str) -> str:
    """A paragraph in lines of 100 characters; tables and pictures as they are."""
    return text if text[0] in "|!" else textwrap.fill(text, 100, break_on_hyphens=False)


def agreement(rows: list[Row]) -> str:
    """Say how many orbits rounding makes uncertain, and how far landing counts differ."""
    lost, apart = [], []
    for sweep in SWEEPS:
        found = _of(rows, sweep.key)
        counts = [
            int(r["impacts"]) for r in found.values() if int(r["trajectories"]) == sweep.lanes
        ]
        lost.append(f"{found[STATISTICS]['note']} over {sweep.title}")
        apart.append(f"{100.0 * (max(counts) - min(counts)) / max(counts):.1g} %")
    return (
        f"Chaotic orbits amplify rounding in every method: {', '.join(lost)}. "
        f"The numbers of landings found by the methods differ by {' and '.join(apart)} at most."
    )


def bare_sentence(rows: list[Row]) -> str:
    """Sentence on the bare map and pynamicalsys; empty if that was not measured."""
    bare = {row["setting"]: row for row in rows if row["scene"] == "bare"}
    if not bare:
        return ""
    ours, default, fastest = (
        float(bare[setting]["ns_per_impact"]) for setting in ("", "default", "fastest")
    )
    threads = bare[""]["threads"]
    return BARE.format(ours=ours, threads=threads, default=default / ours, fastest=fastest / ours)


def draw(rows: list[Row], path: Path) -> None:
    """Draw the time of every method, with its error next to it, in one panel per scene."""
    least = min(float(r["ns_per_impact"]) for s in SWEEPS for r in _of(rows, s.key).values())
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(10.0, 3.6), layout="constrained")
        axes = figure.subplots(1, len(SWEEPS), sharey=True)
        for letter, axis, sweep in zip("ab", axes, SWEEPS, strict=True):
            _panel(axis, _of(rows, sweep.key))
            axis.set_xlim(10.0 ** np.floor(np.log10(least) - 0.5), 1e8)
            axis.set_title(f"({letter}) {sweep.title}")
        figure.savefig(path, dpi=130)


def _panel(axis: Axes, found: dict[str, Row]) -> None:
    axis.set_xscale("log")
    axis.grid(axis="x", color="0.9", linewidth=0.6)
    axis.set_axisbelow(True)
    for place, (method, (_, colour)) in enumerate(NAMES.items()):
        if method in found:
            ns, error = (float(found[method][c]) for c in ("ns_per_impact", "largest_error_s"))
            axis.hlines(place, 1e-9, ns, color=colour, linewidth=1.0)
            axis.plot(ns, place, "o", color=colour, markersize=6)
            axis.annotate(
                f"{error:.0e} s", (ns, place), xytext=(8.0, 0.0), textcoords="offset points",
                va="center", fontsize=8, color=TEXT,
            )  # fmt: skip
    names = [name.replace("*", "").replace("`", "") for name, _ in NAMES.values()]
    axis.set_yticks(range(len(names)), names)
    axis.set_ylim(len(names) - 0.5, -0.5)
    axis.set_xlabel("Time per landing (ns), and the largest error")
