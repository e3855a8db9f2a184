"""Shared by the scripts that measure errors: kernel orbits, random scenes, and the report."""

from __future__ import annotations

import argparse
import platform
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numba import njit

from vibrosweep.kernels import bases
from vibrosweep.kernels.impact import Batch, base_of, impact, launch, launch_speed
from vibrosweep.model.parameters import PARAMETERS, Dimensionless, Launches, dimensionless, launches
from vibrosweep.store.writing import provenance as environment

REPORT = Path(__file__).parent / "README.md"
ULP = 2.0**-53  # spacing of doubles in [1/2, 1): one ulp of a turn


@njit(error_model="numpy", nogil=True)
def orbit(batch, i, capacity):
    """Landings of realization i: count from the end, phase, absolute speed that follows, rested.

    The speed is infinite where no flight follows.  The last entry is the landing after the end
    unless the capacity or a rest for good came first.  The second result is the number of landings
    up to the end.
    """
    problem = batch.problem
    fixed = bases.constants(batch.base, problem, i)
    found = np.empty((capacity, 4))
    n, x = launch(batch.launches, i, 0, problem.phase[i])
    n -= problem.end_count[i]
    u = launch_speed(fixed, problem, i, x)
    for k in range(capacity):
        hit = impact(fixed, n, x, u)
        found[k, 0], found[k, 1], found[k, 2], found[k, 3] = hit.n, hit.x, np.inf, 1.0
        if not hit.n <= problem.end_phase[i] - hit.x:
            return found[: k + 1], k
        n, x, u = hit.n_off, hit.x_off, hit.u
        if n == np.inf:
            return found[: k + 1], k + 1
        found[k, 2], found[k, 3] = bases.speed(fixed, x, u), 0.0 if hit.leaves else 1.0
    return found, capacity


def arrays_of(scene: Mapping[str, float]) -> dict[str, np.ndarray]:
    """The physical parameters of one scene, as the arrays that `dimensionless` takes."""
    return {name: np.array([float(scene[name])]) for name in PARAMETERS}


def batch_of(scenes: Sequence[Mapping[str, float]], law: str, base: str = "high-bounce") -> Batch:
    """Scenes, each with its own launch_time and duration, as one batch of single particles."""
    parts, starts = [], []
    for scene in scenes:
        given = arrays_of(scene)
        parts.append(dimensionless(given, scene["duration"], scene.get("transient", -np.inf)))
        starts.append(launches((scene["launch_time"],), 1, given["frequency"]))
    numbers = (one._replace(noise=None)[:-1] for one in parts)  # nothing is random here
    problem = Dimensionless(*(np.concatenate(field) for field in zip(*numbers, strict=True)))
    start = Launches(*(np.concatenate(field) for field in zip(*starts, strict=True)))
    return Batch(base_of(base, law), problem, start)


def bare_problem(e: np.ndarray, a: np.ndarray) -> Dimensionless:
    """Realizations of these restitutions and kicks; all other parameters are arbitrary."""
    given = {name: np.full(e.shape, p.default) for name, p in PARAMETERS.items()}
    # gravity 2 and frequency 1: an amplitude is its kick
    given |= {"restitution": e, "amplitude": a, "gravity": np.full(e.shape, 2.0)}
    return dimensionless(given, 0.0)


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows]
    return "\n".join(lines)


def processor() -> str:
    return str(environment(threads=1)["cpu"])


def provenance(seconds: float, seed: int | None) -> str:
    """Origin of a table: versions, processor, seed and time."""
    libraries = ", ".join(f"{n} {version(n)}" for n in ("numpy", "numba", "python-flint"))
    seeded = "" if seed is None else f"; seed {seed}"
    return (
        f"*Python {platform.python_version()}, {libraries}; {processor()}{seeded}; "
        f"{seconds:.0f} s.*"
    )


def options_of(text: str, *, write: bool = True, **arguments: object) -> argparse.Namespace:
    """Read the options of a script, given by their defaults, some with a text for --help."""
    parser = argparse.ArgumentParser(description=text.partition("\n")[0])
    for name, given in arguments.items():
        default, words = given if isinstance(given, tuple) else (given, None)
        parser.add_argument(f"--{name}", type=type(default), default=default, help=words)
    if write:
        parser.add_argument("--write", action="store_true", help="write the tables into the page")
    return parser.parse_args()


def show(options: argparse.Namespace, name: str, text: str, path: Path = REPORT) -> None:
    """Print a table, or write it into its page."""
    write_section(name, text, path) if options.write else print(text, "\n", flush=True)


def write_section(name: str, text: str, path: Path = REPORT) -> None:
    """Replace the section of a page between the two markers of that name."""
    page = path.read_text(encoding="utf-8")
    pattern = re.compile(rf"(<!-- begin {name} -->\n).*?(<!-- end {name} -->)", re.DOTALL)
    if not pattern.search(page):
        raise SystemExit(f"{path}: has no section {name!r}")
    page = pattern.sub(lambda found: f"{found[1]}{text.strip()}\n{found[2]}", page)
    path.write_text(page, encoding="utf-8")
    print(text)
