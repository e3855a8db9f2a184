"""``vibrosweep run``: compute a sweep file."""

from __future__ import annotations

import argparse
import gc
import sys
import time
from pathlib import Path
from typing import Final

from vibrosweep.commands.arguments import positive, some
from vibrosweep.commands.start import leave_linear_algebra_out

__all__ = ["HELP", "NAME", "add_arguments", "perform"]

NAME: Final = "run"
HELP: Final = "compute a sweep file"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("spec", metavar="SPEC.toml", type=Path, help="the sweep file")
    parser.add_argument(
        "-o", "--output", metavar="OUT.h5", type=Path, help="default: the name of the sweep file"
    )
    parser.add_argument("--threads", metavar="N", type=positive, help="default: all processors")
    parser.add_argument(
        "--chunk",
        metavar="N",
        type=positive,
        help="realizations in a chunk; each finished chunk is kept",
    )
    parser.add_argument("--force", action="store_true", help="replace an output or unfinished run")


def perform(options: argparse.Namespace) -> None:
    """Carry the command out."""
    from vibrosweep.sweep.spec import read_spec

    spec = read_spec(options.spec)
    output = options.output or Path(f"{options.spec.stem}.h5")
    gc.disable()  # importing makes many objects and hardly any garbage
    from vibrosweep.store.disk import check_output
    from vibrosweep.store.rundir import replaces

    force = options.force
    check_output(output, force=force or replaces(output), inputs=(options.spec, spec.table))
    leave_linear_algebra_out()
    from vibrosweep.sweep.progress import reporting
    from vibrosweep.sweep.run import available_threads, run_sweep

    gc.enable()
    threads = options.threads or available_threads()
    print(spec.title)
    began = time.perf_counter()
    with reporting(sys.stderr) as advance:
        summary = run_sweep(
            spec, output, threads=threads, chunk=options.chunk, force=force, advance=advance
        )
    seconds = time.perf_counter() - began
    print(
        f"{some(summary.realizations, 'realization')} of {some(spec.particles, 'particle')}, "
        f"{some(summary.landings, 'landing')} in {seconds:.3g} s on {some(threads, 'thread')}"
    )
    if summary.repaired:
        print(f"{some(summary.repaired, 'damaged part')} found and computed again")
    print("\n".join(summary.lines()))
    print(f"written to {output}")
