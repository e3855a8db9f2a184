"""Result files: what they hold, their figures, their page in a browser, and their proof."""

from __future__ import annotations

import argparse
import sys

from vibrosweep.commands import say, tell


def info(options: argparse.Namespace) -> None:
    from vibrosweep.commands.describe import describe, facts

    if options.json:
        tell(options, facts(options.result))
    else:
        print("\n".join(describe(options.result)))


def figures(options: argparse.Namespace) -> None:
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
        using,
    )

    path, directory, record = options.result, options.output, None
    with using(path):
        kind = read_kind(path)
        if kind is not SWEEP:
            figure = for_file(kind.axes, load_dataset(path))
            say(options, *map(str, save_formats(figure, directory, kind.stem or kind.name)))
            return
        needed = {name for entry in FIGURES.values() for name in entry.needs.variables}
        with open_sweep(path) as found:
            # variables of single particles that no figure needs may be large
            single = {name for name, one in found.variables.items() if "particle" in one.dims}
            sweep = found.drop_vars(single - needed).load()
        if has_record(path):
            with open_record(path) as found:
                record = as_rectangle(found).load()
        for written in save_all(sweep, record, directory):
            say(options, str(written))
        if line := left_out(sweep, record):
            say(options, line)


def explore(options: argparse.Namespace) -> None:
    from vibrosweep.explorer import require_bokeh
    from vibrosweep.store.reading import using

    require_bokeh()
    from vibrosweep.explorer.points import open_points, with_borders

    with using(options.result):
        points = open_points(options.result)
        if options.boundaries is not None:
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
