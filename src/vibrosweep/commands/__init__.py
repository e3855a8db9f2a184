"""The commands and their arguments, in one table, and what the files that perform them share.

A command is performed by a function of one argument, the options, that returns an exit code, or
None for success.  Its module is imported when it is called, others when it runs.
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from vibrosweep.mistakes import cut
from vibrosweep.system import MOST_THREADS

MOST: Final = 2**53  # the largest count that a double still holds
ORIGIN: Final = re.compile(r"https?://[\w.-]+(:\d+)?|https?://\[[\da-fA-F:]+\](:\d+)?")
LAST_PORT: Final = 65535


def positive(text: str) -> int:
    """Read a whole number of at least 1."""
    return whole(text, 1)


def threads(text: str) -> int:
    """Read a number of threads or processes."""
    return whole(text, 1, MOST_THREADS)


def whole(text: str, low: int = 0, high: int = MOST) -> int:
    """Read a whole number of at least `low`, and at most `high`."""
    # Python refuses to read thousands of digits
    value = int(text) if text.isdecimal() and len(text) < 1000 else -1
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(
            f"{cut(text)!r} is not a whole number of at least {low} and at most {high}"
        )
    return value


def output_file(text: str) -> Path:
    """Read the path of a file to write."""
    path = Path(text)
    if not text or path.name in ("", ".."):
        raise argparse.ArgumentTypeError(f"{text!r} is not the name of a file")
    return path


def directory(text: str) -> Path:
    """Read the path of a directory."""
    if not text:
        raise argparse.ArgumentTypeError("'' is not the name of a directory")
    return Path(text)


def port(text: str) -> int:
    """Read the number of a port; 0 stands for a free one."""
    return whole(text, 0, LAST_PORT)


def origin(text: str) -> str:
    """Read the origin of a web page: a scheme and a host."""
    if not ORIGIN.fullmatch(text):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no origin: give a scheme and a host, such as https://hub.example.org, "
            f"without a path"
        )
    return text


class Argument(NamedTuple):
    """An argument: its name or flags, and its settings for `argparse`."""

    flags: tuple[str, ...]
    settings: Mapping[str, Any]

    def add_to(self, parser: Any) -> None:
        """Add the argument to a parser, or to a group of one."""
        parser.add_argument(*self.flags, **self.settings)


def argument(*flags: str, **settings: Any) -> Argument:
    """Describe an argument as `argparse.ArgumentParser.add_argument` takes it."""
    return Argument(flags, settings)


def number(name: str, words: str, default: int, metavar: str = "N") -> Argument:
    """Describe an option that is a whole number, at least 1 unless its default is 0."""
    kind, text = positive if default else whole, f"{words}; default: {default}"
    return argument(f"--{name}", metavar=metavar, type=kind, default=default, help=text)


def spec(holds: str) -> Argument:
    """Describe the sweep file of a command, which must hold what the words say."""
    return argument("spec", metavar="SPEC.toml", type=Path, help=holds)


def folder(default: Path, words: str) -> Argument:
    """Describe the folder of the output."""
    return argument("-o", "--output", metavar="DIR", type=directory, default=default, help=words)


RESULT: Final = argument("result", metavar="OUT.h5", type=Path, help="the result")
OUTPUT: Final = argument(
    "-o",
    "--output",
    metavar="OUT.h5",
    type=output_file,
    help="result file; by default it has the name of the sweep file, and of an analysis",
)
FORCE: Final = argument("--force", action="store_true", help="replace existing outputs")
THREADS: Final = argument("--threads", metavar="N", type=threads, help="threads; default: all")
CHUNK: Final = argument(
    "--chunk",
    metavar="N",
    type=positive,
    help="realizations in a chunk; each finished chunk is saved",
)
JSON: Final = argument(
    "--json", action="store_true", help="print one JSON object in place of lines"
)
QUIET: Final = argument("-q", "--quiet", action="store_true", help="print errors only")
# Of an analysis, after its sweep file
OF_ANALYSES: Final = (OUTPUT, THREADS, FORCE, JSON, QUIET)
# Of the analyses of lines of orbits
OF_LINES: Final = (
    number("impacts", "largest number of impacts of an orbit", 1),
    number("periods", "largest number of its forcing periods", 1),
    number("doublings", "number of successive doublings whose new orbits are continued", 0),
    number("points", "largest number of points of a line in each direction", 1000),
)


class Command(NamedTuple):
    """What ``vibrosweep --help`` says about a command, what performs it, and its arguments."""

    words: str
    function: str  # that performs it, after its module
    example: str = ""
    # Those in a tuple exclude each other; None: the module's function ``add_arguments`` adds them
    arguments: tuple[Argument | tuple[Argument, ...], ...] | None = None


# In the order in which ``vibrosweep --help`` lists them
COMMANDS: Final[Mapping[str, Command]] = {
    "examples": Command(
        "list the example sweeps, or copy some of them",
        "sweeps.examples",
        "vibrosweep examples paper",
        (
            argument("names", metavar="NAME", nargs="*", help="example to copy, as listed"),
            argument("--all", action="store_true", help="copy all"),
            folder(Path(), "folder for the copies; default: here"),
            FORCE,
        ),
    ),
    "plan": Command(
        "estimate the time, memory and disk that a sweep takes",
        "sweeps.plan",
        "vibrosweep plan paper.toml --threads 8",
        (spec("the sweep file"), OUTPUT, THREADS, CHUNK, JSON),
    ),
    "run": Command(
        "compute a sweep file",
        "sweeps.run",
        "vibrosweep run paper.toml -o paper.h5",
        (
            spec("the sweep file"),
            OUTPUT,
            (
                THREADS,
                argument(
                    "--workers",
                    metavar="N",
                    type=threads,
                    help="compute in N processes of a thread each (Dask)",
                ),
                argument(
                    "--scheduler",
                    metavar="ADDRESS",
                    help="compute on the Dask cluster of this scheduler, as tcp://host:8786",
                ),
            ),
            CHUNK,
            argument("--force", action="store_true", help="replace an output or unfinished run"),
            argument(
                "--retry-failed",
                action="store_true",
                help="recompute the realizations of a result that did not complete",
            ),
            argument(
                "--impact-budget",
                metavar="N",
                type=positive,
                help="with --retry-failed: impacts after which a particle is abandoned",
            ),
            JSON,
            QUIET,
        ),
    ),
    "info": Command(
        "show what a result file holds",
        "results.info",
        "vibrosweep info paper.h5",
        (RESULT, JSON),
    ),
    "figures": Command(
        "draw the figures of a result file",
        "results.figures",
        "vibrosweep figures paper.h5 -o figures",
        (RESULT, folder(Path("figures"), "folder for the figures; default: figures"), QUIET),
    ),
    "explore": Command(
        "look at a result in a browser, and at the motion behind every point of it",
        "results.explore",
        "vibrosweep explore plane.h5",
        (
            RESULT,
            argument(
                "-o",
                "--output",
                metavar="PAGE.html",
                type=output_file,
                help="write one file that works without this program, instead of serving the page",
            ),
            argument(
                "--boundaries",
                metavar="BORDERS.h5",
                type=Path,
                help="result of vibrosweep boundaries, whose curves are drawn over the plane",
            ),
            FORCE,
            argument("--port", metavar="N", type=port, default=0, help="port; default: a free one"),
            argument(
                "--frame-in",
                metavar="ORIGIN",
                type=origin,
                action="append",
                default=[],
                help="site that may show the page in a frame, such as https://hub.example.org; "
                "repeatable",
            ),
        ),
    ),
    "windows": Command(
        "find the intervals of the forcing in which conditions hold",
        "pictures.perform",
        "vibrosweep windows windows.toml",
        (spec("a grid, or ranges, of the forcing, with [windows]"), *OF_ANALYSES),
    ),
    "bifurcation": Command(
        "continue orbits up and down the forcing, and draw them",
        "pictures.perform",
        "vibrosweep bifurcation bifurcation.toml --samples 200",
        (
            spec("a grid over the forcing"),
            *OF_ANALYSES,
            argument(
                "--observable",
                metavar="NAME",
                default="rebound_velocity",
                help="quantity to draw; default: rebound_velocity",
            ),
            number("samples", "impacts at each point; four times as many if aperiodic", 64),
            number("launches", "new launches at each point", 8),
        ),
    ),
    "basins": Command(
        "find the attractor that each launch leads to, and draw the basins",
        "pictures.perform",
        "vibrosweep basins basins.toml",
        (
            spec(
                "a grid over launch_velocity, optionally also over a forcing or the restitution; "
                "its particles give the launch times"
            ),
            *OF_ANALYSES,
        ),
    ),
    "orbits": Command(
        "search for periodic orbits, whether they attract or not",
        "pictures.perform",
        "vibrosweep orbits orbits.toml --impacts 2 --periods 3",
        (
            spec("the sweep whose realizations are searched for orbits"),
            *OF_ANALYSES,
            number("impacts", "largest number of impacts of an orbit", 4),
            number("periods", "largest number of forcing periods of an orbit", 4),
        ),
    ),
    "branches": Command(
        "continue periodic orbits along a parameter, and find their bifurcations",
        "pictures.perform",
        "vibrosweep branches branches.toml --doublings 2",
        (spec("a grid over restitution, or over the forcing"), *OF_ANALYSES, *OF_LINES),
    ),
    "boundaries": Command(
        "trace bifurcations of periodic orbits over a plane",
        "pictures.perform",
        "vibrosweep boundaries boundaries.toml --periods 2",
        (spec("a grid over restitution and the forcing"), *OF_ANALYSES, *OF_LINES),
    ),
    "verify": Command(
        "compare a result file with proved values",
        "results.verify",
        "vibrosweep verify paper.h5 --sample 50",
        (
            RESULT,
            number("sample", "realizations drawn", 20, "K"),
            number("seed", "seed of the draw", 0, "S"),
            argument(
                "--max-landings",
                metavar="N",
                type=positive,
                help="leave out realizations with more landings; default: 250000, which take some "
                "ten seconds, or 1000 over a sprung base",
            ),
            JSON,
            QUIET,
        ),
    ),
    "lab": Command("measure camera tracks and compare them with prediction", "lab.perform"),
    "doctor": Command(
        "examine the installation and this machine; exit code 1 if anything is wrong",
        "sweeps.doctor",
        "vibrosweep doctor",
        (JSON, QUIET),
    ),
    "warmup": Command(
        "compile the kernels of common scenes in advance",
        "sweeps.warmup",
        "vibrosweep warmup",
        (QUIET,),
    ),
}


def add_arguments(parser: argparse.ArgumentParser, *added: Argument | tuple[Argument, ...]) -> None:
    """Add arguments to a parser; those in a tuple exclude each other."""
    for one in added:
        if isinstance(one, Argument):
            one.add_to(parser)
            continue
        group = parser.add_mutually_exclusive_group()
        for alternative in one:
            alternative.add_to(group)


def say(options: argparse.Namespace, *lines: str) -> None:
    """Print lines, unless `options` request JSON or silence."""
    if lines and not (getattr(options, "quiet", False) or getattr(options, "json", False)):
        print("\n".join(lines), flush=True)


def tell(options: argparse.Namespace, facts: Mapping[str, Any]) -> None:
    """Print facts as one JSON object where `options` request it."""
    if options.json:
        import json

        print(json.dumps(_plain(facts), indent=2, ensure_ascii=False, allow_nan=False))


def _plain(value: Any) -> Any:
    """Return a value as JSON can hold it; numbers that are not finite become null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def some(number: int, thing: str) -> str:
    """Write a number of things: 1 particle, 2 particles."""
    return f"{number} {thing}{'' if number == 1 else 's'}"
