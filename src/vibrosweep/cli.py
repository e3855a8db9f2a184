"""The command line: parse, call, and turn errors into exit codes.

0 means done, 2 a mistake that the message tells how to mend, 130 an interruption.  What a command
needs is imported when it runs, so that ``--help`` answers at once.
"""

from __future__ import annotations

import argparse
import atexit
import gc
import os
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vibrosweep._version import __version__
from vibrosweep.errors import VibrosweepError

__all__ = ["main"]

DONE, MISTAKE, INTERRUPTED = 0, 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code."""
    options = _parser().parse_args(arguments)
    # the objects of large libraries live until the end: to sift them at exit took 0.1 s
    atexit.register(gc.freeze)
    # a terminated run cleans up like an interrupted one
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        options.command(options)
        sys.stdout.flush()
    except VibrosweepError as error:
        print(f"vibrosweep: {error}", file=sys.stderr)
        return MISTAKE
    except KeyboardInterrupt:
        print("vibrosweep: interrupted; nothing was kept", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output has gone, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return DONE


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="vibrosweep",
        description="Parameter sweeps of the vibro-impact (bouncing-ball) map.",
    )
    parser.add_argument("--version", action="version", version=f"vibrosweep {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    run = commands.add_parser("run", help="compute a sweep file")
    run.add_argument("spec", metavar="SPEC.toml", type=Path, help="the sweep file")
    run.add_argument(
        "-o", "--output", metavar="OUT.h5", type=Path, help="default: the name of the sweep file"
    )
    run.add_argument("--threads", metavar="N", type=_positive, help="default: all processors")
    run.add_argument("--chunk", metavar="N", type=_positive, help="realizations held in memory")
    run.add_argument("--force", action="store_true", help="replace an existing output")
    run.set_defaults(command=_run)

    info = commands.add_parser("info", help="show what a result file holds")
    info.add_argument("result", metavar="OUT.h5", type=Path)
    info.set_defaults(command=_info)

    figures = commands.add_parser("figures", help="draw the figures of a result file")
    figures.add_argument("result", metavar="OUT.h5", type=Path)
    figures.add_argument(
        "-o", "--output", metavar="DIR", type=Path, default=Path("figures"), help="default: figures"
    )
    figures.set_defaults(command=_figures)
    return parser


def _positive(text: str) -> int:
    value = int(text) if text.isdecimal() else 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least 1")
    return value


def _run(options: argparse.Namespace) -> None:
    from vibrosweep.sweep.spec import read_spec

    spec = read_spec(options.spec)
    output = options.output or Path(f"{options.spec.stem}.h5")
    from vibrosweep.store.dataset import check_output

    check_output(output, force=options.force)
    _leave_linear_algebra_out()
    from vibrosweep.sweep.progress import reporting
    from vibrosweep.sweep.run import available_threads, run_sweep

    threads = options.threads or available_threads()
    print(spec.title)
    began = time.perf_counter()
    with reporting(sys.stderr) as advance:
        summary = run_sweep(spec, output, threads=threads, chunk=options.chunk, advance=advance)
    seconds = time.perf_counter() - began
    print(
        f"{summary.realizations} realizations of {spec.particles} particles, "
        f"{summary.landings} landings in {seconds:.3g} s on {threads} threads"
    )
    print("\n".join(summary.lines()))
    print(f"written to {output}")


def _leave_linear_algebra_out() -> None:
    """Keep numba from importing scipy's linear algebra, which no kernel uses: 0.15 s of each run.

    Done here and not in the library: this process is ours alone.
    """
    sys.modules.setdefault("scipy.linalg.cython_blas", None)  # type: ignore[arg-type]
    from numba.core.registry import cpu_target

    cpu_target.target_context.refresh()
    if sys.modules["scipy.linalg.cython_blas"] is None:
        del sys.modules["scipy.linalg.cython_blas"]


def _info(options: argparse.Namespace) -> None:
    from vibrosweep.sweep.inspect import describe

    print("\n".join(describe(options.result)))


def _figures(options: argparse.Namespace) -> None:
    from vibrosweep.api import open_record, open_sweep
    from vibrosweep.errors import DataError
    from vibrosweep.figures import missing, save_all

    with open_sweep(options.result) as sweep:
        record: Any = None
        try:
            record = open_record(options.result)
        except DataError:
            record = None
        for path in save_all(sweep, record, options.output):
            print(path)
        for sentence in missing(sweep, record).values():
            print(f"left out: {sentence}")
