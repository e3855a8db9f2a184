"""Run time per impact against largest landing-time error, for this package and its rivals.

    python benchmarks/work_precision.py -o docs

writes ``work-precision.md``, ``work_precision.csv`` and ``images/work_precision.png``.  Errors are
against the proved reference.  heyoka and diffrax take part where they are installed.
"""

from __future__ import annotations

import argparse
import csv
import importlib
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from methods import compiled, flights
from methods.figure import draw
from methods.report import report
from methods.scenes import SCENES, Point, Scene
from methods.truth import Orbit, prove
from vibrosweep.sweep.run import available_threads

Method = Callable[[Scene, list[Orbit], int], Iterator[Point]]

# distribution, module and function; the module is loaded only if the distribution is there
OPTIONAL = (
    ("heyoka", "methods.taylor", "heyoka_events"),
    ("diffrax", "methods.jaxed", "diffrax_events"),
)

COLUMNS = (
    "scene", "method", "setting", "threads", "trajectories", "impacts", "ns_per_impact",
    "largest_error_s", "note",
)  # fmt: skip


def methods() -> tuple[list[Method], list[str]]:
    """What can run here, and the names of what is not installed."""
    found: list[Method] = [
        compiled.kernel, compiled.naive, flights.scipy_events, compiled.fixed_step
    ]  # fmt: skip
    missing = []
    for name, module, function in OPTIONAL:
        try:
            found.append(getattr(importlib.import_module(module), function))
        except ImportError:
            missing.append(name)
    return found, missing


def measure(found: list[Method], threads: int) -> tuple[list[Point], float]:
    """Every point of every scene, told as they come, and the error of the truth itself in s."""
    points, bound = [], 0.0
    for scene in SCENES:
        orbits = prove(scene)
        radius = max(orbit.radius for orbit in orbits)
        bound = max(bound, radius)
        print(f"{scene.title}: {scene.proved} orbits proved to {radius:.0e} s", flush=True)
        for method in found:
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("docs"), metavar="DIR")
    parser.add_argument("--threads", type=int, default=available_threads(), metavar="N")
    options = parser.parse_args()
    began, load = time.perf_counter(), os.getloadavg()[0]
    found, missing = methods()
    points, bound = measure(found, options.threads)
    images = options.output / "images"
    images.mkdir(parents=True, exist_ok=True)
    write_table(points, missing, options.output / "work_precision.csv")
    draw(points, images / "work_precision.png")
    minutes = (time.perf_counter() - began) / 60.0
    loads = (load, os.getloadavg()[0])
    text = report(points, missing, bound, options.threads, loads, minutes)
    (options.output / "work-precision.md").write_text(text, encoding="utf-8")
    print(f"{minutes:.1f} minutes; written to {options.output}")


if __name__ == "__main__":
    main()
