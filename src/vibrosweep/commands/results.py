"""Result files: what they hold, their figures, their page in a browser, and their proof."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from vibrosweep.commands import say, tell
from vibrosweep.errors import DataError

if TYPE_CHECKING:
    import xarray as xr


def info(options: argparse.Namespace) -> None:
    from vibrosweep.commands.describe import describe, facts

    if options.json:
        tell(options, facts(options.result))
    else:
        print("\n".join(describe(options.result)))


def figures(options: argparse.Namespace) -> None:
    from vibrosweep.store.reading import using

    with using(options.result):
        _draw(options, options.result, options.output)


def _draw(options: argparse.Namespace, path: Path, directory: Path) -> None:
    from vibrosweep.analysis.records import as_rectangle
    from vibrosweep.figures.registry import FIGURES, left_out, save_all, save_formats
    from vibrosweep.figures.style import for_file
    from vibrosweep.store.reading import (
        SWEEP,
        has_record,
        load_dataset,
        open_record,
        open_sweep,
        read_kind,
    )

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


def explore(options: argparse.Namespace) -> None:
    from vibrosweep.explorer import require_bokeh
    from vibrosweep.store.reading import using

    require_bokeh()
    with using(options.result):
        _explore(options)


def _explore(options: argparse.Namespace) -> None:
    from vibrosweep.explorer.points import open_points

    points = open_points(options.result)
    if options.boundaries is not None:
        from vibrosweep.explorer.points import with_borders

        points = with_borders(points, options.boundaries)
    if options.output is not None:
        from vibrosweep.explorer.static import write_page

        print(write_page(points, options.output, force=options.force))
        return
    from vibrosweep.explorer.server import serve

    def started(address: str) -> None:
        print(f"{points.title}: {address} (Ctrl-C ends it)", flush=True)

    serve(points, options.port, started, options.frame_in)


def verify(options: argparse.Namespace) -> int:
    """Perform the command; return 1 if a number contradicts its claim."""
    from vibrosweep import proof
    from vibrosweep.store.reading import using
    from vibrosweep.waiting import reporting

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
