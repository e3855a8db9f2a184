"""``vibrosweep windows``: find stability windows and draw them."""

from __future__ import annotations

import argparse

from vibrosweep.commands.picture import add_common, produce


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_common(parser, "a grid, or ranges, of the forcing, with [windows]")


def perform(options: argparse.Namespace) -> None:
    from vibrosweep.api.analyses import windows_found
    from vibrosweep.api.result_kinds import WINDOWS

    produce(options, WINDOWS, windows_found)
