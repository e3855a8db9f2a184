"""The lines of Python that make the pictures of a page."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import Any, Final

from vibrosweep.explore.choice import Choice
from vibrosweep.explore.points import Points

WIDTH: Final = 79
LEADING: Final = "import vibrosweep as vs"
PLOT: Final = "import matplotlib.pyplot as plt"

# What is drawn of a record, by the name of the picture
PICTURES: Final[Mapping[str, str]] = {
    "height": """
from vibrosweep.figures import height_time

figure = height_time(record)
figure.savefig("height.png")
""",
    "return map": """
from vibrosweep.explore.pictures import return_map

drawn = return_map(record)
figure, axes = plt.subplots()
axes.scatter(drawn["speed"], drawn["next"], c=drawn["particle"], s=4)
axes.set(xlabel="arrival speed (m/s)", ylabel="next arrival speed (m/s)")
figure.savefig("return_map.png")
""",
    "phases": """
from vibrosweep.explore.pictures import landing_phases

drawn = landing_phases(record)
figure, axes = plt.subplots()
axes.scatter(drawn["time"], drawn["phase"], c=drawn["particle"], s=4)
axes.set(xlabel="time (s)", ylabel="phase of landing (turns)")
figure.savefig("phases.png")
""",
    "separations": """
from vibrosweep.explore.pictures import separations

drawn = separations(record)
figure, axes = plt.subplots()
axes.scatter(drawn["time"], drawn["gap"], c=drawn["particle"], s=4)
axes.set(xlabel="time (s)", ylabel="time since another landed (s)", yscale="log")
figure.savefig("separations.png")
""",
}

_DRAWINGS: Final[Mapping[str, tuple[str, str]]] = {
    "windows": ("stability_windows", "stability_windows"),
    "bifurcation": ("bifurcation", "bifurcation_diagram"),
    "basins": ("basins", "basins_of_attraction"),
}


def motion_lines(choice: Choice, picture: str) -> str:
    """Lines that simulate a realization and draw one of `PICTURES`."""
    before, after = around(picture)
    return f"{before}{simulation(choice)}{after}"


def simulation(choice: Choice) -> str:
    """Return the call that simulates a realization."""
    return call("vs.simulate", choice.keywords())


def around(picture: str) -> tuple[str, str]:
    """Lines before and after the call of `simulation` that draw one of `PICTURES`."""
    body = PICTURES[picture]
    imports = [PLOT] if "plt." in body else []
    taken, _, rest = body.strip().partition("\n\n")
    top = "\n".join([*imports, LEADING, taken])
    return f"{top}\n\nrecord = ", f"\n{rest}\n"


def plane_lines(points: Points, x: str, y: str, colour: str) -> str:
    """Lines that draw the plane of a result."""
    path = str(points.path)
    if points.kind in _DRAWINGS:
        module, draw = _DRAWINGS[points.kind]
        return (
            f"import xarray as xr\n"
            f"from vibrosweep.figures.{module} import {draw}\n\n"
            f'found = xr.load_dataset({path!r}, engine="h5netcdf")\n'
            f'{draw}(found).savefig("plane.png")\n'
        )
    names = [name for name in (x, y, colour) if name == "number"]
    index = '\nfound["number"] = ("realization", range(found.sizes["realization"]))'
    return (
        f"{PLOT}\n{LEADING}\n"
        f"from vibrosweep.store.rows import flat\n\n"
        f"found = flat(vs.open_sweep({path!r})){index if names else ''}\n"
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
    return f"{LEADING}\n\nfound = {call('vs.sweep', keywords)}\n"


def call(function: str, keywords: Mapping[str, Any]) -> str:
    """Return a call with one keyword in each line."""
    lines = [f"{function}("]
    for name, value in keywords.items():
        text = textwrap.wrap(f"{name}={value!r},", WIDTH - 4, subsequent_indent="    ")
        lines += [f"    {line}" for line in text]
    return "\n".join([*lines, ")"])
