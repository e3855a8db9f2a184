"""All methods on all scenes: those that can run here, their points, and the table of points."""

from __future__ import annotations

import csv
import importlib.util
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from methods.scenes import Point, Scene, Sweep
from methods.truth import prove, worst

# takes a scene, the number of landings wanted of each proved trajectory, and threads
Method = Callable[[Scene | Sweep, list[int], int], Iterator[Point]]

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


def measure(sweeps: Sequence[Sweep], methods: Sequence[Method], threads: int) -> list[Point]:
    """Every point of every sweep, with the largest error of any landing."""
    points = []
    for sweep in sweeps:
        orbits = prove(sweep)
        for point in timings(sweep, [orbit.size for orbit in orbits], methods, threads):
            error, missing = worst(orbits, point.times)
            note = point.note if point.partial else missing or point.note
            points.append(replace(point, error=error, note=note))
    return points


def timings(
    scene: Scene | Sweep, sizes: list[int], methods: Sequence[Method], threads: int
) -> Iterator[Point]:
    """Points of a scene without errors, printed as they come."""
    print(scene.title, flush=True)
    for method in methods:
        for point in method(scene, sizes, threads):
            told = f"{point.method:24} {point.setting:36} {point.ns_per_impact:12.4g} ns"
            print(f"  {told}  {point.note}", flush=True)
            yield point


def write_table(points: list[Point], missing: list[str], path: Path) -> None:
    """Write one row for each point, and one for each library that is not installed."""
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
