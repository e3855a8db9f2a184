"""The analyses of a sweep file: each computes one dataset and draws it."""

from __future__ import annotations

import argparse
import re
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

from vibrosweep.commands import say, some, tell
from vibrosweep.errors import (
    ExistingOutputError,
    Interruption,
    OutputError,
    ShortObservationWarning,
    VibrosweepError,
)
from vibrosweep.mistakes import OUTPUT

if TYPE_CHECKING:
    import xarray as xr

    from vibrosweep.scene.sweep import Sweep
    from vibrosweep.store.reading import ResultKind

# Options that all commands of this file have; the others are keywords of the function of that name
SHARED: Final = frozenset(
    ("command", "perform", "spec", "output", "threads", "force", "json", "quiet")
)


def perform(options: argparse.Namespace) -> None:
    """Compute a dataset, print its summary, and write it and its picture side by side."""
    from vibrosweep.api import result_kinds
    from vibrosweep.scene.sweep import read_spec

    kind: ResultKind = getattr(result_kinds, options.command.upper())
    spec = read_spec(options.spec)
    output = options.output or default_output(options.spec, kind)
    picture = output.with_suffix(".png")
    _check(options, spec, output, picture)
    from vibrosweep.api import analyses
    from vibrosweep.figures.registry import save
    from vibrosweep.figures.style import for_file
    from vibrosweep.runs.driver import available_threads
    from vibrosweep.store.writing import provenance, write_dataset

    count = options.threads or available_threads()
    keywords = {name: value for name, value in vars(options).items() if name not in SHARED}
    say(options, spec.title)
    began = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ShortObservationWarning)  # the notes say so
        compute = getattr(analyses, options.command)
        found: xr.Dataset = compute(spec, threads=count, **keywords)
    taken, lines = time.perf_counter() - began, [*kind.lines(found)]
    say(options, f"{taken:.3g} s on {some(count, 'thread')}", *lines)
    say(options, *filter(None, re.split(r"; (?=[a-z]+: )", found.attrs["notes"])))
    if limited := found.attrs.get("restitution_law_range"):
        say(options, f"restitution_law: {limited}")
    write_dataset(found.assign_attrs(provenance(count)), output, kind, force=options.force)
    with drawing(output):
        save(for_file(kind.axes, found), picture, force=options.force)
    say(options, f"written to {output} and {picture}")
    tell(
        options,
        {
            "title": spec.title,
            "kind": kind.name,
            "output": output,
            "picture": picture,
            "seconds": taken,
            "threads": count,
            "dimensions": dict(found.sizes),
            "lines": lines,
            "notes": found.attrs["notes"],
        },
    )


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
