"""``vibrosweep boundaries``: trace bifurcations of periodic orbits over a plane."""

from __future__ import annotations

import argparse
from typing import Final

from vibrosweep.commands.arguments import add_lines
from vibrosweep.commands.picture import add_common, produce

NAME: Final = "boundaries"
HELP: Final = "trace bifurcations of periodic orbits over a plane"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_common(parser, "a grid over restitution and the forcing")
    add_lines(parser)


def perform(options: argparse.Namespace) -> None:
    from vibrosweep.analysis.branches import boundaries_of_spec
    from vibrosweep.api.result_kinds import BOUNDARIES

    wanted = options.impacts, options.periods
    produce(
        options,
        BOUNDARIES,
        lambda spec, threads: boundaries_of_spec(
            spec, wanted, options.doublings, options.points, threads
        ),
    )
