"""``vibrosweep windows``: find the stability windows of a sweep file and draw them."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Final

from vibrosweep.commands.arguments import positive, some
from vibrosweep.commands.start import leave_linear_algebra_out

__all__ = ["HELP", "NAME", "add_arguments", "perform"]

NAME: Final = "windows"
HELP: Final = "find the intervals of amplitude in which conditions hold"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("spec", metavar="SPEC.toml", type=Path, help="a grid with [windows]")
    parser.add_argument(
        "-o", "--output", metavar="W.h5", type=Path, help="default: the name of the sweep file"
    )
    parser.add_argument("--threads", metavar="N", type=positive, help="default: all processors")
    parser.add_argument("--force", action="store_true", help="replace existing outputs")


def perform(options: argparse.Namespace) -> None:
    """Carry the command out."""
    from vibrosweep.store.disk import check_output
    from vibrosweep.sweep.spec import read_spec

    spec = read_spec(options.spec)
    output = options.output or Path(f"{options.spec.stem}.h5")
    picture = output.with_suffix(".png")
    for path in (output, picture):
        check_output(path, force=options.force, inputs=(options.spec,))
    leave_linear_algebra_out()
    from vibrosweep.analysis.windows import summary, windows_of_spec
    from vibrosweep.figures.registry import save
    from vibrosweep.figures.stability import stability_windows
    from vibrosweep.store.provenance import provenance
    from vibrosweep.store.saving import save_dataset
    from vibrosweep.sweep.run import available_threads

    threads = options.threads or available_threads()
    print(spec.title)
    began = time.perf_counter()
    found = windows_of_spec(spec, threads=threads)
    print(f"{time.perf_counter() - began:.3g} s on {some(threads, 'thread')}")
    print("\n".join(summary(found)))
    save_dataset(found.assign_attrs(provenance(threads)), output)
    save(stability_windows(found), picture)
    print(f"written to {output} and {picture}")
