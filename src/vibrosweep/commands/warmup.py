"""``vibrosweep warmup``: compile kernels in advance, so that common scenes need not wait."""

from __future__ import annotations

import argparse
import time

from vibrosweep.commands.arguments import some


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add nothing: the command has no arguments."""


def perform(options: argparse.Namespace) -> None:
    from vibrosweep.doctor.warmup import warm_up

    began = time.perf_counter()
    compiled = warm_up()
    print(
        f"{some(compiled.made, 'variant')} compiled, {compiled.kept} found on disk, in "
        f"{time.perf_counter() - began:.3g} s; kept in {compiled.directory}"
    )
