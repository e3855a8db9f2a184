"""What commands share that compute one dataset from a sweep file and draw it."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from vibrosweep.commands.arguments import positive, some
from vibrosweep.commands.start import leave_linear_algebra_out

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from vibrosweep.sweep.spec import SweepSpec

__all__ = ["add_common", "produce"]


def add_common(parser: argparse.ArgumentParser, spec: str) -> None:
    """Add the arguments of such a command; `spec` says what the sweep file must hold."""
    parser.add_argument("spec", metavar="SPEC.toml", type=Path, help=spec)
    parser.add_argument(
        "-o", "--output", metavar="OUT.h5", type=Path, help="default: the name of the sweep file"
    )
    parser.add_argument("--threads", metavar="N", type=positive, help="default: all processors")
    parser.add_argument("--force", action="store_true", help="replace existing outputs")


def produce(
    options: argparse.Namespace,
    compute: Callable[[SweepSpec, int], xr.Dataset],
    draw: Callable[[xr.Dataset], Figure],
    summary: Callable[[xr.Dataset], Iterable[str]],
) -> None:
    """Compute a dataset, print its summary, and write it and its picture side by side.

    Parameters
    ----------
    options
        Parsed arguments of `add_common`.
    compute
        Function from a sweep and a number of threads to a dataset.
    draw
        Function from the dataset to a figure.
    summary
        Function from the dataset to lines of text.
    """
    from vibrosweep.store.disk import check_output
    from vibrosweep.sweep.spec import read_spec

    spec = read_spec(options.spec)
    output = options.output or Path(f"{options.spec.stem}.h5")
    picture = output.with_suffix(".png")
    for path in (output, picture):
        check_output(path, force=options.force, inputs=(options.spec,))
    leave_linear_algebra_out()
    from vibrosweep.figures.registry import save
    from vibrosweep.store.provenance import provenance
    from vibrosweep.store.saving import save_dataset
    from vibrosweep.sweep.run import available_threads

    threads = options.threads or available_threads()
    print(spec.title)
    began = time.perf_counter()
    found = compute(spec, threads)
    print(f"{time.perf_counter() - began:.3g} s on {some(threads, 'thread')}")
    print("\n".join(summary(found)))
    save_dataset(found.assign_attrs(provenance(threads)), output)
    save(draw(found), picture)
    print(f"written to {output} and {picture}")
