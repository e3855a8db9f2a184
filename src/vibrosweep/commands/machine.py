"""The machine: what is wrong with the installation, and kernels that are compiled in advance."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Final

from vibrosweep.commands.arguments import some


def add_doctor(parser: argparse.ArgumentParser) -> None:
    """Add nothing: the command has no arguments."""


def doctor(options: argparse.Namespace) -> int:
    """Perform the command; return 1 if anything is wrong."""
    from vibrosweep.doctor import findings

    wrong = 0
    for finding in findings(Path.cwd()):
        print("\n".join(finding.lines()), flush=True)
        wrong += bool(finding.trouble)
    print(f"{some(wrong, 'problem')}, marked WRONG above" if wrong else "all is well")
    return 1 if wrong else 0


def add_warmup(parser: argparse.ArgumentParser) -> None:
    """Add nothing: the command has no arguments."""


def warmup(options: argparse.Namespace) -> None:
    from vibrosweep.doctor.warmup import warm_up

    began = time.perf_counter()
    compiled = warm_up()
    print(
        f"{some(compiled.made, 'variant')} compiled, {compiled.kept} found on disk, in "
        f"{time.perf_counter() - began:.3g} s; kept in {compiled.directory}"
    )


COMMANDS: Final = {"doctor": (add_doctor, doctor), "warmup": (add_warmup, warmup)}
