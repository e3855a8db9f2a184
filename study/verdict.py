"""A claim, the evidence for it under each base, and the one rule by which evidence gives a verdict.

The words of the rule and of the claims stand in ``texts.toml``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import groupby
from typing import Final, Literal, SupportsFloat

from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from study.estimates import Estimate, exact, share

Relation = Literal["at most", "at least"]
# Of evidence that no base enters: geometry, weights, the film
ANY_BASE: Final = "any"
# A statement on all is granted where it is true of so large a share
NEARLY_ALL: Final = 0.95
# A statement on some, where it is true of so large a share
SOME: Final = 0.01


class Verdict(Enum):
    """What the evidence says."""

    HOLDS = "holds"
    CONDITIONAL = "holds under a condition"
    FAILS = "fails"
    UNDECIDED = "cannot be judged"


@dataclass(frozen=True)
class Number:
    """A computed number that informs, but is not part of a test."""

    what: str
    value: Estimate
    units: str = "1"


@dataclass(frozen=True)
class Check:
    """A computed number and the bound that it is held against."""

    what: str  # what the number is, in words
    value: Estimate  # as computed, with its 95 % interval
    relation: Relation  # ``"at most"`` or ``"at least"``
    bound: float  # in the same unit
    units: str = "1"  # as in CF; ``"1"`` for a pure number
    # Ranges or contact time under which it was computed; empty where none are drawn
    setting: str = ""

    @property
    def passed(self) -> bool | None:
        """Whether the interval is on the right side of the bound; None if it is on neither."""
        low, high = self.value.low, self.value.high
        if math.isnan(low) or math.isnan(high):
            return None
        if self.relation == "at least":
            low, high, bound = -high, -low, -self.bound
        else:
            bound = self.bound
        return True if high <= bound else False if low > bound else None


@dataclass(frozen=True)
class Reading:
    """One way to read the claim, or one condition, with its tests."""

    name: str
    checks: Sequence[Check]

    @property
    def passed(self) -> bool | None:
        """Whether it passes under every setting (True), under none (False), or neither (None)."""
        settings = groupby(sorted(self.checks, key=_setting), key=_setting)
        found = {_all_passed([c.passed for c in checks]) for _, checks in settings}
        return found.pop() if len(found) == 1 else None


def _setting(one: Check) -> str:
    return one.setting


def _all_passed(each: Sequence[bool | None]) -> bool | None:
    return False if False in each else None if None in each else True


@dataclass(frozen=True)
class Evidence:
    """What was computed for one claim under one base."""

    base: str  # key of a base, or `ANY_BASE`
    readings: Sequence[Reading]  # ways to read the claim as stated, at least one
    conditions: Sequence[Reading] = ()  # conditions that may save it; the name says the condition
    numbers: Sequence[Number] = ()  # what else was computed

    @property
    def verdict(self) -> Verdict:
        """The verdict, by the rule that the page states."""
        as_stated = [one.passed for one in self.readings]
        if all(as_stated):
            return Verdict.HOLDS
        if self.holding:
            return Verdict.CONDITIONAL
        missed = [one.passed is False for one in (*self.readings, *self.conditions)]
        return Verdict.FAILS if all(missed) else Verdict.UNDECIDED

    @property
    def holding(self) -> tuple[Reading, ...]:
        """Readings and conditions under which the claim holds."""
        return tuple(one for one in (*self.readings, *self.conditions) if one.passed)


@dataclass(frozen=True)
class Picture:
    """A figure with its name in files, and what is to be seen on it."""

    name: str
    caption: str
    figure: Figure


@dataclass(frozen=True)
class Outcome:
    """What was computed for one claim: evidence for each base that matters, and figures."""

    evidence: Sequence[Evidence]
    pictures: Sequence[Picture] = ()


@dataclass(frozen=True)
class Claim:
    """One claim of the study: its words, and what was computed."""

    # key, source: number in the list of claims; section, equation or figure of the study
    key: str
    source: str
    sentence: str
    method: str  # how it was tested
    reason: str  # the physics behind the outcome
    outcome: Outcome

    @property
    def conditions(self) -> tuple[str, ...]:
        """Under which it holds on some base, where it does not without."""
        names = (
            reading.name
            for one in self.outcome.evidence
            if one.verdict is Verdict.CONDITIONAL
            for reading in one.holding
        )
        return tuple(dict.fromkeys(names))


def check(
    what: str,
    value: Estimate | SupportsFloat,
    relation: Relation,
    bound: float,
    units: str = "1",
    setting: str = "",
) -> Check:
    """Hold an estimate, or a number that is known without doubt, against a bound."""
    return Check(what, exact(value), relation, bound, units, setting)


def nearly_all(what: str, flags: ArrayLike, setting: str = "") -> Check:
    """Hold the share of what is true against what is granted as all."""
    return check(what, share(flags), "at least", NEARLY_ALL, setting=setting)


def number(what: str, value: Estimate | SupportsFloat, units: str = "1") -> Number:
    """State an estimate, or a number that is known without doubt."""
    return Number(what, exact(value), units)
