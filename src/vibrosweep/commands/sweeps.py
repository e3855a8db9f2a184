"""Sweep files: examples of them, what one will take, its run; and the machine that runs it."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from vibrosweep.commands import say, some, tell

if TYPE_CHECKING:
    from vibrosweep.runs.plan import Needs, Plan
    from vibrosweep.runs.result import Summary
    from vibrosweep.scene.sweep import Sweep

# Of the example sweeps, in an installed package, and in its source tree
PLACES: Final = (Path(__file__).parents[1] / "sweeps", Path(__file__).parents[3] / "sweeps")
SCHEMA: Final = "sweep.schema.json"  # of sweep files, beside the examples
SECONDS: Final = 2.0  # for which a plan refines its estimate


def examples(options: argparse.Namespace) -> None:
    files = examples_in(PLACES)
    if options.all:
        _copy(files, options.output, force=options.force)
    elif options.names:
        _copy(_chosen(files, options.names), options.output, force=options.force)
    else:
        _list_examples(files)


def examples_in(places: Sequence[Path]) -> dict[str, Path]:
    """Return the files of the first place that has any, by name.

    A name is the path without suffix, with slashes on every system.
    """
    from vibrosweep.errors import DataError

    for place in places:
        names = sorted(
            p.relative_to(place).with_suffix("").as_posix() for p in place.rglob("*.toml")
        )
        if names:
            return {name: place / f"{name}.toml" for name in names}
    raise DataError(f"{places[0]}: the example sweeps are missing; install vibrosweep again")


def _list_examples(files: dict[str, Path]) -> None:
    import tomllib

    width = max(map(len, files))
    for name, path in files.items():
        title = tomllib.loads(path.read_text(encoding="utf-8"))["title"]
        print(f"{name:{width}}  {title}")
    print("\nvibrosweep examples NAME... copies some to this directory, --all copies all")


def _chosen(files: dict[str, Path], names: list[str]) -> dict[str, Path]:
    """Return the named files; ``paper`` and ``paper.toml`` name the same file."""
    from vibrosweep.errors import ParameterError

    wanted = [name.removesuffix(".toml") for name in names]
    unknown = [name for name in wanted if name not in files]
    if unknown:
        raise ParameterError(
            f"no example is called {', '.join(unknown)}; there are {', '.join(files)}"
        )
    return {name: files[name] for name in wanted}


def _copy(files: dict[str, Path], directory: Path, *, force: bool) -> None:
    """Copy files below a directory, with the traces that they read; all of them or none.

    The schema that their first line names is copied beside them, unless it is there.
    """
    import re

    from vibrosweep.store.disk import check_output, make_directory, replacing

    copies = {directory / f"{name}.toml": path for name, path in files.items()}
    copies |= {
        copy.with_name(trace): path.with_name(trace)
        for copy, path in copies.items()
        for trace in re.findall(r'trace = "([^"/]+)"', path.read_text(encoding="utf-8"))
    }
    beside = directory / SCHEMA
    if force or not beside.exists():
        name, path = next(iter(files.items()))
        copies[beside] = path.parents[name.count("/")] / SCHEMA
    for copy in copies:
        make_directory(copy.parent)
        check_output(copy, force=force)
    for copy, path in copies.items():
        with replacing(copy, force=force) as file:
            file.write(path.read_bytes())
        print(copy)


def _output_of(options: argparse.Namespace) -> Path:
    """Return the result that the options name, by default after the sweep file."""
    output: Path = options.output or Path(f"{options.spec.stem}.h5")
    return output


def plan(options: argparse.Namespace) -> None:
    from vibrosweep.scene.sweep import read_spec

    spec, output = read_spec(options.spec), _output_of(options)
    from vibrosweep.store.disk import check_output

    check_output(output, force=True, inputs=spec.inputs)  # an existing result may be planned again
    from vibrosweep.engine.workers import Workers
    from vibrosweep.runs.driver import available_threads
    from vibrosweep.runs.plan import estimate, make_plan, refined, require_disk, require_memory
    from vibrosweep.runs.result import notes

    with Workers(options.threads or available_threads()) as workers:
        made = make_plan(spec, workers, options.chunk)  # as a run makes it
        made = refined(spec, made, workers, SECONDS)
        needs = estimate(spec, made, workers)
        remarks = notes(spec, made.design)
        say(options, spec.title)
        say(options, *_plan_lines(options, made, needs, spec.scene.particles, workers.threads))
        say(options, *(f"{subject:16}{text}" for subject, text in remarks.items()))
        tell(
            options,
            {
                "title": spec.title,
                "realizations": made.design.realizations,
                "particles": spec.scene.particles,
                "chunks": made.chunks,
                "chunk": made.chunk,
                **asdict(needs),
                "threads": workers.threads,
                "sampled": made.cost.columns["status"].size,
                "share": made.cost.share,
                "notes": remarks,
            },
        )
    require_memory(needs.memory)
    require_disk(output, needs.result + needs.parts)


def _plan_lines(
    options: argparse.Namespace, plan: Plan, needs: Needs, particles: int, threads: int
) -> Iterator[str]:
    cost = plan.cost
    yield f"{'realizations':16}{plan.design.realizations} of {some(particles, 'particle')}"
    about = "" if options.chunk else "about "  # a run measures the speed of the machine again
    cut = f"of {about}{some(plan.chunk, 'realization')}, each saved as soon as it is finished"
    chunks = f"{about}{plan.chunks} {cut}" if plan.chunks > 1 else "1 (short: not cut)"
    yield f"{'chunks':16}{chunks}"
    within = f" ({needs.fewest:.3g} to {needs.most:.3g} with 95 % confidence)"
    exact = math.isnan(needs.fewest) or needs.fewest == needs.most
    yield f"{'impacts':16}{needs.impacts:.3g}{'' if exact else within}"
    yield f"{'time':16}{needs.seconds:.2g} s on {some(threads, 'thread')}"
    kernels = "compiled just now; a run finds them" if cost.compiled else "ready"
    yield f"{'kernels':16}{kernels} ({cost.start:.2g} s)"
    yield f"{'memory':16}{needs.memory / 2**20:.0f} MiB"
    beside = f", and {needs.parts / 2**20:.3g} MiB beside it for chunks" if needs.parts else ""
    yield f"{'disk':16}{needs.result / 2**20:.3g} MiB{beside}"
    share = "" if cost.share == 1.0 else f", over {100 * cost.share:.2g} % of their duration"
    yield f"{'estimated from':16}{some(cost.columns['status'].size, 'realization')}{share}"


def run(options: argparse.Namespace) -> None:
    from vibrosweep.scene.sweep import read_spec

    output = _output_of(options)

    def kept() -> str:
        from vibrosweep.runs.driver import kept_text

        return kept_text(output)

    spec = read_spec(options.spec, kept)
    if not _to_compute(options, spec, output):
        say(
            options,
            f"{output}: is the finished result of exactly this sweep; the parts that its run left "
            f"beside it are removed",
        )
        tell(options, {"title": spec.title, "output": output, "computed": 0})
        return
    from vibrosweep.engine.workers import seconds_of_compiling
    from vibrosweep.runs.driver import run_sweep
    from vibrosweep.waiting import reporting

    say(options, spec.title)
    began, before = time.perf_counter(), seconds_of_compiling()
    quiet = options.quiet
    with (
        _opened_place(options) as (place, settings),
        reporting(sys.stderr, quiet=quiet) as advance,
    ):
        settings |= {"chunk": options.chunk, "force": options.force, "advance": advance}
        if options.retry_failed:
            from vibrosweep.runs.driver import retry_failed

            budget = options.impact_budget
            summary, again = retry_failed(spec, output, impact_budget=budget, **settings)
        else:
            summary = run_sweep(spec, output, **settings)
    compiled = seconds_of_compiling() - before
    taken = time.perf_counter() - began - compiled
    computed = again if options.retry_failed else summary.realizations - summary.kept
    if options.retry_failed:
        say(options, f"{some(again, 'realization')} computed again")
    particles = some(spec.scene.particles, "particle")
    say(
        options,
        f"{some(summary.realizations, 'realization')} of {particles}, "
        f"{some(summary.landings, 'landing')} in {taken:.3g} s on {place}"
        + (f", after {compiled:.3g} s of compiling" if compiled else ""),
    )
    say(options, *_earlier(summary), *summary.lines())
    unchanged = options.retry_failed and not again
    say(options, f"{output} is unchanged" if unchanged else f"written to {output}")
    facts = {"computed": computed, "seconds": taken, "compiling": compiled, "place": place}
    tell(options, {"title": spec.title, "output": output, **facts, **summary.facts()})


def _earlier(summary: Summary) -> Iterator[str]:
    """Say what an earlier run had computed."""
    if summary.kept:
        yield (
            f"{some(summary.kept, 'realization')} of them are from the earlier run: the time is "
            f"that of the others"
        )
    if summary.repaired:
        yield f"{some(summary.repaired, 'damaged part')} found and computed again"


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
        from vibrosweep.runs.driver import added, cleared, is_of, origin

        if is_of(spec, output) and cleared(spec, output):
            return False
        if not added(spec, output):
            raise ExistingOutputError(output, origin(spec, output)) from error
    return True


def doctor(options: argparse.Namespace) -> int:
    """Perform the command; return 1 if anything is wrong."""
    from vibrosweep.doctor import findings

    found = []
    for finding in findings(Path.cwd()):
        say(options, *finding.lines())
        found.append(finding)
    wrong = sum(bool(finding.trouble) for finding in found)
    say(options, f"{some(wrong, 'problem')}, marked WRONG above" if wrong else "all is well")
    tell(options, {"problems": wrong, "findings": [finding._asdict() for finding in found]})
    return 1 if wrong else 0


def warmup(options: argparse.Namespace) -> None:
    from vibrosweep.doctor.machine import warm_up

    began = time.perf_counter()
    compiled = warm_up()
    say(
        options,
        f"{some(compiled.made, 'variant')} compiled, {compiled.kept} found on disk, in "
        f"{time.perf_counter() - began:.3g} s; stored in {compiled.directory}",
    )
