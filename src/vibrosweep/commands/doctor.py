"""``vibrosweep doctor``: find problems of this installation and their remedies."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from vibrosweep.commands.arguments import some

NAME: Final = "doctor"
HELP: Final = "examine the installation and this machine; exit code 1 if anything is wrong"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add nothing: the command has no arguments."""


def perform(options: argparse.Namespace) -> int:
    """Perform the command; return 1 if anything is wrong."""
    from vibrosweep.doctor import examine

    wrong = 0
    for finding in examine(Path.cwd()):
        print("\n".join(finding.lines()), flush=True)
        wrong += bool(finding.trouble)
    print(f"{some(wrong, 'problem')}, marked WRONG above" if wrong else "all is well")
    return 1 if wrong else 0
