"""``python -m study``: judge claims of the study by computation; write a page and a JSON file.

Without options it takes quick samples.  The page grows as claims are decided, and the same command
resumes a campaign that was stopped.  The exit code is 0 for success, 2 for an error, whose message
gives the remedy, 130 after an interruption.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from vibrosweep.errors import VibrosweepError

if TYPE_CHECKING:
    from study.verdict import Claim


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code."""
    options = _parser().parse_args(arguments)
    try:
        _perform(options)
    except (VibrosweepError, OSError) as error:
        print(f"study: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(
            "study: interrupted; the same command resumes at the claim that was interrupted",
            file=sys.stderr,
        )
        return 130
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m study",
        description="Judge claims of the study by computation; write a page and a JSON file.",
        epilog="example: python -m study --claims 4 9",
    )
    parser.add_argument(
        "--full",
        action="store_true",
        help="the samples from which verdicts are published, instead of quick ones",
    )
    parser.add_argument(
        "--claims", metavar="NUMBER", nargs="+", default=[], help="default: all claims"
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help="default: claims with --full, else claims-quick",
    )
    parser.add_argument("--pictures", action="store_true", help="write the figures as PNG too")
    parser.add_argument("--threads", metavar="N", type=int, help="default: all processors")
    return parser


def _perform(options: argparse.Namespace) -> None:
    from study.campaign import FULL, QUICK, Campaign, chosen
    from study.report import prepare, provenance, write

    keys = chosen(options.claims)
    directory = options.output or Path("claims" if options.full else "claims-quick")
    prepare(directory)
    began = time.perf_counter()
    origin = provenance(options.threads)
    plan = replace(FULL if options.full else QUICK, threads=int(origin["threads"]))
    campaign = Campaign(plan, keys, directory, origin["libraries"])
    print(*campaign.forecast(), sep="\n", flush=True)
    claims: list[Claim] = []
    written: list[Path] = []
    for claim in campaign.judged():
        claims.append(claim)
        state = campaign.state(len(claims))
        written = write(claims, directory, origin, state=state, pictures=options.pictures)
        _say(claim)
    campaign.forget()
    print(f"{time.perf_counter() - began:.1f} s")
    for path in written:
        print(path)


def _say(claim: Claim) -> None:
    from study.claims_page import BASES, plain

    print(f"{claim.key:3s} {plain(claim.sentence)}")
    for one in claim.outcome.evidence:
        print(f"      {BASES.get(one.base, 'any base'):20s}  {one.verdict.value}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
