"""Processor time and memory of whole sweeps against their work, and what Dask adds to a chunk.

    python benchmarks/cost.py

writes ``cost.md``, ``cost.csv``, and ``cost.png`` in ``images``.  Every point is a sweep from its
ranges to its result file, on one thread.  Time is processor time, which other programs disturb
little; memory is the largest that its arrays take at once.
"""

from __future__ import annotations

import argparse
import csv
import os
import statistics
import tempfile
import time
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
from matplotlib.figure import Figure

from conftest import processor_seconds
from methods.figure import STYLE
from vibrosweep.api.sweeps import as_sweep
from vibrosweep.runs.cluster import local_workers, on_dask
from vibrosweep.runs.driver import run_sweep
from vibrosweep.scene.sweep import Sweep
from vibrosweep.store.writing import provenance

RANGES = {"restitution": (0.80, 0.98), "amplitude": (0.2, 3.5)}
# Numbers of realizations, particles and periods of the sweeps of each line
LINES: dict[str, list[tuple[int, int, int]]] = {
    "realizations": [(n, 20, 12) for n in (1, 10, 100, 1000, 10_000, 100_000, 1_500_000)],
    "particles": [(10, n, 12) for n in (1, 10, 100, 1000, 10_000, 100_000, 1_000_000)],
    "periods": [(200, 20, n) for n in (12, 120, 1200, 12_000, 90_000)],
    "periods, without skips": [(200, 20, n) for n in (12, 120, 1200, 12_000, 90_000)],
}
LOOKS = {
    "realizations": ("#0072B2", "o"),
    "particles": ("#E69F00", "s"),
    "periods": ("#009E73", "^"),
    "periods, without skips": ("#D55E00", "v"),
}
QUICK = 0.5  # s; shorter measurements are repeated
CHUNKS = (16, 64)  # numbers of chunks of a small sweep, whose difference gives the cost of one


class Point(NamedTuple):
    """Cost of a sweep."""

    line: str
    realizations: int
    particles: int
    periods: int
    impacts: int
    seconds: float  # of processor time
    mebibytes: float


class Chunked(NamedTuple):
    """Cost of a chunk beside its computation, and the time before the first chunk."""

    where: str
    start: float  # s of wall time, until the workers can compute
    each: float  # s of wall time for a chunk that computes next to nothing


def sweep_of(line: str, realizations: int, particles: int, periods: int) -> Sweep:
    """Return the sweep of a point, at 1 Hz."""
    given = {**RANGES, "realizations": realizations, "particles": particles}
    sweep = as_sweep({**given, "duration_periods": float(periods)}, {})
    return replace(sweep, scene=replace(sweep.scene, skip="without" not in line))


def points(folder: Path) -> Iterator[Point]:
    """Measure every point."""
    for line, sizes in LINES.items():
        for size in sizes:
            sweep, took = sweep_of(line, *size), []
            run_sweep(sweep, folder / "out.h5", threads=1, force=True)  # loads its kernels
            while not took or (sum(took) < QUICK and len(took) < 15):
                began = processor_seconds()
                found = run_sweep(sweep, folder / "out.h5", threads=1, force=True)
                took.append(processor_seconds() - began)
            tracemalloc.start()
            run_sweep(sweep, folder / "out.h5", threads=1, force=True)
            peak = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            yield Point(line, *size, found.landings, statistics.median(took), peak / 2**20)


def chunked(folder: Path) -> Iterator[Chunked]:
    """Measure what chunks cost in this process, and on one and two workers of Dask."""
    sweep = sweep_of("realizations", CHUNKS[-1], 1, 12)

    def each(**options: object) -> float:
        took = []
        for chunks in CHUNKS:
            began = time.perf_counter()
            size = CHUNKS[-1] // chunks
            run_sweep(sweep, folder / "out.h5", threads=1, force=True, chunk=size, **options)
            took.append(time.perf_counter() - began)
        return (took[1] - took[0]) / (CHUNKS[1] - CHUNKS[0])

    yield Chunked("this process", 0.0, statistics.median(each() for _ in range(5)))
    for workers in (1, 2):
        began = time.perf_counter()
        with local_workers(workers) as client:
            runner = on_dask(client)
            each(runner=runner)  # workers load the kernels
            start = time.perf_counter() - began
            rest = statistics.median(each(runner=runner) for _ in range(5))
            yield Chunked(f"Dask, {workers} worker{'s' * (workers > 1)}", start, rest)


def draw(found: list[Point], path: Path) -> None:
    """Draw seconds and memory against impacts."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(10.0, 4.1), layout="constrained")
        axes = figure.subplots(1, 2, sharex=True)
        for line, (colour, marker) in LOOKS.items():
            some = [point for point in found if point.line == line]
            impacts = [point.impacts for point in some]
            for axis, name in zip(axes, ("seconds", "mebibytes"), strict=True):
                costs = [getattr(point, name) for point in some]
                axis.loglog(impacts, costs, color=colour, marker=marker, ms=4, lw=1, label=line)
        axes[0].set_title("(a) Processor time")
        axes[0].set_ylabel("Processor time (s)")
        axes[1].set_title("(b) Memory of arrays")
        axes[1].set_ylabel("Memory (MiB)")
        for axis in axes:
            axis.set_xlabel("Impacts")
            axis.grid(color="0.92", lw=0.6)
        axes[0].legend(frameon=False, title="More of", alignment="left")
        figure.savefig(path)


def report(found: list[Point], chunks: list[Chunked], load: float) -> str:
    """Return the page, whose numbers are all measured."""
    rows = [
        f"| {p.line} | {p.realizations} | {p.particles} | {p.periods} | {p.impacts:.3g} "
        f"| {p.seconds:.3g} | {1e9 * p.seconds / p.impacts:.3g} | {p.mebibytes:.3g} |"
        for p in found
    ]
    of_chunks = [f"| {c.where} | {c.start:.2g} | {1e3 * c.each:.2g} |" for c in chunks]
    dask = chunks[-1]  # on two workers
    text = (Path(__file__).parent / "cost.template.md").read_text(encoding="utf-8")
    return text.format(
        processor=provenance(threads=1)["cpu"],
        date=datetime.now(UTC).date().isoformat(),
        load=load,
        points="\n".join(rows),
        chunks="\n".join(of_chunks),
        pays=2.0 * dask.start,
        start=dask.start,
        milliseconds=1e3 * dask.each,
        busy=int(1.0 / dask.each),
        threads=5 * int(1.0 / dask.each),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).parent, metavar="DIR")
    options = parser.parse_args()
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder:
        chunks = list(chunked(Path(folder)))
        found = list(points(Path(folder)))
    (options.output / "images").mkdir(parents=True, exist_ok=True)
    draw(found, options.output / "images" / "cost.png")
    with (options.output / "cost.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(Point._fields)
        writer.writerows(found)
    text = report(found, chunks, load)
    (options.output / "cost.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
