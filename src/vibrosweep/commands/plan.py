"""``vibrosweep plan``: estimate time, memory and disk space of a sweep before it runs."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

from vibrosweep.commands.arguments import add_sweep, output_of, positive, some, threads

if TYPE_CHECKING:
    from vibrosweep.runs.plan import Needs, Plan


SECONDS: Final = 2.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_sweep(parser)
    parser.add_argument("--threads", metavar="N", type=threads, help="default: all processors")
    parser.add_argument("--chunk", metavar="N", type=positive, help="realizations in a chunk")


def perform(options: argparse.Namespace) -> None:
    from vibrosweep.scene.sweep import read_spec

    spec = read_spec(options.spec)
    from vibrosweep.engine.workers import Workers
    from vibrosweep.runs.driver import available_threads
    from vibrosweep.runs.plan import estimate, make_plan, refined, require_disk, require_memory
    from vibrosweep.runs.result import notes

    output = output_of(options)
    with Workers(options.threads or available_threads()) as workers:
        plan = make_plan(spec, workers, options.chunk)  # as a run makes it
        plan = refined(spec, plan, workers, SECONDS)
        needs = estimate(spec, plan, workers)
        print(spec.title)
        print("\n".join(_lines(options, plan, needs, spec.scene.particles, workers.threads)))
        for subject, text in notes(spec, plan.design).items():
            print(f"{subject:16}{text}")
    require_memory(needs.memory)
    require_disk(output, needs.result + needs.parts)


def _lines(
    options: argparse.Namespace, plan: Plan, needs: Needs, particles: int, threads: int
) -> Iterator[str]:
    cost = plan.cost
    yield f"{'realizations':16}{plan.design.realizations} of {some(particles, 'particle')}"
    about = "" if options.chunk else "about "  # a run measures the speed of the machine anew
    cut = f"of {about}{some(plan.chunk, 'realization')}, each kept as soon as it is finished"
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
