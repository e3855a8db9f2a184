"""All methods on all scenes: which of them can run here, their points, and the table of these."""

from __future__ import annotations

import csv
import importlib.util
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from methods.scenes import Point, Scene
from methods.sweeps import Sweep
from methods.truth import Orbit, prove

Method = Callable[[Scene | Sweep, list[Orbit], int], Iterator[Point]]

COLUMNS = (
    "scene", "method", "setting", "threads", "trajectories", "impacts", "ns_per_impact",
    "largest_error_s", "note",
)  # fmt: skip


def available(optional: Sequence[tuple[str, str, str]]) -> tuple[list[Method], list[str]]:
    """Optional methods that can run here, and the distributions that are not installed.

    Parameters
    ----------
    optional
        Distribution, module and function; a module is loaded only if the distribution is there.
    """
    found, missing = [], []
    for name, module, function in optional:
        if importlib.util.find_spec(name) is None:
            missing += [name] if name not in missing else []
        else:
            found.append(getattr(importlib.import_module(module), function))
    return found, missing


def measure(
    scenes: Sequence[Scene | Sweep], methods: Sequence[Method], threads: int
) -> tuple[list[Point], float]:
    """Every point of every scene, told as they come, and the error of the truth itself in s."""
    points, bound = [], 0.0
    for scene in scenes:
        orbits = prove(scene)
        radius = max(orbit.radius for orbit in orbits)
        bound = max(bound, radius)
        print(f"{scene.title}: {scene.proved} orbits proved to {radius:.0e} s", flush=True)
        for method in methods:
            for point in method(scene, orbits, threads):
                print(
                    f"  {point.method:24} {point.setting:14} {point.ns_per_impact:12.4g} ns "
                    f"{point.error:10.2e} s  {point.note}",
                    flush=True,
                )
                points.append(point)
    return points, bound


def write_table(points: list[Point], missing: list[str], path: Path) -> None:
    """Every point, one row each; what is not installed has a row that says so."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for p in points:
            writer.writerow([
                p.scene, p.method, p.setting, p.threads, p.trajectories, p.impacts,
                f"{p.ns_per_impact:.4g}", f"{p.error:.3e}", p.note,
            ])  # fmt: skip
        for name in missing:
            writer.writerow(["", name, *[""] * 6, "not installed"])
