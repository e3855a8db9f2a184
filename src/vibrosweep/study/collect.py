"""All claims in their order: words from ``texts.toml``, outcomes from computation."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from importlib.resources import files
from typing import Any, Final

from vibrosweep.runs.progress import Advance, silent
from vibrosweep.study import contact, energy, heights, laboratory, order, scheme, stability
from vibrosweep.study.verdict import Claim, Outcome

__all__ = ["TESTS", "judge_all", "texts"]

TESTS: Final[Mapping[int, Callable[[int], Outcome]]] = {
    1: energy.decay,
    2: energy.balance,
    3: order.preserved,
    4: order.staggering,
    5: stability.windows,
    6: stability.linearised_update,
    7: heights.plateau,
    8: stability.period_two,
    9: order.bounded_and_ordered,
    10: contact.separation_stays_positive,
    11: contact.heights_differ,
    12: scheme.step_of_one_millisecond,
    13: laboratory.measured_and_predicted,
}


def texts() -> dict[str, Any]:
    """The words of the page; each text is one line."""
    raw = files("vibrosweep.study").joinpath("texts.toml").read_text(encoding="utf-8")
    found = tomllib.loads(raw)
    claims = {
        int(number): {key: " ".join(text.split()) for key, text in words.items()}
        for number, words in found.pop("claim").items()
    }
    return {key: " ".join(text.split()) for key, text in found.items()} | {"claims": claims}


def judge_all(threads: int, advance: Advance = silent) -> list[Claim]:
    """Compute the outcome of every claim.

    Parameters
    ----------
    threads
        Number of threads; the result does not depend on it.
    advance
        Called after each claim with the number of claims done and that of all.
    """
    words = texts()["claims"]
    claims = []
    for number, test in TESTS.items():
        outcome = test(threads)
        claims.append(_claim(number, words[number], outcome))
        advance(len(claims), len(TESTS))
    return claims


def _claim(number: int, words: Mapping[str, str], outcome: Outcome) -> Claim:
    return Claim(
        number=number,
        source=words["source"],
        sentence=words["sentence"],
        method=words["method"],
        condition=words.get("condition", ""),
        reason=words["reason"],
        outcome=outcome,
    )
