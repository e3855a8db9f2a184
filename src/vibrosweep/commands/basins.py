"""``vibrosweep basins``: colour launches by the attractor that they lead to."""

from __future__ import annotations

import argparse
from typing import Final

from vibrosweep.commands.picture import add_common, produce

NAME: Final = "basins"
HELP: Final = "tell which attractor each launch leads to"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_common(
        parser,
        "a grid over launch_velocity, and over a forcing or restitution if need be; its particles "
        "give the launch times",
    )


def perform(options: argparse.Namespace) -> None:
    from vibrosweep.analysis.basins import basins
    from vibrosweep.api.result_kinds import BASINS

    produce(options, BASINS, basins)
