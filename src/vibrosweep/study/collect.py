"""All claims in their order: words from ``texts.toml``, outcomes from computation."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from importlib.resources import files
from typing import Any, Final

from vibrosweep.runs.progress import Advance, silent
from vibrosweep.study import (
    claims_on_contact,
    claims_on_energy,
    claims_on_heights,
    claims_on_laboratory,
    claims_on_order,
    claims_on_scheme,
    claims_on_stability,
)
from vibrosweep.study.verdict import Claim, Outcome

__all__ = ["TESTS", "judge_all", "texts"]

TESTS: Final[Mapping[int, Callable[[int], Outcome]]] = {
    1: claims_on_energy.decay,
    2: claims_on_energy.balance,
    3: claims_on_order.preserved,
    4: claims_on_order.staggering,
    5: claims_on_stability.windows,
    6: claims_on_stability.linearised_update,
    7: claims_on_heights.plateau,
    8: claims_on_stability.period_two,
    9: claims_on_order.bounded_and_ordered,
    10: claims_on_contact.separation_stays_positive,
    11: claims_on_contact.heights_differ,
    12: claims_on_scheme.step_of_one_millisecond,
    13: claims_on_laboratory.measured_and_predicted,
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
