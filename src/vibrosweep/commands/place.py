"""Place of a computation: threads of this process, or workers of a Dask cluster."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

from vibrosweep.commands.arguments import positive, some

if TYPE_CHECKING:
    from vibrosweep.runs.chunks import Runner


def add_place(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that choose the place."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--threads", metavar="N", type=positive, help="default: all processors")
    where.add_argument(
        "--workers",
        metavar="N",
        type=positive,
        help="compute in N processes of a thread each (Dask)",
    )
    where.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="compute on the Dask cluster of this scheduler, as tcp://host:8786",
    )


class Place(NamedTuple):
    """The runner that computes the chunks, and its description."""

    name: str
    threads: int
    runner: Runner | None = None
    at_least: int = 1


@contextmanager
def opened_place(options: argparse.Namespace) -> Iterator[Place]:
    """Provide the threads of this process, or the workers of a cluster, to compute the chunks."""
    if options.workers is None and options.scheduler is None:
        from vibrosweep.runs.driver import available_threads

        threads = options.threads or available_threads()
        yield Place(some(threads, "thread"), threads)
        return
    from vibrosweep.runs import cluster

    if options.workers is not None:
        opened, absence = cluster.local_workers(options.workers), cluster.LOCAL_ABSENCE
        name = some(options.workers, "worker")
    else:
        opened, absence = cluster.connected(options.scheduler), cluster.ABSENCE
        name = f"the workers of {options.scheduler}"
    with opened as client:
        threads = sum(client.nthreads().values())
        if not threads:
            print("the cluster has no workers yet: waiting for them", file=sys.stderr, flush=True)
        runner = cluster.on_dask(client, absence)
        yield Place(name, 1, runner, max(1, cluster.CHUNKS_PER_THREAD * threads))
