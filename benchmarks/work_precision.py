"""Processor time per landing against the error of the last landing, for this package and others.

    python benchmarks/work_precision.py prove      # benchmarks/references.csv, once
    python benchmarks/work_precision.py time       # benchmarks/finals.csv
    python benchmarks/work_precision.py compare    # work-precision.md, its table and figure

Each step reads only what the step before has stored.  All methods run on one thread; heyoka and
diffrax are timed if they are installed, otherwise their stored rows stay.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from methods.finals import (
    FINALS,
    REFERENCES,
    Reference,
    error_of,
    keep,
    prove_references,
    read,
    read_references,
    row_of,
    write,
)
from methods.scenes import SCENES

HERE = Path(__file__).parent
HEYOKA = ("heyoka", "methods.taylor", "heyoka_events")
DIFFRAX = ("diffrax", "methods.jaxed", "diffrax_events")


def prove() -> None:
    """Store the references."""
    write(REFERENCES, Reference._fields, prove_references(SCENES))


def time() -> None:
    """Time every method that is installed, and store what it found."""
    from methods import compiled, flights, mounted
    from methods.contest import available, timings

    heyoka, diffrax = (available([peer])[0] for peer in (HEYOKA, DIFFRAX))
    moved = [compiled.scalar, flights.scipy_events, *heyoka, *diffrax]
    drawn = [compiled.shaken, flights.scipy_events, *heyoka]
    own = {
        "sprung": [mounted.scalar_mounted, mounted.scipy_mounted],
        "tones": drawn,
        "noise": drawn,
    }
    plain = [compiled.naive, flights.scipy_events, compiled.fixed_step, *heyoka, *diffrax]
    for scene in SCENES:
        sizes = [reference.landings for reference in read_references()[scene.key]]
        others = own.get(scene.key, moved if scene.base == "moving" else plain)
        points = timings(scene, sizes, [compiled.kernel, *others], threads=1)
        keep([row_of(point, sizes) for point in points])


def compare() -> None:
    """Write errors, the figure and the page from what is stored."""
    from methods.figure import draw
    from methods.report import report

    references, rows = read_references(), read(FINALS)
    for row in rows:
        row["last_landing_error_s"] = f"{error_of(row, references[row['scene']]):.3e}"
        del row["finals"]
    order = [scene.key for scene in SCENES]
    rows.sort(key=lambda row: order.index(row["scene"]))
    write(HERE / "work_precision.csv", tuple(rows[0]), (row.values() for row in rows))
    draw(rows, SCENES, HERE / "images" / "work_precision.png")
    (HERE / "work-precision.md").write_text(report(rows, references), encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    steps = {"prove": prove, "time": time, "compare": compare}
    parser.add_argument("step", choices=steps)
    steps[parser.parse_args().step]()


if __name__ == "__main__":
    main()
