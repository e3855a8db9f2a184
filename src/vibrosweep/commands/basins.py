"""``vibrosweep basins``: colour launches by the attractor that they lead to."""

from __future__ import annotations

import argparse

from vibrosweep.commands.picture import add_common, produce


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_common(
        parser,
        "a grid over launch_velocity, optionally also over a forcing or the restitution; its "
        "particles give the launch times",
    )


def perform(options: argparse.Namespace) -> None:
    from vibrosweep.analysis.basins import basins
    from vibrosweep.api.result_kinds import BASINS

    produce(options, BASINS, basins)
