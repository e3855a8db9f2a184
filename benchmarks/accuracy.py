"""Shared by the scripts that measure errors: kernel orbits, random scenes, and the report."""

from __future__ import annotations

import platform
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numba import njit

from vibrosweep.kernels.impact import land, launch, lift_off, rebound
from vibrosweep.scene import PARAMETERS, Dimensionless, Launches, dimensionless, launches

REPORT = Path(__file__).parents[1] / "docs" / "accuracy.md"
LAWS = {"rest": None, "reflect": 1}
ULP = 2.0**-53  # spacing of doubles in [1/2, 1): one ulp of a turn


@njit(error_model="numpy", nogil=True)
def orbit(problem, start, i, reflect, capacity):
    """Landings of realization i: count from the end, phase, flight that follows, rested.

    The flight is infinite where none follows.  The last entry is the landing after the end unless
    the capacity or a rest for good came first: the second value counts the landings inside.
    """
    e, a, r = problem.restitution[i], problem.kick[i], problem.rest_flight[i]
    wait, u_lift = (0.0, r) if a > r else (np.inf, 0.0)
    found = np.empty((capacity, 4))
    n, x = launch(problem, start, i, 0)
    n -= problem.end_count[i]
    u = problem.launch_flight[i]
    for k in range(capacity):
        x, passed = land(x, u)
        n += passed
        w = rebound(x, u, e, a, reflect)
        found[k, 0], found[k, 1], found[k, 2], found[k, 3] = n, x, np.inf, 1.0
        if not n <= problem.end_phase[i] - x:
            return found[: k + 1], k
        n, x, u, leaves = lift_off(n, x, w, r, problem.liftoff_phase[i], wait, u_lift)
        if n == np.inf:
            return found[: k + 1], k + 1
        found[k, 2], found[k, 3] = u, 0.0 if leaves else 1.0
    return found, capacity


def arrays_of(scene: Mapping[str, float]) -> dict[str, np.ndarray]:
    """The physical parameters of one scene, as the arrays that `dimensionless` takes."""
    return {name: np.array([float(scene[name])]) for name in PARAMETERS}


def problem_of(scenes: Sequence[Mapping[str, float]]) -> tuple[Dimensionless, Launches]:
    """Scenes, each with its own launch_time and duration, as one batch of single particles."""
    parts, starts = [], []
    for scene in scenes:
        given = arrays_of(scene)
        parts.append(dimensionless(given, scene["duration"], scene.get("transient", -np.inf)))
        starts.append(launches((scene["launch_time"],), 1, given["frequency"]))
    problem = Dimensionless(*(np.concatenate(field) for field in zip(*parts, strict=True)))
    return problem, Launches(*(np.concatenate(field) for field in zip(*starts, strict=True)))


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows]
    return "\n".join(lines)


def processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((n.partition(":")[2].strip() for n in lines if n.startswith("model name")), "")


def provenance(seconds: float, seed: int | None) -> str:
    """What computed a table: versions, processor, seed and time."""
    libraries = ", ".join(f"{n} {version(n)}" for n in ("numpy", "numba", "python-flint"))
    seeded = "" if seed is None else f"; seed {seed}"
    return (
        f"*Python {platform.python_version()}, {libraries}; {processor()}{seeded}; "
        f"{seconds:.0f} s.*"
    )


def write_section(name: str, text: str, path: Path = REPORT) -> None:
    """Replace the section between the two markers of that name in a page."""
    page = path.read_text(encoding="utf-8")
    pattern = re.compile(rf"(<!-- begin {name} -->\n).*?(<!-- end {name} -->)", re.DOTALL)
    if not pattern.search(page):
        raise SystemExit(f"{path}: has no section {name!r}")
    page = pattern.sub(lambda found: f"{found[1]}{text.strip()}\n{found[2]}", page)
    path.write_text(page, encoding="utf-8")
    print(text)
