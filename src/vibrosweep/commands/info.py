"""``vibrosweep info``: show what a result file holds."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("result", metavar="OUT.h5", type=Path)


def perform(options: argparse.Namespace) -> None:
    from vibrosweep.commands.describe import describe

    print("\n".join(describe(options.result)))
