"""Text of a page: facts of a realization, Python lines of a picture, tables of points."""

from __future__ import annotations

import csv
import html
import io
import textwrap
from array import array
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np
import xarray as xr
from matplotlib.path import Path as Outline
from numpy.typing import NDArray

from vibrosweep.abilities import refusal
from vibrosweep.arrays import Array
from vibrosweep.errors import VibrosweepError
from vibrosweep.explorer.pictures import DOTS, HEIGHT, are_numbers, is_window
from vibrosweep.explorer.points import LAUNCHED, SYMBOLS, Choice, Points, meanings, units_text
from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.measures import known
from vibrosweep.model.parameters import SPRUNG
from vibrosweep.store.reading import KINDS, SWEEP


def parameters_line(choice: Choice) -> str:
    """Write the base and the parameters of a choice in one line."""
    parts = []
    for name, value in choice.scene.inputs.items():
        unit = units_text(INPUTS[name].units)
        parts.append(f"{SYMBOLS[name]} = {value:.5g}{unit and f' {unit}'}")
    return ", ".join([f"{choice.scene.base} base", *parts])


def facts(
    choice: Choice, measured: xr.Dataset, settled: xr.Dataset | None
) -> Iterator[tuple[str, str]]:
    """Yield names and values of the properties of a realization."""
    one = measured.isel(realization=0)
    begin, end = (float(one[n]) * choice.inputs["frequency"] for n in ("transient", "duration"))
    yield "base", choice.scene.base
    yield "acceleration of the base Γ", f"{float(one['base_acceleration']):.5g} g"
    yield "observed", f"{f'{begin:.6g} to ' if begin > 0.0 else ''}{end:.6g} forcing periods"
    if choice.scene.base == SPRUNG:
        joint = one["joint_regime"]
        yield "joint regime", meanings(joint.attrs)[int(joint)]
        yield "largest Lyapunov exponent per period", _number(one["joint_exponent"])
    yield "largest rebound height", _number(one["rebound_height_max"], " m")
    if choice.scene.particles > 1:
        yield "smallest separation Δt min", _number(one["dt_min"], " s")
        shared = {1: "yes", 0: "no"}.get(int(one["base_shared"]), "not known")
        yield "two particles on the base at once", shared
    if settled is not None:
        one = settled.isel(realization=0)
        periods = float(one["duration"]) * choice.inputs["frequency"]
        yield f"regimes after {periods:.6g} periods", ", ".join(_regimes(one))
        yield "largest Lyapunov exponent per impact", _range(one["lyapunov_largest"].values)
        yield "orbits, slots", ", ".join(_number(one[n]) for n in ("orbit_count", "slot_count"))


def facts_html(choice: Choice) -> str:
    """Write the facts of a realization as a table, or the reason why they cannot be computed."""
    try:
        refused = refusal(choice.scene.base, measure="regimes")
        settled = None if refused else choice.settle()
        found = list(facts(choice, choice.observe(), settled))
    except VibrosweepError as error:
        return html.escape(str(error))
    rows = (f"<tr><td>{html.escape(a)}</td><td>{html.escape(b)}</td></tr>" for a, b in found)
    return f"<table>{''.join(rows)}</table>"


def _regimes(one: xr.Dataset) -> Iterator[str]:
    """Yield the number of particles in each regime, with the cycle that they follow."""
    names = ("regime", "cycle_impacts", "cycle_periods")
    regimes = meanings(one["regime"].attrs)
    kinds = Counter(zip(*(one[name].values.tolist() for name in names), strict=True))
    for (regime, impacts, periods), count in kinds.most_common():
        cycle = (
            f" ({_some(impacts, 'impact')} in {_some(periods, 'period')})" if impacts > 0 else ""
        )
        yield f"{count} {regimes.get(regime, 'not known')}{cycle}"


def _some(number: int, thing: str) -> str:
    return f"{number} {thing}{'' if number == 1 else 's'}"


def _number(value: xr.DataArray, units: str = "") -> str:
    held = known(str(value.name), {value.name: value})
    return f"{float(value):.5g}{units}" if held else "not known"


def _range(values: np.ndarray) -> str:
    numbers = values[~np.isnan(values)]
    if not numbers.size:
        return "not known"
    low, high = float(numbers.min()), float(numbers.max())
    texts = [("-∞" if v == -np.inf else f"{v:.5g}") for v in (low, high)]
    return texts[0] if low == high else f"{texts[0]} to {texts[1]}"


WIDTH: Final = 79
LEADING: Final = "import vibrosweep as vs\n"
PLOT: Final = "import matplotlib.pyplot as plt\n"
PICTURES: Final = (HEIGHT, *DOTS)


def motion_lines(choice: Choice, picture: str) -> str:
    """Lines that simulate a realization and draw one of `PICTURES`."""
    before, after = around(picture)
    return f"{before}{simulation(choice)}{after}"


def simulation(choice: Choice) -> str:
    """Return the call that simulates a realization."""
    return call("vs.simulate", choice.keywords())


