"""``vibrosweep verify``: compare a result file with proved values."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from vibrosweep.commands.arguments import positive, whole


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("result", metavar="OUT.h5", type=Path)
    parser.add_argument(
        "--sample", metavar="K", type=positive, default=20, help="realizations drawn; default: 20"
    )
    parser.add_argument("--seed", metavar="S", type=whole, default=0, help="default: 0")
    parser.add_argument(
        "--max-landings",
        metavar="N",
        type=positive,
        help="leave out realizations with more landings; default: 250000, which take some ten "
        "seconds, or 1000 over a sprung base",
    )


def perform(options: argparse.Namespace) -> int:
    """Perform the command; return 1 if a number contradicts its claim."""
    from vibrosweep.proof import verify
    from vibrosweep.runs.progress import reporting
    from vibrosweep.store.reading import using

    with using(options.result), reporting(sys.stderr) as advance:
        report = verify(
            options.result,
            sample=options.sample,
            seed=options.seed,
            max_landings=options.max_landings,
            advance=advance,
        )
    print("\n".join(report.lines()))
    return 0 if report.passed else 1
