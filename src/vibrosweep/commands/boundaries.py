"""``vibrosweep boundaries``: trace bifurcations of periodic orbits over a plane."""

from __future__ import annotations

import argparse
from functools import partial

from vibrosweep.commands.arguments import add_lines, lines_of
from vibrosweep.commands.picture import add_common, produce


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_common(parser, "a grid over restitution and the forcing")
    add_lines(parser)


def perform(options: argparse.Namespace) -> None:
    from vibrosweep.analysis.branches import boundaries
    from vibrosweep.api.result_kinds import BOUNDARIES

    produce(options, BOUNDARIES, partial(boundaries, **lines_of(options)))
