"""The command line: parse, call, and turn errors into exit codes.

0 means success, 1 that `verify` or `doctor` found something wrong, 2 an error, whose message gives
the remedy, 130 an interruption.  Modules are imported when a command needs them, so that ``--help``
answers at once.
"""

from __future__ import annotations

import _thread
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
from collections.abc import Collection, Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any, Final, NoReturn

from vibrosweep._version import __version__
from vibrosweep.commands import COMMANDS, add_arguments
from vibrosweep.errors import Interruption, ParameterError, VibrosweepError
from vibrosweep.mistakes import CHUNK, COMMAND_LINE, Text, cut, nearest
from vibrosweep.system import ENDINGS, POLL

DONE, MISTAKE, INTERRUPTED = 0, 2, 130
DISCARDED: Final = "interrupted; the unfinished result was discarded"
OBJECTS_BETWEEN_COLLECTIONS: Final = 50_000  # new objects between garbage collections
PATIENCE: Final = 2.0  # seconds in which repeated interruptions count as one


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code.

    Without `arguments`, take those of the process, and prepare its streams, signals and exit too.
    """
    if arguments is not None:
        return _perform(arguments)
    came: list[float] = []
    try:
        _catch_signals(came)
        _prepare_output()
        # imports and compilation create many objects and little garbage: collections every 700
        # objects took a tenth of their time, and the collection at exit 0.1 s
        gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)
        atexit.register(gc.freeze)
        # commands draw into files only, and a notebook's backend may not be installed
        os.environ["MPLBACKEND"] = "agg"
        code = _perform(sys.argv[1:])
    # before or after the command itself; libraries turn an interruption of their own start into
    # other errors
    except BaseException as error:
        if not (came or isinstance(error, KeyboardInterrupt)):
            raise
        _complain(DISCARDED)
        code = INTERRUPTED
    finally:
        _handle_signals(signal.SIG_IGN)  # all files are complete: nothing may disturb the exit
    if code == INTERRUPTED:
        _leave()
    return code


def _perform(arguments: Sequence[str]) -> int:
    options = argparse.Namespace()
    try:
        _refuse_unknown(arguments)
        _parser(arguments[:1]).parse_args(arguments, options)
        code: int | None = options.perform(options)
        sys.stdout.flush()
    except VibrosweepError as error:
        _complain(error.parts)
        return MISTAKE
    except MemoryError as error:
        remedy = ("lower ", CHUNK) if "chunk" in options else "take fewer points or particles"
        _complain((f"not enough memory: {error}; ", remedy, ", or close other programs"))
        return MISTAKE
    except KeyboardInterrupt as error:
        _complain(error.parts if isinstance(error, Interruption) else DISCARDED)
        return INTERRUPTED
    except BrokenPipeError:  # the reader has closed the pipe, as `head` does
        _drop_output()
        return DONE
    except OSError as error:
        _complain(str(error))
        _drop_output()
        return MISTAKE
    return code or DONE


def _complain(message: Text) -> None:
    with suppress(OSError):
        print(f"vibrosweep: {COMMAND_LINE.write(message)}", file=sys.stderr, flush=True)


def _drop_output() -> None:
    """Discard further output, because standard output is closed or fails."""
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _prepare_output() -> None:
    """Make any title or path printable in any locale, even if no stream is open."""
    sys.stdout = sys.stdout or io.StringIO()
    sys.stderr = sys.stderr or io.StringIO()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _catch_signals(came: list[float]) -> None:
    """Turn every signal that ends a program into one KeyboardInterrupt, even if it is repeated.

    `came` receives the times of those that did.
    """

    def interrupt(number: int, frame: object) -> None:
        now = time.monotonic()
        if not came or now - came[-1] > PATIENCE:
            came.append(now)
            raise KeyboardInterrupt

    def unraisable(lost: sys.UnraisableHookArgs) -> None:
        # destructors and callbacks drop exceptions, and so interruptions; a file object that could
        # not be opened reports its error again when it is deleted
        if issubclass(lost.exc_type, KeyboardInterrupt):
            threading.Timer(POLL, _interrupt_again, [came]).start()

    _handle_signals(interrupt)
    sys.unraisablehook = unraisable


def _interrupt_again(came: list[float]) -> None:
    came.append(-math.inf)
    for number in ENDINGS:
        _thread.interrupt_main(number)


def _handle_signals(handler: Any) -> None:
    if threading.current_thread() is threading.main_thread():
        for number in ENDINGS:
            # ignored signals stay ignored, as under nohup
            if signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, handler)


def _leave() -> NoReturn:
    """End the process after an interruption, even if a kernel, which has no interrupt, is running.

    Python itself may abort where an interruption came in the middle of an import.
    """
    for thread in threading.enumerate():
        if thread is not threading.current_thread() and not thread.daemon and thread.ident:
            thread.join(timeout=0.2)
    with suppress(BaseException):
        atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(INTERRUPTED)


def _refuse_unknown(arguments: Sequence[str]) -> None:
    """Raise a ParameterError for a command that there is not, with the one that was meant."""
    for word in arguments:
        if word.startswith("--") and word.endswith("=--"):  # argparse would take it for no value
            raise ParameterError(f"{cut(word)}: is not a value; see vibrosweep COMMAND --help")
    if not arguments or arguments[0].startswith("-") or arguments[0] in COMMANDS:
        return
    guess = nearest(arguments[0], COMMANDS)
    hint = f'did you mean "{guess}"?' if guess else f"there are {', '.join(COMMANDS)}"
    raise ParameterError(f"{cut(repr(arguments[0]))} is not a command; {hint}")


class _Completion(argparse.Action):
    """Print a script that lets a shell complete commands and options, and exit."""

    def __call__(self, parser: object, options: object, shell: Any, option: object = None) -> None:
        try:
            import shtab
        except ImportError as error:
            raise VibrosweepError(
                "the script is written by shtab, which is not installed: "
                'pip install "vibrosweep[completion]"'
            ) from error
        print(shtab.complete(_parser(COMMANDS), shell))
        raise SystemExit(DONE)


def _parser(called: Collection[str]) -> argparse.ArgumentParser:
    """Return the parser, with the arguments of the commands that are `called`."""
    parser = argparse.ArgumentParser(
        prog="vibrosweep", description="Parameter sweeps of the bouncing ball (vibro-impact)."
    )
    parser.add_argument("--version", action="version", version=f"vibrosweep {__version__}")
    parser.add_argument(
        "--print-completion",
        action=_Completion,
        choices=("bash", "zsh", "tcsh"),
        help="print a script that lets the shell complete commands and options",
    )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    for name, command in COMMANDS.items():
        example = f"example: {command.example}" if command.example else None
        added = commands.add_parser(
            name, help=command.words, description=command.words, epilog=example
        )
        if name in called:
            file, _, function = command.function.partition(".")
            module = import_module(f"vibrosweep.commands.{file}")
            if command.arguments is None:
                module.add_arguments(added)
            else:
                add_arguments(added, *command.arguments)
            added.set_defaults(perform=getattr(module, function), command=name)
    return parser
