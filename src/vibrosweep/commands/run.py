"""``vibrosweep run``: compute a sweep file."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from vibrosweep.commands.arguments import positive, some
from vibrosweep.commands.place import add_place, opened_place

if TYPE_CHECKING:
    from vibrosweep.scene.sweep import Sweep

NAME: Final = "run"
HELP: Final = "compute a sweep file"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("spec", metavar="SPEC.toml", type=Path, help="the sweep file")
    parser.add_argument(
        "-o", "--output", metavar="OUT.h5", type=Path, help="default: the name of the sweep file"
    )
    add_place(parser)
    parser.add_argument(
        "--chunk",
        metavar="N",
        type=positive,
        help="realizations in a chunk; each finished chunk is kept",
    )
    parser.add_argument("--force", action="store_true", help="replace an output or unfinished run")
    parser.add_argument(
        "--retry-failed",
        action="store_true",
        help="compute again the realizations of a result that did not complete",
    )
    parser.add_argument(
        "--impact-budget",
        metavar="N",
        type=positive,
        help="with --retry-failed: impacts after which a particle is given up",
    )


def perform(options: argparse.Namespace) -> None:
    from vibrosweep.scene.sweep import read_spec

    output = options.output or Path(f"{options.spec.stem}.h5")
    spec = read_spec(options.spec, lambda: _kept(output))
    if not _to_compute(options, spec, output):
        print(
            f"{output}: is the finished result of exactly this sweep; the parts that its run left "
            f"beside it are removed"
        )
        return
    from vibrosweep.runs.driver import run_sweep
    from vibrosweep.runs.progress import reporting

    print(spec.title)
    began = time.perf_counter()
    with opened_place(options) as place, reporting(sys.stderr) as advance:
        settings: dict[str, Any] = {
            "threads": place.threads,
            "chunk": options.chunk,
            "force": options.force,
            "advance": advance,
            "runner": place.runner,
            "at_least": place.at_least,
        }
        if options.retry_failed:
            from vibrosweep.runs.retry import retry_failed

            budget = options.impact_budget
            summary, again = retry_failed(spec, output, impact_budget=budget, **settings)
        else:
            summary = run_sweep(spec, output, **settings)
    seconds = time.perf_counter() - began
    if options.retry_failed:
        print(f"{some(again, 'realization')} computed again")
    print(
        f"{some(summary.realizations, 'realization')} of {some(spec.scene.particles, 'particle')}, "
        f"{some(summary.landings, 'landing')} in {seconds:.3g} s on {place.name}"
    )
    if summary.repaired:
        print(f"{some(summary.repaired, 'damaged part')} found and computed again")
    print("\n".join(summary.lines()))
    unchanged = options.retry_failed and not again
    print(f"{output} is unchanged" if unchanged else f"written to {output}")


def _kept(output: Path) -> str:
    """Text of the sweep file in an output, or in its unfinished run."""
    from vibrosweep.runs.finished import kept_text

    return kept_text(output)


def _to_compute(options: argparse.Namespace, spec: Sweep, output: Path) -> bool:
    """Return whether there is anything to compute, unless a killed run had already ended.

    Raises for impossible options, before the slow imports.
    """
    from vibrosweep.errors import ExistingOutputError, ParameterError
    from vibrosweep.store.disk import check_output
    from vibrosweep.store.rundir import replaces

    if options.impact_budget and not options.retry_failed:
        raise ParameterError(
            "--impact-budget goes with --retry-failed; for a whole sweep set measure.impact_budget "
            "in its file"
        )
    replace = options.force or options.retry_failed
    try:
        check_output(output, force=replace or replaces(output), inputs=spec.inputs)
    except ExistingOutputError as error:
        from vibrosweep.runs.finished import cleared, is_of, origin

        if is_of(spec, output) and cleared(spec, output):
            return False
        raise ExistingOutputError(output, origin(spec, output)) from error
    return True
