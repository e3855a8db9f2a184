"""The command line: parse, call, and turn errors into exit codes.

0 means done, 1 that a verification failed, 2 a mistake that the message tells how to mend, 130 an
interruption.  What a command needs is imported when it runs, so that ``--help`` answers at once.
"""

from __future__ import annotations

import argparse
import atexit
import gc
import io
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final

from vibrosweep._version import __version__
from vibrosweep.errors import DataError, VibrosweepError

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["main"]

DONE, FAILED, MISTAKE, INTERRUPTED = 0, 1, 2, 130
PATIENCE: Final = 2.0  # seconds for which a second interruption is not one more


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code.

    Without `arguments` this is the command of the process, and it looks after its streams, its
    signals and its end.
    """
    if arguments is not None:
        return _perform(arguments)
    _prepare_output()
    # a file object that could not be opened complains of it again when it is thrown away
    sys.unraisablehook = lambda unraisable: None
    # the objects of large libraries live until the end: to sift them at exit took 0.1 s
    atexit.register(gc.freeze)
    with _interruptible():
        code = _perform(sys.argv[1:])
    if code == INTERRUPTED:
        _leave_kernels()
    return code


def _perform(arguments: Sequence[str]) -> int:
    options = _parser().parse_args(arguments)
    try:
        code: int | None = options.command(options)
        sys.stdout.flush()
    except VibrosweepError as error:
        _complain(str(error))
        return MISTAKE
    except MemoryError as error:
        _complain(f"not enough memory: {error}; lower --chunk, or close other programs")
        return MISTAKE
    except KeyboardInterrupt:
        _complain("interrupted; an unfinished result is not kept")
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output has gone, as `head` does
        _drop_output()
        return DONE
    except OSError as error:
        _complain(str(error))
        _drop_output()
        return MISTAKE
    return code or DONE


def _complain(message: str) -> None:
    with suppress(OSError):
        print(f"vibrosweep: {message}", file=sys.stderr, flush=True)


def _drop_output() -> None:
    """Let nothing more be written to a standard output that takes nothing."""
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _prepare_output() -> None:
    """Let any title or path be printed in any locale, and where no stream is open."""
    sys.stdout = sys.stdout or io.StringIO()
    sys.stderr = sys.stderr or io.StringIO()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


@contextmanager
def _interruptible() -> Iterator[None]:
    """Make every signal that ends a program interrupt it; impatient ones do not disturb that."""
    interrupted = -math.inf

    def interrupt(number: int, frame: object) -> None:
        nonlocal interrupted
        now = time.monotonic()
        if now - interrupted > PATIENCE:
            interrupted = now
            raise KeyboardInterrupt

    handlers = {}
    if threading.current_thread() is threading.main_thread():
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            ending = getattr(signal, name, None)
            # what is ignored stays so, as nohup wants it
            if ending is not None and signal.getsignal(ending) is not signal.SIG_IGN:
                handlers[ending] = signal.signal(ending, interrupt)
    yield
    for ending, handler in handlers.items():  # after an interruption the process only ends
        signal.signal(ending, handler if interrupted == -math.inf else signal.SIG_IGN)


def _leave_kernels() -> None:
    """End the process if a kernel still runs: it cannot be stopped and nobody waits for it."""
    for thread in threading.enumerate():
        if thread is not threading.current_thread() and not thread.daemon:
            thread.join(timeout=0.2)
            if thread.is_alive():
                with suppress(OSError):
                    sys.stdout.flush()
                os._exit(INTERRUPTED)


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

    verify = commands.add_parser("verify", help="hold a result file against proved values")
    verify.add_argument("result", metavar="OUT.h5", type=Path)
    verify.add_argument(
        "--sample", metavar="K", type=_positive, default=20, help="realizations drawn; default: 20"
    )
    verify.add_argument("--seed", metavar="S", type=_whole, default=0, help="default: 0")
    verify.add_argument(
        "--max-landings",
        metavar="N",
        type=_positive,
        default=250_000,
        help="leave out realizations with more; default: 250000, some ten seconds",
    )
    verify.set_defaults(command=_verify)
    return parser


def _positive(text: str) -> int:
    return _whole(text, 1)


def _whole(text: str, low: int = 0) -> int:
    value = int(text) if text.isdecimal() else -1
    if value < low:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least {low}")
    return value


def _run(options: argparse.Namespace) -> None:
    from vibrosweep.sweep.spec import read_spec

    spec = read_spec(options.spec)
    output = options.output or Path(f"{options.spec.stem}.h5")
    from vibrosweep.store.disk import check_output

    check_output(output, force=options.force, inputs=(options.spec, spec.table))
    gc.disable()  # importing makes many objects and hardly any garbage
    _leave_linear_algebra_out()
    from vibrosweep.sweep.progress import reporting
    from vibrosweep.sweep.run import available_threads, run_sweep

    gc.enable()
    threads = options.threads or available_threads()
    print(spec.title)
    began = time.perf_counter()
    with reporting(sys.stderr) as advance:
        summary = run_sweep(spec, output, threads=threads, chunk=options.chunk, advance=advance)
    seconds = time.perf_counter() - began
    print(
        f"{_some(summary.realizations, 'realization')} of {_some(spec.particles, 'particle')}, "
        f"{_some(summary.landings, 'landing')} in {seconds:.3g} s on {_some(threads, 'thread')}"
    )
    print("\n".join(summary.lines()))
    print(f"written to {output}")


def _some(number: int, thing: str) -> str:
    return f"{number} {thing}{'' if number == 1 else 's'}"


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
    from vibrosweep.api import has_record, open_record, open_sweep
    from vibrosweep.figures import missing, save_all

    # no figure of a sweep shows single particles, which may be many
    sweep = _loaded(options.result, open_sweep, "particle")
    record = _loaded(options.result, open_record) if has_record(options.result) else None
    for path in save_all(sweep, record, options.output):
        print(path)
    for sentence in missing(sweep, record).values():
        print(f"left out: {sentence}")


def _verify(options: argparse.Namespace) -> int:
    _leave_linear_algebra_out()
    from vibrosweep.sweep.progress import reporting
    from vibrosweep.verify import verify

    with reporting(sys.stderr) as advance:
        report = verify(
            options.result,
            sample=options.sample,
            seed=options.seed,
            max_landings=options.max_landings,
            advance=advance,
        )
    print("\n".join(report.lines()))
    return DONE if report.passed else FAILED


def _loaded(path: Path, opener: Callable[[Path], xr.Dataset], *without: str) -> xr.Dataset:
    """Read what figures are drawn from, but not along the dimensions `without`."""
    with opener(path) as dataset:
        try:
            return dataset.drop_dims(without, errors="ignore").load()
        except (OSError, RuntimeError) as error:
            raise DataError(f"{path}: is damaged; compute it again with vibrosweep run") from error