def around(picture: str) -> tuple[str, str]:
    """Lines before and after the call of `simulation` that draw one of `PICTURES`."""
    if picture == HEIGHT:
        drawn = "\nvs.figures.height_time(record)\n"
        return f"{PLOT}{LEADING}\nrecord = ", f'{drawn}plt.savefig("height.png")\n'
    dots = DOTS[picture]
    name, scale = dots.analysis.__name__, ', yscale="log"' if dots.log else ""
    return f"{PLOT}{LEADING}\nrecord = ", (
        f"\ndrawn = vs.analysis.{name}(record)\n"
        f"figure, axes = plt.subplots()\n"
        f"axes.scatter(drawn.{dots.x}, drawn.{dots.y}, c=drawn.particle, s=4)\n"
        f'axes.set(xlabel="{dots.x_label}", ylabel="{dots.y_label}"{scale})\n'
        f'figure.savefig("{name}.png")\n'
    )


def plane_lines(points: Points, x: str, y: str, colour: str) -> str:
    """Lines that draw the plane of a result."""
    path = str(points.path)
    if points.kind != SWEEP.name:
        return (
            f"{PLOT}import xarray as xr\n{LEADING}\n"
            f'found = xr.load_dataset({path!r}, engine="h5netcdf")\n'
            f'vs.figures.{KINDS[points.kind].stem}(found)\nplt.savefig("plane.png")\n'
        )
    number = '\nfound["number"] = ("realization", range(found.sizes["realization"]))'
    return (
        f"{PLOT}{LEADING}\n"
        f"found = vs.analysis.flat(vs.open_sweep({path!r}))"
        f"{number if 'number' in (x, y, colour) else ''}\n"
        f"figure, axes = plt.subplots()\n"
        f"drawn = axes.scatter(found[{x!r}], found[{y!r}], c=found[{colour!r}], s=8)\n"
        f"figure.colorbar(drawn, label={colour!r})\n"
        f"axes.set(xlabel={x!r}, ylabel={y!r})\n"
        f'figure.savefig("plane.png")\n'
    )


def table_lines(points: Points, name: str) -> str:
    """Lines that compute the realizations of a table."""
    shared = points.base_choice
    inputs = {n: v for n, v in shared.inputs.items() if points.varied}
    keywords = {"design": name, **inputs, **shared.sweep_keywords()}
    return f"{LEADING}\nfound = {call('vs.sweep', keywords)}\n"


def call(function: str, keywords: Mapping[str, Any]) -> str:
    """Return a call with one keyword in each line."""
    lines = [f"{function}("]
    for name, value in keywords.items():
        text = textwrap.wrap(f"{name}={value!r},", WIDTH - 4, subsequent_indent="    ")
        lines += [f"    {line}" for line in text]
    return "\n".join([*lines, ")"])


Rows = NDArray[np.int64]
TABLE: Final = "selection.csv"  # file name that a browser saves it under


def table(points: Points, rows: Rows) -> str:
    """CSV with the varied parameters of points; numbers keep every bit.

    Points of the same realization, such as the impacts of a bifurcation diagram, share one row.
    """
    names = table_columns(points)
    values = [points.columns[name].values[rows].tolist() for name in names]
    if not names:  # a single realization: every parameter is fixed
        inputs = points.base_choice.scene.inputs
        names, values = [*inputs], [[value] for value in inputs.values()]
    written = io.StringIO()
    writer = csv.writer(written, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(dict.fromkeys(zip(*values, strict=True)))
    return written.getvalue()


def table_columns(points: Points) -> list[str]:
    """Names of the columns of a table of points."""
    return [name for name in (*points.varied, LAUNCHED) if name in points.columns]


def enclosed(outline: Any, x: Array, y: Array) -> Rows | None:
    """Indices of the points within an outline from a browser; None for any other data."""
    if outline.get("type") == "rect":
        x0, x1, y0, y1 = (outline.get(name) for name in ("x0", "x1", "y0", "y1"))
        return in_rectangle(x, y, x0, x1, y0, y1) if is_window(x0, x1, y0, y1) else None
    sent = [outline.get(name) for name in "xy"]
    # Bokeh passes on arrays of numpy or of the standard library, whatever the browser sent
    corners = [v.tolist() if isinstance(v, np.ndarray | array) else v for v in sent]
    pairs = list(zip(*corners, strict=False)) if all(isinstance(v, list) for v in corners) else []
    if not pairs or not are_numbers(*(number for pair in pairs for number in pair)):
        return None
    return in_polygon(x, y, *np.array(pairs, np.float64).T)


def in_rectangle(x: Array, y: Array, x0: float, x1: float, y0: float, y1: float) -> Rows:
    """Indices of the points within a rectangle."""
    return np.flatnonzero((x >= x0) & (x <= x1) & (y >= y0) & (y <= y1))


def in_polygon(x: Array, y: Array, corners_x: Array, corners_y: Array) -> Rows:
    """Indices of the points within a polygon, by the even-odd rule."""
    box = (corners_x.min(), corners_x.max(), corners_y.min(), corners_y.max())
    near = in_rectangle(x, y, *box)
    polygon = Outline(np.column_stack([corners_x, corners_y]))
    inside: NDArray[np.bool_] = polygon.contains_points(np.column_stack([x[near], y[near]]))
    return np.asarray(near[inside])
