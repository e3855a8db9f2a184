"""Run time per impact against largest landing-time error, for this package and its rivals.

    python benchmarks/work_precision.py -o docs

writes ``work-precision.md``, ``work_precision.csv``, and ``work_precision.png`` and
``work_precision_moving.png`` in ``images``.  Errors are against the proved reference.  heyoka and
diffrax take part where they are installed.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

from methods import compiled, flights, moving
from methods.contest import available, measure, write_table
from methods.figure import draw
from methods.report import report
from methods.scenes import MOVING_SCENES, SCENES
from vibrosweep.runs.driver import available_threads

OPTIONAL = (
    ("heyoka", "methods.taylor", "heyoka_events"),
    ("diffrax", "methods.jaxed", "diffrax_events"),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("docs"), metavar="DIR")
    parser.add_argument("--threads", type=int, default=available_threads(), metavar="N")
    options = parser.parse_args()
    began, load = time.perf_counter(), os.getloadavg()[0]
    always = [compiled.kernel, compiled.naive, flights.scipy_events, compiled.fixed_step]
    found, missing = available(OPTIONAL)
    points, bound = measure(SCENES, [*always, *found], options.threads)
    alike = [compiled.kernel, moving.scalar, flights.scipy_events, *found]
    more, bound_of_moving = measure(MOVING_SCENES, alike, options.threads)
    bound = max(bound, bound_of_moving)
    images = options.output / "images"
    images.mkdir(parents=True, exist_ok=True)
    write_table(points + more, missing, options.output / "work_precision.csv")
    draw(points, SCENES, images / "work_precision.png")
    draw(more, MOVING_SCENES, images / "work_precision_moving.png")
    minutes = (time.perf_counter() - began) / 60.0
    loads = (load, os.getloadavg()[0])
    text = report(points + more, missing, bound, options.threads, loads, minutes)
    (options.output / "work-precision.md").write_text(text, encoding="utf-8")
    print(f"{minutes:.1f} minutes; written to {options.output}")


if __name__ == "__main__":
    main()
