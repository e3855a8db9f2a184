"""``vibrosweep orbits``: search for periodic orbits, whether they attract or not."""

from __future__ import annotations

import argparse
from functools import partial

from vibrosweep.commands.arguments import positive
from vibrosweep.commands.picture import add_common, produce


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_common(parser, "the sweep whose realizations are searched for orbits")
    for name, words in (("impacts", "impacts"), ("periods", "forcing periods")):
        parser.add_argument(
            f"--{name}",
            metavar="N",
            type=positive,
            default=4,
            help=f"largest number of {words} of an orbit; default: 4",
        )


def perform(options: argparse.Namespace) -> None:
    from vibrosweep.analysis.orbits import SEEDS, orbits
    from vibrosweep.api.result_kinds import ORBITS

    wanted = {"impacts": options.impacts, "periods": options.periods, "seeds": SEEDS}
    produce(options, ORBITS, partial(orbits, **wanted))
