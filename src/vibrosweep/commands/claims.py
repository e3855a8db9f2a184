"""``vibrosweep claims``: judge every claim of the study by computation."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Final

from vibrosweep.commands.arguments import positive

NAME: Final = "claims"
HELP: Final = "judge every claim of the study by computation; write a page and a JSON file"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-o", "--output", metavar="DIR", type=Path, default=Path("claims"), help="default: claims"
    )
    parser.add_argument("--pictures", action="store_true", help="write the figures as PNG too")
    parser.add_argument("--threads", metavar="N", type=positive, help="default: all processors")


def perform(options: argparse.Namespace) -> None:
    from vibrosweep.runs.driver import available_threads
    from vibrosweep.runs.progress import reporting
    from vibrosweep.study.claims_page import BASES, plain
    from vibrosweep.study.collect import judge_all
    from vibrosweep.study.report import prepare, write
    from vibrosweep.study.samples import Plan

    prepare(options.output)
    threads = options.threads or available_threads()
    began = time.perf_counter()
    with reporting(sys.stderr, "claims") as advance:
        claims = judge_all(Plan(threads), advance)
    written = write(claims, options.output, threads, pictures=options.pictures)
    for claim in claims:
        print(f"{claim.key:3s} {plain(claim.sentence)}")
        for one in claim.outcome.evidence:
            print(f"      {BASES.get(one.base, 'any base'):20s}  {one.verdict.value}")
    print(f"{time.perf_counter() - began:.1f} s")
    for path in written:
        print(path)
