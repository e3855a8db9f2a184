"""The analyses of a sweep file: each computes one dataset and draws it."""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from vibrosweep.commands.arguments import (
    add_json,
    add_quiet,
    output_file,
    positive,
    say,
    some,
    tell,
    threads,
    whole,
)
from vibrosweep.errors import ExistingOutputError, Interruption, OutputError, VibrosweepError
from vibrosweep.mistakes import OUTPUT

if TYPE_CHECKING:
    import xarray as xr

    from vibrosweep.scene.sweep import Sweep
    from vibrosweep.store.reading import ResultKind

LINES: Final = {  # options of the analyses of lines of orbits, with their defaults
    "impacts": ("largest number of impacts of an orbit", 1),
    "periods": ("largest number of its forcing periods", 1),
    "doublings": ("number of successive doublings whose new orbits are continued", 0),
    "points": ("largest number of points of a line in each direction", 1000),
}


def _lines(options: argparse.Namespace) -> dict[str, Any]:
    wanted = options.impacts, options.periods
    return {"wanted": wanted, "doublings": options.doublings, "points": options.points}


def _orbits(options: argparse.Namespace) -> dict[str, Any]:
    from vibrosweep.analysis.orbits import SEEDS

    return {"impacts": options.impacts, "periods": options.periods, "seeds": SEEDS}


def _bifurcation(options: argparse.Namespace) -> dict[str, Any]:
    names = "observable", "samples", "launches"
    return {name: getattr(options, name) for name in names}


class Analysis(NamedTuple):
    """A command of this file."""

    module: str
    function: str
    spec: str  # what the sweep file must hold
    numbers: Mapping[str, tuple[str, int]] = {}  # options, with their words and defaults
    keywords: Callable[[argparse.Namespace], dict[str, Any]] = lambda options: {}


ANALYSES: Final[Mapping[str, Analysis]] = {
    "windows": Analysis(
        "vibrosweep.api.analyses",
        "windows_found",
        "a grid, or ranges, of the forcing, with [windows]",
    ),
    "bifurcation": Analysis(
        "vibrosweep.analysis.bifurcation",
        "bifurcation",
        "a grid over the forcing",
        {
            "samples": ("impacts at each point; four times as many if aperiodic", 64),
            "launches": ("new launches at each point", 8),
        },
        _bifurcation,
    ),
    "basins": Analysis(
        "vibrosweep.analysis.basins",
        "basins",
        "a grid over launch_velocity, optionally also over a forcing or the restitution; its "
        "particles give the launch times",
    ),
    "orbits": Analysis(
        "vibrosweep.analysis.orbits",
        "orbits",
        "the sweep whose realizations are searched for orbits",
        {
            "impacts": ("largest number of impacts of an orbit", 4),
            "periods": ("largest number of forcing periods of an orbit", 4),
        },
        _orbits,
    ),
    "branches": Analysis(
        "vibrosweep.analysis.branches",
        "branches",
        "a grid over restitution, or over the forcing",
        LINES,
        _lines,
    ),
    "boundaries": Analysis(
        "vibrosweep.analysis.branches",
        "boundaries",
        "a grid over restitution and the forcing",
        LINES,
        _lines,
    ),
}


def _add(name: str, parser: argparse.ArgumentParser) -> None:
    """Add the arguments of an analysis."""
    analysis = ANALYSES[name]
    parser.add_argument("spec", metavar="SPEC.toml", type=Path, help=analysis.spec)
    parser.add_argument(
        "-o",
        "--output",
        metavar="OUT.h5",
        type=output_file,
        help="result file; default: the names of sweep file and command",
    )
    parser.add_argument("--threads", metavar="N", type=threads, help="threads; default: all")
    parser.add_argument("--force", action="store_true", help="replace existing outputs")
    add_json(parser)
    add_quiet(parser)
    if name == "bifurcation":
        parser.add_argument(
            "--observable",
            metavar="NAME",
            default="rebound_velocity",
            help="quantity to draw; default: rebound_velocity",
        )
    for option, (words, default) in analysis.numbers.items():
        kind = positive if default else whole
        text = f"{words}; default: {default}"
        parser.add_argument(f"--{option}", metavar="N", type=kind, default=default, help=text)


def _perform(name: str, options: argparse.Namespace) -> None:
    """Compute a dataset, print its summary, and write it and its picture side by side."""
    from vibrosweep.api import result_kinds
    from vibrosweep.scene.sweep import read_spec

    analysis = ANALYSES[name]
    kind: ResultKind = getattr(result_kinds, name.upper())
    spec = read_spec(options.spec)
    output = options.output or default_output(options.spec, kind)
    picture = output.with_suffix(".png")
    _check(options, spec, output, picture)
    from vibrosweep.figures.registry import save
    from vibrosweep.figures.style import for_file
    from vibrosweep.runs.driver import available_threads
    from vibrosweep.store.writing import provenance, write_dataset

    count = options.threads or available_threads()
    say(options, spec.title)
    began = time.perf_counter()
    compute = getattr(import_module(analysis.module), analysis.function)
    found: xr.Dataset = compute(spec, threads=count, **analysis.keywords(options))
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


COMMANDS: Final = {name: (partial(_add, name), partial(_perform, name)) for name in ANALYSES}
