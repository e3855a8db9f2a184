"""The machine: what is wrong with the installation, and kernels that are compiled in advance."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Final

from vibrosweep.commands.arguments import add_json, add_quiet, say, some, tell


def add_doctor(parser: argparse.ArgumentParser) -> None:
    add_json(parser)
    add_quiet(parser)


def doctor(options: argparse.Namespace) -> int:
    """Perform the command; return 1 if anything is wrong."""
    from vibrosweep.doctor import findings

    found = []
    for finding in findings(Path.cwd()):
        say(options, *finding.lines())
        found.append(finding)
    wrong = sum(bool(finding.trouble) for finding in found)
    say(options, f"{some(wrong, 'problem')}, marked WRONG above" if wrong else "all is well")
    tell(options, {"problems": wrong, "findings": [finding._asdict() for finding in found]})
    return 1 if wrong else 0


def add_warmup(parser: argparse.ArgumentParser) -> None:
    add_quiet(parser)


def warmup(options: argparse.Namespace) -> None:
    from vibrosweep.doctor.warmup import warm_up

    began = time.perf_counter()
    compiled = warm_up()
    say(
        options,
        f"{some(compiled.made, 'variant')} compiled, {compiled.kept} found on disk, in "
        f"{time.perf_counter() - began:.3g} s; stored in {compiled.directory}",
    )


COMMANDS: Final = {"doctor": (add_doctor, doctor), "warmup": (add_warmup, warmup)}
