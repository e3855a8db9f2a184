"""``vibrosweep bifurcation``: follow orbits up and down the forcing."""

from __future__ import annotations

import argparse

from vibrosweep.commands.arguments import positive
from vibrosweep.commands.picture import add_common, produce


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_common(parser, "a grid over the forcing")
    parser.add_argument(
        "--observable", metavar="NAME", default="rebound_velocity", help="default: rebound_velocity"
    )
    parser.add_argument(
        "--samples", metavar="N", type=positive, default=64, help="impacts kept; default: 64"
    )
    parser.add_argument(
        "--launches",
        metavar="N",
        type=positive,
        default=8,
        help="particles launched anew at each point; default: 8",
    )


def perform(options: argparse.Namespace) -> None:
    from vibrosweep.analysis.bifurcation import bifurcation
    from vibrosweep.api.result_kinds import BIFURCATION

    produce(
        options,
        BIFURCATION,
        lambda spec, threads: bifurcation(
            spec, options.observable, options.samples, options.launches, threads
        ),
    )
