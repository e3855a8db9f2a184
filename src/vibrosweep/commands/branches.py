"""``vibrosweep branches``: periodic orbits along a parameter, and their bifurcations."""

from __future__ import annotations

import argparse
from functools import partial

from vibrosweep.commands.arguments import add_lines, lines_of
from vibrosweep.commands.picture import add_common, produce


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_common(parser, "a grid over restitution, or over the forcing")
    add_lines(parser)


def perform(options: argparse.Namespace) -> None:
    from vibrosweep.analysis.branches import branches
    from vibrosweep.api.result_kinds import BRANCHES

    produce(options, BRANCHES, partial(branches, **lines_of(options)))
