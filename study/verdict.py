"""A claim, its evidence on each base, and the rule by which evidence gives a verdict.

The texts of the rule and of the claims are in ``texts.toml``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final, Literal, SupportsFloat

from numpy.typing import ArrayLike

from study.estimates import Estimate, exact, exceptions, share
from study.samples import TABLE_1, Setting

Relation = Literal["at most", "at least"]
# Base of evidence that does not depend on one: geometry, weights, the film
ANY_BASE: Final = "any"
# Least share of true cases with which a statement about all cases passes
NEARLY_ALL: Final = 0.95
# Least share of true cases with which a statement about some cases passes
SOME: Final = 0.01
# Greatest height of flights in a laboratory, m: that of a room
ROOM: Final = 3.0


class Verdict(Enum):
    """Verdict on a claim."""

    HOLDS = "holds"
    CONDITIONAL = "holds under a condition"
    OUTSIDE = "holds only outside the laboratory"
    FAILS = "fails"
    UNDECIDED = "cannot be judged"


@dataclass(frozen=True)
class Number:
    """A computed number for information, which is not part of a test."""

    what: str
    value: Estimate
    units: str = "1"
    setting: Setting | None = None  # as of a check


@dataclass(frozen=True)
class Check:
    """A computed number and the bound with which it is compared."""

    what: str  # the number in words
    value: Estimate  # as computed, with its 95 % interval
    relation: Relation  # ``"at most"`` or ``"at least"``
    bound: float  # in the same unit
    units: str = "1"  # as in CF; ``"1"`` for a pure number
    setting: Setting | None = None  # under which it was computed; None: that of the evidence

    @property
    def passed(self) -> bool | None:
        """Return whether the interval meets the bound; None if only in part, or if it is NaN."""
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
    height: float = 0.0  # to which particles must fly at 1 Hz for the condition, m

    @property
    def usable(self) -> bool:
        """Return whether flights stay below the ceiling of a room."""
        return self.height <= ROOM

    @property
    def by_setting(self) -> dict[str, bool | None]:
        """Return whether the reading passes under each setting that has a case to test."""
        settings: dict[str, list[bool | None]] = {}
        for one in self.checks:
            if one.value.cases != 0:
                name = one.setting.name if one.setting else ""
                settings.setdefault(name, []).append(one.passed)
        return {name: _all_passed(each) for name, each in settings.items()}

    @property
    def passed(self) -> bool | None:
        """Return True if it passes under every setting, False if under none, None otherwise."""
        found = set(self.by_setting.values())
        return found.pop() if len(found) == 1 else None

    @property
    def reason(self) -> str:
        """Reason why the reading is open; empty where it is not."""
        if self.passed is not None:
            return ""
        if not self.by_setting:
            return "no case to test under any setting"
        passes, misses, few = (" / ".join(self._settings(one)) for one in (True, False, None))
        if passes and misses:
            return f"it differs between settings: passes under {passes}; missed under {misses}"
        return f"too few data{f' under {few}' if few else ''}"

    @property
    def unlike(self) -> tuple[str, ...]:
        """Settings whose outcome differs from that of most others; empty if all agree."""
        passes, misses = self._settings(True), self._settings(False)
        return passes if len(passes) < len(misses) else misses

    def _settings(self, outcome: bool | None) -> tuple[str, ...]:
        return tuple(name for name, passed in self.by_setting.items() if passed is outcome)


def _all_passed(each: Sequence[bool | None]) -> bool | None:
    return False if False in each else None if None in each else True


@dataclass(frozen=True)
class Evidence:
    """Evidence for one claim under one base."""

    base: str  # key of a base, or `ANY_BASE`
    readings: Sequence[Reading]  # ways to read the claim as stated, at least one
    conditions: Sequence[Reading] = ()  # conditions under which it may hold, stated by their names
    numbers: Sequence[Number] = ()  # further computed numbers
    setting: Setting = TABLE_1  # of all numbers that state no setting
    not_computed: Sequence[str] = ()  # the package's refusals on this base

    @property
    def verdict(self) -> Verdict:
        """The verdict, by the rule that the page states."""
        as_stated = [one.passed for one in self.readings]
        if all(as_stated):
            return Verdict.HOLDS
        if self.holding:
            usable = any(one.usable for one in self.holding)
            return Verdict.CONDITIONAL if usable else Verdict.OUTSIDE
        missed = [one.passed is False for one in (*self.readings, *self.conditions)]
        return Verdict.FAILS if all(missed) else Verdict.UNDECIDED

    @property
    def decisive(self) -> Check:
        """The first test that decides the verdict: one that is missed, else one that is open."""
        of_readings = [one for reading in self.readings for one in reading.checks]
        order = {False: 0, None: 1, True: 2}
        return min(of_readings, key=lambda one: order[one.passed])

    @property
    def holding(self) -> tuple[Reading, ...]:
        """Readings and conditions under which the claim holds."""
        return tuple(one for one in (*self.readings, *self.conditions) if one.passed)

    @property
    def reason(self) -> str:
        """Reasons why the claim cannot be judged, for every open reading and condition."""
        if self.verdict is not Verdict.UNDECIDED:
            return ""
        every = (*self.readings, *self.conditions)
        return "; ".join(f"{one.name}: {one.reason}" for one in every if one.passed is None)


@dataclass(frozen=True)
class Picture:
    """A drawn figure with its file name and its caption."""

    name: str
    caption: str
    svg: str
    png: bytes


@dataclass(frozen=True)
class Outcome:
    """Evidence for one claim on each base that matters, and its figures."""

    evidence: Sequence[Evidence]
    pictures: Sequence[Picture] = ()


@dataclass(frozen=True)
class Claim:
    """One claim of the study: its words, and its computed evidence."""

    # key, source: number in the list of claims; section, equation or figure of the study
    key: str
    source: str
    sentence: str
    method: str  # how it was tested
    reason: str  # the physics behind the outcome
    outcome: Outcome
    incidental: bool = False  # about the apparatus or the scheme, not about the dynamics
    absent: str = ""  # why it is not computed on some base

    @property
    def conditions(self) -> tuple[str, ...]:
        """Conditions under which the claim holds on some base where it does not hold as stated."""
        names = (
            reading.name
            for one in self.outcome.evidence
            if one.verdict in (Verdict.CONDITIONAL, Verdict.OUTSIDE)
            for reading in one.holding
        )
        return tuple(dict.fromkeys(names))


def check(
    what: str,
    value: Estimate | SupportsFloat,
    relation: Relation,
    bound: float,
    units: str = "1",
    setting: Setting | None = None,
) -> Check:
    """Compare an estimate, or an exact number, with a bound."""
    return Check(what, exact(value), relation, bound, units, setting)


def nearly_all(what: str, flags: ArrayLike, setting: Setting | None = None) -> Check:
    """Compare the share of true cases with `NEARLY_ALL`."""
    return check(what, share(flags), "at least", NEARLY_ALL, setting=setting)


def without_exception(what: str, flags: ArrayLike, setting: Setting | None = None) -> Check:
    """Compare the number of exceptions, which `what` names, with zero."""
    return check(what, exceptions(flags), "at most", 0.0, setting=setting)


def number(
    what: str,
    value: Estimate | SupportsFloat,
    units: str = "1",
    setting: Setting | None = None,
) -> Number:
    """State an estimate, or an exact number."""
    return Number(what, exact(value), units, setting)
