"""Result files: what they hold, their figures, and their proof."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

from vibrosweep.commands.arguments import add_json, add_quiet, directory, positive, say, tell, whole
from vibrosweep.errors import DataError

if TYPE_CHECKING:
    import xarray as xr


def add_info(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("result", metavar="OUT.h5", type=Path, help="the result")
    add_json(parser)


def info(options: argparse.Namespace) -> None:
    from vibrosweep.commands.describe import describe, facts

    if options.json:
        tell(options, facts(options.result))
    else:
        print("\n".join(describe(options.result)))


def add_figures(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("result", metavar="OUT.h5", type=Path, help="the result")
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=directory,
        default=Path("figures"),
        help="folder for the figures; default: figures",
    )
    add_quiet(parser)


def figures(options: argparse.Namespace) -> None:
    from vibrosweep.store.reading import using

    with using(options.result):
        _draw(options, options.result, options.output)


def _draw(options: argparse.Namespace, path: Path, directory: Path) -> None:
    from vibrosweep.analysis.records import as_rectangle
    from vibrosweep.api.results import has_record, open_record, open_sweep
    from vibrosweep.figures.registry import FIGURES, left_out, save_all, save_formats
    from vibrosweep.figures.style import for_file
    from vibrosweep.store.reading import SWEEP, load_dataset, read_kind

    kind = read_kind(path)
    if kind is not SWEEP:
        figure = for_file(kind.axes, load_dataset(path))
        say(options, *map(str, save_formats(figure, directory, kind.stem or kind.name)))
        return
    needed = {name for entry in FIGURES.values() for name in entry.needs.variables}

    def without_particles(sweep: xr.Dataset) -> xr.Dataset:
        """Leave out variables of single particles that no figure needs, since they may be large."""
        single = {name for name, one in sweep.variables.items() if "particle" in one.dims}
        return sweep.drop_vars(single - needed)

    sweep = _loaded(path, open_sweep, without_particles)
    record = _loaded(path, open_record, as_rectangle) if has_record(path) else None
    for written in save_all(sweep, record, directory):
        say(options, str(written))
    if line := left_out(sweep, record):
        say(options, line)


def _loaded(
    path: Path, opener: Callable[[Path], xr.Dataset], part: Callable[[xr.Dataset], xr.Dataset]
) -> xr.Dataset:
    """Load the part of a dataset that figures need."""
    with opener(path) as dataset:
        try:
            return part(dataset).load()
        except (OSError, RuntimeError) as error:
            raise DataError(f"{path}: is damaged; compute it again") from error


def add_verify(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("result", metavar="OUT.h5", type=Path, help="the result")
    parser.add_argument(
        "--sample", metavar="K", type=positive, default=20, help="realizations drawn; default: 20"
    )
    parser.add_argument(
        "--seed", metavar="S", type=whole, default=0, help="seed of the draw; default: 0"
    )
    parser.add_argument(
        "--max-landings",
        metavar="N",
        type=positive,
        help="leave out realizations with more landings; default: 250000, which take some ten "
        "seconds, or 1000 over a sprung base",
    )
    add_json(parser)
    add_quiet(parser)


def verify(options: argparse.Namespace) -> int:
    """Perform the command; return 1 if a number contradicts its claim."""
    from vibrosweep import proof
    from vibrosweep.runs.progress import reporting
    from vibrosweep.store.reading import using

    with using(options.result), reporting(sys.stderr, quiet=options.quiet) as advance:
        report = proof.verify(
            options.result,
            sample=options.sample,
            seed=options.seed,
            max_landings=options.max_landings,
            advance=advance,
        )
    say(options, *report.lines())
    tell(options, report.facts())
    return 0 if report.passed else 1


COMMANDS: Final = {
    "info": (add_info, info),
    "figures": (add_figures, figures),
    "verify": (add_verify, verify),
}
