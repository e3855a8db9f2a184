"""This package and its peers side by side: time per landing and error of landing times.

    python benchmarks/peers.py [--threads N]

writes ``benchmarks/peers.csv``, ``docs/images/peers.png`` and the section between the markers of
``docs/evidence.md``.  All run the same scenes (`methods.scenes.SWEEPS`) and find the same landings;
errors are against the proved reference.  A peer takes part where it is installed (extra ``bench``).
"""

from __future__ import annotations

import argparse
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from methods import compiled, ensembles, flights
from methods.contest import available, measure, write_table
from methods.peers_report import draw, publish, read_rows
from methods.scenes import SWEEPS, Point
from vibrosweep.runs.driver import available_threads
from vibrosweep.store.writing import provenance

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "benchmarks" / "peers.csv"
PICTURE = ROOT / "docs" / "images" / "peers.png"
LIBRARIES = ("numpy", "numba", "scipy", "pynamicalsys", "jax", "diffrax", "heyoka")
OPTIONAL = (
    ("pynamicalsys", "methods.dynamical", "ensemble"),
    ("diffrax", "methods.jaxed", "jax_map"),  # its module imports diffrax, too
    ("diffrax", "methods.jaxed", "diffrax_events"),
    ("heyoka", "methods.taylor", "heyoka_events"),
)


def bare_points(threads: int, missing: list[str]) -> list[Point]:
    """Points of the bare map and of pynamicalsys; none if that is not installed."""
    if "pynamicalsys" in missing:
        return []
    from methods.dynamical import bare_points

    return bare_points(threads)


def origin(threads: int, missing: list[str]) -> str:
    """Describe processor and versions, and name the libraries that are not installed."""
    known = provenance(threads)
    there = [name for name in LIBRARIES if find_spec(name) is not None]
    versions = ", ".join(f"{name} {version(name)}" for name in there)
    absent = f" Not installed: {', '.join(missing)}." if missing else ""
    return (
        f"Measured on {known['cpu']}, {threads} threads, {known['created'][:10]}; "
        f"{known['source']}, Python {known['python']}, {versions}.{absent}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--threads", type=int, default=available_threads(), metavar="N")
    threads = parser.parse_args().threads
    found, missing = available(OPTIONAL)
    always = [ensembles.package, compiled.naive, ensembles.vectorised, flights.scipy_events]
    points = measure(SWEEPS, [*always, *found], threads)
    write_table(points + bare_points(threads, missing), missing, TABLE)
    rows = read_rows(TABLE)
    draw(rows, PICTURE)
    publish(rows, origin(threads, missing))


if __name__ == "__main__":
    main()
