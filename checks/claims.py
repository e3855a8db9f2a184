"""The verdicts on the study, from two sets of seeds.

    python checks/claims.py [--realizations N] [--threads N] [--claims 4a,14] [--write]

A verdict must be the same for 20 other seeds, unless one of the two says that it cannot be judged.
The exit code is 1 if one changes.  --write replaces the table of verdicts in
study/claims.md by that of the first seeds; --claims judges some of the claims and
replaces their rows.
"""

from __future__ import annotations

import re
import sys
import time
from pathlib import Path

from accuracy import options_of, provenance, table, write_section

sys.path.append(str(Path(__file__).parents[1]))  # the directory of the study

from study.claims_page import BASES, brief_reason, plain
from study.collect import TESTS, judge_all
from study.samples import Plan
from study.verdict import ANY_BASE, Verdict

PAGE = Path(__file__).parents[1] / "study" / "claims.md"
SEEDS = 20
FIRST_SEEDS = (0, 1000)
# On the base of finite mass a condition speaks of two particles; the docs use the other wording
ONE_NAME = "two particles in separate slots", "each particle in its own slot"
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
    """Cells of the table in the docs; conditions omit flight heights, which are given below it."""
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


def known():
    """Cells of the present table in the docs by claim, and the line below the table."""
    section = PAGE.read_text(encoding="utf-8").partition("<!-- begin verdicts -->\n")[2]
    lines = section.partition("\n<!-- end verdicts -->")[0].splitlines()
    cells = (line.strip("| ").split(" | ") for line in lines[2:] if line.startswith("|"))
    return {key: [key, *rest] for key, *rest in cells}, lines[-1]


def main():
    some = "numbers of claims; all by default"
    options = options_of(__doc__, realizations=Plan.realizations, threads=2, claims=("", some))
    keys = options.claims.split(",") if options.claims else list(TESTS)
    judged, seconds = [], []
    for first in FIRST_SEEDS:
        began = time.process_time()
        plan = Plan(options.threads, first, SEEDS, options.realizations)
        judged.append(list(judge_all(plan, keys)))
        seconds.append(time.process_time() - began)
        print(f"seeds from {first}: {seconds[-1]:.0f} s of processor time")
    first, second = map(verdicts, judged)
    for key, verdict in first.items():
        if verdict is not second[key]:
            print(f"claim {key[0]}, {key[1]}: {verdict.value}; other seeds: {second[key].value}")
    found, origin = known() if options.claims else ({}, provenance(seconds[0], None))
    found |= {key: [key, *rest] for key, *rest in rows(judged[0])}
    cells = [found[key] for key in TESTS if key in found]
    text = f"{table(['', 'claim', *BASES.values()], cells)}\n\n{origin}"
    if options.write:
        write_section("verdicts", text, PAGE)
    else:
        print(text)
    sys.exit(bool(turned(first, second)))


if __name__ == "__main__":
    main()
