"""The lines of Python that make the pictures of a page."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import Any, Final

from vibrosweep.explore.choice import Choice
from vibrosweep.explore.pictures import DOTS, HEIGHT
from vibrosweep.explore.points import Points
from vibrosweep.store.reading import KINDS, SWEEP

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
