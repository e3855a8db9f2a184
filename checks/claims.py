"""The verdicts on the study, from two sets of seeds.

    python checks/claims.py [--realizations N] [--threads N] [--write]

A verdict must be the same for 20 other seeds, unless one of the two says that it cannot be judged.
Ends with 1 where one turns.  --write replaces the table of verdicts in
docs/separations-and-claims.md by that of the first seeds.
"""

from __future__ import annotations

import re
import sys
import time
from pathlib import Path

from accuracy import options_of, provenance, table, write_section

sys.path.append(str(Path(__file__).parents[1]))  # where the study stands

from study.claims_page import BASES, brief_reason, plain
from study.collect import judge_all
from study.samples import Plan
from study.verdict import ANY_BASE, Verdict

PAGE = Path(__file__).parents[1] / "docs" / "separations-and-claims.md"
SEEDS = 20
FIRST_SEEDS = (0, 1000)
# On the base of finite mass the condition is that of two particles
ONE_NAME = "two particles in slots of their own", "each particle in a slot of its own"
SHORT = {
    Verdict.HOLDS: "holds",
    Verdict.CONDITIONAL: "conditional",
    Verdict.OUTSIDE: "outside",
    Verdict.FAILS: "fails",
    Verdict.UNDECIDED: "undecided:",
}


def verdicts(claims):
    """Verdicts by claim and base."""
    return {(one.key, each.base): each.verdict for one in claims for each in one.outcome.evidence}


def turned(first, second):
    """List the claims that both sets of seeds decide, but differently."""
    undecided = Verdict.UNDECIDED
    return [
        key
        for key, verdict in first.items()
        if verdict is not second[key] and undecided not in (verdict, second[key])
    ]


def rows(claims):
    """Cells of the table in the docs, where the heights of flights stand below it."""
    for claim in claims:
        found = {
            one.base: f"{SHORT[one.verdict]} {brief_reason(one)}".rstrip()
            for one in claim.outcome.evidence
        }
        cells = [found.get(base, found.get(ANY_BASE, "-")) for base in BASES]
        brief = (re.sub(r" \(at 1 Hz, flights .*?\)", "", one) for one in claim.conditions)
        conditions = dict.fromkeys(one.replace(*ONE_NAME) for one in brief)
        if_so = f" *Condition:* {'; or '.join(conditions)}." if conditions else ""
        yield [claim.key, plain(claim.sentence) + if_so, *cells]


def main():
    options = options_of(__doc__, realizations=Plan.realizations, threads=2)
    judged, seconds = [], []
    for first in FIRST_SEEDS:
        began = time.process_time()
        judged.append(list(judge_all(Plan(options.threads, first, SEEDS, options.realizations))))
        seconds.append(time.process_time() - began)
        print(f"seeds from {first}: {seconds[-1]:.0f} s of processor time")
    first, second = map(verdicts, judged)
    for key, verdict in first.items():
        if verdict is not second[key]:
            print(f"claim {key[0]}, {key[1]}: {verdict.value}; other seeds: {second[key].value}")
    verdict_table = table(["", "claim", *BASES.values()], rows(judged[0]))
    text = f"{verdict_table}\n\n{provenance(seconds[0], None)}"
    if options.write:
        write_section("verdicts", text, PAGE)
    else:
        print(text)
    sys.exit(bool(turned(first, second)))


if __name__ == "__main__":
    main()
