"""``vibrosweep run``: compute a sweep file."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibrosweep.commands.arguments import add_sweep, output_of, positive, some, threads

if TYPE_CHECKING:
    from vibrosweep.scene.sweep import Sweep


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_sweep(parser)
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--threads", metavar="N", type=threads, help="default: all processors")
    where.add_argument(
        "--workers",
        metavar="N",
        type=threads,
        help="compute in N processes of a thread each (Dask)",
    )
    where.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="compute on the Dask cluster of this scheduler, as tcp://host:8786",
    )
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

    output = output_of(options)

    def kept() -> str:
        from vibrosweep.runs.driver import kept_text

        return kept_text(output)

    spec = read_spec(options.spec, kept)
    if not _to_compute(options, spec, output):
        print(
            f"{output}: is the finished result of exactly this sweep; the parts that its run left "
            f"beside it are removed"
        )
        return
    from vibrosweep.engine.workers import seconds_of_compiling
    from vibrosweep.runs.driver import run_sweep
    from vibrosweep.runs.progress import reporting

    print(spec.title)
    began, before = time.perf_counter(), seconds_of_compiling()
    with _opened_place(options) as (place, settings), reporting(sys.stderr) as advance:
        settings |= {"chunk": options.chunk, "force": options.force, "advance": advance}
        if options.retry_failed:
            from vibrosweep.runs.driver import retry_failed

            budget = options.impact_budget
            summary, again = retry_failed(spec, output, impact_budget=budget, **settings)
        else:
            summary = run_sweep(spec, output, **settings)
    compiled = seconds_of_compiling() - before
    taken = time.perf_counter() - began - compiled
    if options.retry_failed:
        print(f"{some(again, 'realization')} computed again")
    print(
        f"{some(summary.realizations, 'realization')} of {some(spec.scene.particles, 'particle')}, "
        f"{some(summary.landings, 'landing')} in {taken:.3g} s on {place}"
        + (f", after {compiled:.3g} s of compiling" if compiled else "")
    )
    if summary.kept:
        print(
            f"{some(summary.kept, 'realization')} of them kept from the run before: the time is "
            f"that of the others"
        )
    if summary.repaired:
        print(f"{some(summary.repaired, 'damaged part')} found and computed again")
    print("\n".join(summary.lines()))
    unchanged = options.retry_failed and not again
    print(f"{output} is unchanged" if unchanged else f"written to {output}")


@contextmanager
def _opened_place(options: argparse.Namespace) -> Iterator[tuple[str, dict[str, Any]]]:
    """Provide threads of this process, or workers of a Dask cluster.

    Yields their description, and the arguments of `run_sweep` that choose them.
    """
    if options.workers is None and options.scheduler is None:
        from vibrosweep.runs.driver import available_threads

        count = options.threads or available_threads()
        yield some(count, "thread"), {"threads": count}
        return
    from vibrosweep.runs import cluster

    if options.workers is not None:
        opened, absence = cluster.local_workers(options.workers), cluster.LOCAL_ABSENCE
        place = some(options.workers, "worker")
    else:
        opened, absence = cluster.connected(options.scheduler), cluster.ABSENCE
        place = f"the workers of {options.scheduler}"
    with opened as client:
        count = sum(client.nthreads().values())
        if not count:
            print("the cluster has no workers yet: waiting for them", file=sys.stderr, flush=True)
        chunks = max(1, cluster.CHUNKS_PER_THREAD * count)
        runner = cluster.on_dask(client, absence)
        yield place, {"threads": 1, "runner": runner, "at_least": chunks}


def _to_compute(options: argparse.Namespace, spec: Sweep, output: Path) -> bool:
    """Return False if a killed run left a finished result, whose parts are removed; else True.

    Raises an error for an existing output and for impossible options, before the slow imports.
    """
    from vibrosweep.errors import ExistingOutputError, ParameterError
    from vibrosweep.store.disk import check_output
    from vibrosweep.store.parts import replaces

    if options.impact_budget and not options.retry_failed:
        raise ParameterError(
            "--impact-budget goes with --retry-failed; for a whole sweep set measure.impact_budget "
            "in its file"
        )
    replace = options.force or options.retry_failed
    try:
        check_output(output, force=replace or replaces(output), inputs=spec.inputs)
    except ExistingOutputError as error:
        from vibrosweep.runs.driver import cleared, is_of, origin

        if is_of(spec, output) and cleared(spec, output):
            return False
        raise ExistingOutputError(output, origin(spec, output)) from error
    return True
