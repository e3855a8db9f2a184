"""Tools of the commands that compute one dataset from a sweep file and draw it."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from vibrosweep.commands.arguments import output_file, some, threads
from vibrosweep.errors import ExistingOutputError, Interruption, OutputError, VibrosweepError
from vibrosweep.mistakes import OUTPUT

if TYPE_CHECKING:
    import xarray as xr

    from vibrosweep.scene.sweep import Sweep
    from vibrosweep.store.reading import ResultKind


def add_common(parser: argparse.ArgumentParser, spec: str) -> None:
    """Add the arguments of such a command; `spec` says what the sweep file must hold."""
    parser.add_argument("spec", metavar="SPEC.toml", type=Path, help=spec)
    parser.add_argument(
        "-o",
        "--output",
        metavar="OUT.h5",
        type=output_file,
        help="default: the names of the sweep file and the command",
    )
    parser.add_argument("--threads", metavar="N", type=threads, help="default: all processors")
    parser.add_argument("--force", action="store_true", help="replace existing outputs")


def produce(
    options: argparse.Namespace, kind: ResultKind, compute: Callable[[Sweep, int], xr.Dataset]
) -> None:
    """Compute a dataset, print its summary, and write it and its picture side by side.

    `compute` takes a sweep and a number of threads.
    """
    from vibrosweep.scene.sweep import read_spec

    spec = read_spec(options.spec)
    output = options.output or default_output(options.spec, kind)
    picture = output.with_suffix(".png")
    _check(options, spec, output, picture)
    from vibrosweep.figures.registry import save
    from vibrosweep.figures.style import for_file
    from vibrosweep.runs.driver import available_threads
    from vibrosweep.store.writing import provenance, write_dataset

    count = options.threads or available_threads()
    print(spec.title)
    began = time.perf_counter()
    found = compute(spec, count)
    print(f"{time.perf_counter() - began:.3g} s on {some(count, 'thread')}")
    print("\n".join(kind.lines(found)))
    if found.attrs["notes"]:
        print(f"observation: {found.attrs['notes']}")
    if limited := found.attrs.get("restitution_law_range"):
        print(f"restitution_law: {limited}")
    write_dataset(found.assign_attrs(provenance(count)), output, kind, force=options.force)
    with drawing(output):
        save(for_file(kind.axes, found), picture, force=options.force)
    print(f"written to {output} and {picture}")


def default_output(spec: Path, kind: ResultKind) -> Path:
    """Return the name of the sweep file, with the kind of result appended unless it is in it."""
    named = spec.stem if kind.name in spec.stem else f"{spec.stem}_{kind.name}"
    return Path(f"{named}.h5")


def _check(options: argparse.Namespace, spec: Sweep, output: Path, picture: Path) -> None:
    """Raise, before anything is computed, if an output cannot be written."""
    from vibrosweep.store.disk import check_output, target_of

    # the file system may ignore case, and one path may be a link to the other
    if str(target_of(output)).casefold() == str(target_of(picture)).casefold():
        raise OutputError(
            f"{output}: is the name of the picture, which is written beside the dataset; give the "
            f"dataset a name such as {output.with_suffix('.h5').name} with ",
            OUTPUT,
        )
    try:
        check_output(output, force=options.force, inputs=(options.spec,))
    except ExistingOutputError as error:
        from vibrosweep.runs.driver import origin

        raise ExistingOutputError(output, origin(spec, output)) from error
    check_output(picture, force=options.force, inputs=(options.spec,))


@contextmanager
def drawing(written: Path | None) -> Iterator[None]:
    """Add to any error or interruption during drawing that the dataset itself is written."""
    if written is None:
        yield
        return
    try:
        yield
    except KeyboardInterrupt as error:
        raise Interruption(
            f"interrupted; {written} is written and complete, but not its picture"
        ) from error
    except Exception as error:  # drawing may fail in any way
        reason = error.parts if isinstance(error, VibrosweepError) else (repr(error),)
        raise OutputError(
            f"{written}: is written and complete, but its picture failed: ", *reason
        ) from error
