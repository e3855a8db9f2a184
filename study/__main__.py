"""``python -m study``: judge every claim of the study; write a page and a JSON file.

The exit code is 0 for success, 2 for an error, whose message gives the remedy, 130 after an
interruption.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from vibrosweep.errors import VibrosweepError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code."""
    options = _parser().parse_args(arguments)
    try:
        _perform(options)
    except (VibrosweepError, OSError) as error:
        print(f"study: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("study: interrupted; nothing was written", file=sys.stderr)
        return 130
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m study",
        description="Judge every claim of the study by computation; write a page and a JSON file.",
    )
    parser.add_argument(
        "-o", "--output", metavar="DIR", type=Path, default=Path("claims"), help="default: claims"
    )
    parser.add_argument("--pictures", action="store_true", help="write the figures as PNG too")
    parser.add_argument("--threads", metavar="N", type=int, help="default: all processors")
    return parser


def _perform(options: argparse.Namespace) -> None:
    from study.claims_page import BASES, plain
    from study.collect import judge_all
    from study.report import prepare, provenance, write
    from study.samples import Plan

    prepare(options.output)
    began = time.perf_counter()
    origin = provenance(options.threads)
    claims = []
    for claim in judge_all(Plan(int(origin["threads"]))):
        print(f"{claim.key:3s} {plain(claim.sentence)}")
        for one in claim.outcome.evidence:
            print(f"      {BASES.get(one.base, 'any base'):20s}  {one.verdict.value}", flush=True)
        claims.append(claim)
    written = write(claims, options.output, origin, pictures=options.pictures)
    print(f"{time.perf_counter() - began:.1f} s")
    for path in written:
        print(path)


if __name__ == "__main__":
    sys.exit(main())
